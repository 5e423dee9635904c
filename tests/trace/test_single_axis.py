"""Single axes of SciPy's integration, each of a kind that measured mechanisms show: what is named, and how surely."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.diagnosis import Diagnosis, Verdict
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from estimator.trace.fit import fit
from estimator.trace.free_run import FreeRun
from estimator.trace.likelihood import Model
from estimator.trace.problem import Problem
from estimator.trace.search import with_defaults
from estimator.trace.trace import trace

RATE, OMEGA0, DAMPING, NOISE = 100.0, 2.0 * np.pi * 4.0, 0.5, 1e-3
DEVICE = Device(
    stiffness=(OMEGA0**2,), damping=(DAMPING,), amplitude=1.0, sample_rate=RATE, sense_gain=(1.0,), noise=(NOISE,)
)
SETTINGS = ObserverSettings(
    variant=Variant.FULL, gain=Gain.EKF,
    spread=Spread(position=2.0, velocity=2.0, offset=0.01, stiffness=0.05, damping=1.0),
    process_noise=ProcessNoise(force=1e-3),
)  # fmt: skip
Force = Callable[[float, float, float], float]


def motion(force: Force, drive: Array, start: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Displacements (n,) under a drive that is held over each interval and a force of time, place and velocity."""
    state, seen = np.array(start), np.empty(len(drive))
    for k, u in enumerate(drive.tolist()):
        run = solve_ivp(
            lambda t, s, u=u: [s[1], u + force(t, s[0], s[1])], (k / RATE, (k + 1) / RATE), state,
            rtol=1e-9, atol=1e-11,
        )  # fmt: skip
        state = run.y[:, -1]
        seen[k] = state[0]
    return seen


def traced(sense: Array, drive: Array, *, share: float = 0.6) -> Diagnosis:
    record = Record(sense[:, None], drive[:, None, None], np.full(len(sense), 1.0 / RATE))
    return trace(Problem(record, DEVICE, SETTINGS), split=int(share * len(sense)))


def measured(displacement: Array, seed: int = 1) -> Array:
    return displacement + NOISE * np.random.default_rng(seed).standard_normal(len(displacement))


def pushed(samples: int, size: float = 0.05, seed: int = 0) -> Array:
    """A drive whose power lies about the resonance and beside it."""
    return size * OMEGA0**2 * np.random.default_rng(seed).standard_normal(samples)


def linear(x: float, v: float) -> float:
    return -(OMEGA0**2) * x - DAMPING * v


def named(found: Diagnosis) -> set[str]:
    return {effect.name for effect in found.effects}


@pytest.mark.slow
def test_ring_down_that_begins_in_motion_lacks_nothing() -> None:
    still = np.zeros(1200)
    seen = measured(motion(lambda t, x, v: linear(x, v), still, (0.6, 0.8 * OMEGA0)))
    assert traced(seen, still).verdict is Verdict.ADEQUATE


@pytest.mark.long
def test_pendulum_has_the_series_of_its_sine() -> None:
    """sin x = x - x³/6 + x⁵/120 − …, up to a radian."""
    still = np.zeros(1500)
    seen = measured(motion(lambda t, x, v: -(OMEGA0**2) * np.sin(x) - DAMPING * v, still, (0.3, 0.9 * OMEGA0)))
    found = traced(seen, still)
    assert found.verdict in (Verdict.EXPLAINED, Verdict.PARTLY)
    (cubic,) = [effect for effect in found.effects if effect.name == "cubic_stiffness"]
    assert cubic.coefficients["k3x"].value == pytest.approx(-(OMEGA0**2) / 6.0, rel=0.1)
    assert found.held_out_after.ratio < 1.2


@pytest.mark.long
def test_cubic_stiffness_and_friction_behind_an_encoder_are_both_named() -> None:
    """Steps of 3 mrad are the sensor's noise: no disturbance beside which friction may as well be nothing."""
    stiffening, dry, step = 0.05 * OMEGA0**2, 0.02 * OMEGA0**2, 3e-3

    def force(t: float, x: float, v: float) -> float:
        return linear(x, v) - stiffening * x**3 - dry * np.tanh(v / (0.01 * OMEGA0))

    drive = pushed(2000, 0.3)
    found = traced(step * np.round(motion(force, drive) / step), drive)
    assert found.verdict in (Verdict.EXPLAINED, Verdict.PARTLY)
    assert {"cubic_stiffness", "dry_friction"} <= named(found)


@pytest.mark.slow
def test_saturated_drive_is_named() -> None:
    most = 0.1 * OMEGA0**2
    drive = pushed(2000, 0.1)
    found = traced(measured(motion(lambda t, x, v: linear(x, v), np.clip(drive, -most, most))), drive)
    assert (found.verdict, named(found)) == (Verdict.EXPLAINED, {"drive_saturation"})


@pytest.mark.long
def test_friction_under_a_moving_base_is_friction() -> None:
    """The base moves far from the resonance, by a force that is the largest line of the residual."""
    dry, moving = 0.02 * OMEGA0**2, 0.03 * OMEGA0**2

    def force(t: float, x: float, v: float) -> float:
        return linear(x, v) - dry * np.tanh(v / (0.01 * OMEGA0)) + moving * np.sin(2.0 * np.pi * 11.3 * t)

    drive = pushed(2000, 0.3)
    found = traced(measured(motion(force, drive)), drive)
    assert found.verdict in (Verdict.EXPLAINED, Verdict.PARTLY)
    assert named(found) & {"base_vibration", "interference"}
    assert "dry_friction" in named(found)


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "searched"), [(0.01, False), (0.3, True)])
def test_speed_of_a_friction_is_told_where_the_record_tells_it(speed: float, searched: bool) -> None:
    """Of the largest velocity about 0.6; one that is as declared costs no parameter."""
    dry, drive = 0.02 * OMEGA0**2, pushed(800, 0.3)
    seen = measured(motion(lambda t, x, v: linear(x, v) - dry * np.tanh(v / (speed * OMEGA0)), drive))
    of = FreeRun(Problem(Record(seen[:, None], drive[:, None, None], np.full(len(seen), 1.0 / RATE)), DEVICE, SETTINGS))
    found = with_defaults(of, fit(of, {"dry_friction:1": {"v0": 0.05 * OMEGA0}}))
    assert list(found.model.effects) == ["dry_friction:1"]
    assert ("v0" in found.layout.names) is searched


@pytest.mark.slow
def test_line_goes_on_in_a_part_as_in_the_whole() -> None:
    """What counts from the record's beginning does so in a part of it."""
    drive = pushed(1200)
    omega, size = 2.0 * np.pi * 11.3, 0.05 * OMEGA0**2
    seen = measured(motion(lambda t, x, v: linear(x, v) + size * np.sin(omega * t), drive))
    record = Record(seen[:, None], drive[:, None, None], np.full(len(seen), 1.0 / RATE))
    of = FreeRun(Problem(record, DEVICE, SETTINGS))
    effects = {"base_vibration": {"omega": omega}}
    layout = of.layout(effects)
    theta = layout.mean.copy()
    theta[layout.names.index("bsx")] = size / OMEGA0**2
    model = Model(effects, theta, of.declared_noise())
    later = of.part(slice(437, None)).evaluate(layout, model, derivatives=False)
    assert np.sqrt(np.nanmean(later.innovation**2)) < 1.3 * NOISE
