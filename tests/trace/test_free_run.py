"""A free run against SciPy's integration: its error, its derivatives, what it names; start, gaps, parts held out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.record import Record
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from estimator.trace.fit import fit
from estimator.trace.free_run import TELLING, FreeRun
from estimator.trace.likelihood import Model, reach_of
from estimator.trace.problem import Problem
from estimator.trace.score_test import score_test

RATE, OMEGA0, DAMPING, SIZE, GAIN, NOISE = 1000.0, 2.0 * np.pi * 50.0, 30.0, 1e-6, 1e6, 1e-3
N = 900
DEVICE = Device(
    stiffness=(OMEGA0**2,), damping=(DAMPING,), amplitude=SIZE, sample_rate=RATE, sense_gain=(GAIN,), noise=(NOISE,)
)  # fmt: skip
SETTINGS = ObserverSettings(
    variant=Variant.FULL, gain=Gain.EKF, spread=Spread(position=1.0, velocity=1.0, offset=0.01, stiffness=0.05),
    process_noise=ProcessNoise(force=1.0),
)  # fmt: skip
Force = Callable[[float, float], float]


def record(force: Force, *, start: tuple[float, float] = (0.4e-6, 1e-4), seed: int = 0) -> Record:
    """Of SciPy's integration under a drive that is held, from a start in motion, with noise."""
    rng = np.random.default_rng(seed)
    drive = 0.02 * OMEGA0**2 * SIZE * rng.standard_normal(N).repeat(1)
    state, seen = np.array(start), []
    for u in drive:
        run = solve_ivp(
            lambda _, s, u=u: [s[1], -(OMEGA0**2) * s[0] - DAMPING * s[1] + u + force(s[0], s[1])],
            (0.0, 1.0 / RATE), state, rtol=1e-10, atol=1e-16,
        )  # fmt: skip
        state = run.y[:, -1]
        seen.append(GAIN * state[0])
    sense = np.array(seen)[:, None] + NOISE * rng.standard_normal((N, 1))
    return Record(sense, drive[:, None, None], np.full(N, 1.0 / RATE))


def cubic(x: float, v: float) -> float:
    """A spring that is 5 % stiffer at the amplitude."""
    return -0.05 * OMEGA0**2 * SIZE * (x / SIZE) ** 3


def likelihood(force: Force = cubic) -> FreeRun:
    return FreeRun(Problem(record(force), DEVICE, SETTINGS))


def test_run_with_the_true_values_errs_by_the_noise_alone() -> None:
    of = likelihood()
    layout = of.layout({"cubic_stiffness": {}})
    theta = layout.mean.copy()
    theta[layout.names.index("k3x")] = 0.05
    theta[layout.start[:2]] = [0.4, 1e-4 / SIZE / OMEGA0]
    seen = of.evaluate(layout, Model({"cubic_stiffness": {}}, theta, of.declared_noise()))
    assert seen.scale == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / N))


@pytest.mark.parametrize("effect", ["cubic_stiffness", "drive_delay", "hysteretic_stiffness"])
def test_score_is_the_slope_of_the_power(effect: str) -> None:
    of = likelihood()
    layout = of.layout({effect: {}})
    theta = layout.mean.copy()
    theta[layout.of(effect)[0]] += 0.02
    model = Model({effect: {}}, theta, of.declared_noise())
    slope = of.evaluate(layout, model).score.sum(axis=0)
    for k in range(len(theta)):
        step = 1e-5 * np.eye(len(theta))[k]
        ends = [
            of.evaluate(layout, replace(model, theta=theta + sign * step), derivatives=False).power.sum()
            for sign in (1.0, -1.0)
        ]
        assert slope[k] == pytest.approx(-(ends[0] - ends[1]) / 4e-5, rel=2e-4, abs=2e-4 * float(np.max(np.abs(slope))))


def test_fit_finds_what_is_there() -> None:
    of = likelihood()
    found = fit(of, {"cubic_stiffness": {}})
    deviation = np.sqrt(np.diagonal(np.linalg.inv(found.posterior_information)))
    truth = {"kxx": 1.0, "k3x": 0.05, "x": 0.4, "vx": 1e-4 / SIZE / OMEGA0, "phi_x": 0.0}
    for name, value in truth.items():
        k = found.layout.names.index(name)
        assert abs(found.model.theta[k] - value) < 4.0 * deviation[k], name
    assert found.model.noise.independent == pytest.approx(1.0, abs=0.15)


def test_score_test_has_the_effect_that_is_there_first_and_tells_its_size() -> None:
    of = likelihood()
    base = fit(of, {})
    scores = score_test(of, base, of.candidates(base.model, base.evaluation))
    assert scores[0].name in ("cubic_stiffness", "cubic_isotropic")
    assert scores[0].size[0] == pytest.approx(0.05, rel=0.2)


def test_coloured_error_counts_for_fewer_samples() -> None:
    base = fit(likelihood(), {})
    assert base.model.noise.independent < 0.6
    assert base.evaluation.count.sum() == pytest.approx(base.model.noise.independent * N)


def test_models_are_compared_in_the_same_samples() -> None:
    """However coloured the error of one of them is: n ln(σ²/σ²) of the samples that the other's has independent."""
    of = likelihood()
    base, full = fit(of, {}), fit(of, {"cubic_stiffness": {}})
    share = full.model.noise.independent
    assert share > 1.5 * base.model.noise.independent
    expected = share * N * np.log(base.evaluation.scale / full.evaluation.scale)
    assert full.rise_over(base) == pytest.approx(expected, rel=0.02)
    assert base.rise_over(full) == pytest.approx(-full.rise_over(base))
    price = np.log(share * N)
    assert full.surplus_over(base) == pytest.approx(full.rise_over(base) - price, abs=0.1)
    assert base.surplus_over(full) == pytest.approx(-full.surplus_over(base))


def test_part_that_was_not_fitted_finds_its_own_start() -> None:
    of = likelihood()
    found = fit(of, {"cubic_stiffness": {}})
    later = of.part(slice(400, N)).evaluate(found.layout, found.model, derivatives=False)
    assert np.isnan(later.innovation[:TELLING]).all()
    assert np.sqrt(np.mean(later.innovation[TELLING:] ** 2)) == pytest.approx(NOISE, rel=0.2)


def test_share_of_the_samples_moves_no_prior_but_that_of_the_start() -> None:
    """A run's error that remembers tells less of a constant, and nothing of what the first samples showed."""
    layout = likelihood().layout({"cubic_stiffness": {}})
    spread = layout.spread(0.01)
    others = np.setdiff1d(np.arange(len(spread)), layout.start)
    assert spread[others] == pytest.approx(10.0 * layout.deviation[others])
    assert spread[layout.start].tolist() == layout.deviation[layout.start].tolist()


def test_first_samples_tell_the_start_and_how_surely() -> None:
    of = likelihood()
    layout = of.layout({})
    places = [layout.names.index(name) for name in ("x", "vx")]
    off = layout.mean[places] - [0.4, 1e-4 / SIZE / OMEGA0]
    assert np.all(np.abs(off) < 3.0 * layout.deviation[places])
    assert np.all(layout.deviation[places] < 0.5)


@pytest.mark.parametrize(("size", "reach"), [(0.5, 1.0), (40.0, 40.0)])
def test_effects_of_what_is_driven_hard_are_larger(size: float, reach: float) -> None:
    """Force over that of the spring at the amplitude."""
    still = record(lambda x, v: 0.0)
    drive = np.zeros_like(still.drive)
    drive[7] = size * OMEGA0**2 * SIZE
    assert reach_of(Problem(replace(still, drive=drive), DEVICE, SETTINGS)) == pytest.approx(reach)


def test_few_independent_samples_leave_more_by_chance() -> None:
    of = likelihood()
    found = fit(of, {"cubic_stiffness": {}})
    white = found.evaluation
    smooth = np.cumsum(np.random.default_rng(2).standard_normal((N, 1)), axis=0)
    assert 1.0 < of.chance(white) < 1.2 < of.chance(replace(white, innovation=smooth))
