"""The second pass of a fit begins with what the first one found, and is no worse for it; free runs of a model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from estimator.observer import Estimates, Observer
from estimator.record import Record
from estimator.settings import Device, ObserverSettings, ProcessNoise, Spread
from estimator.trace import fitting, prediction
from estimator.trace.fitting import coefficients_of, constants_of, fit, run
from estimator.trace.problem import Problem

SAMPLE_RATE, N, RATE = 96_000.0, 16_000, -0.62
OMEGA = 2.0 * np.pi * 2160.0
DEVICE = Device(
    sample_rate=SAMPLE_RATE,
    stiffness=(OMEGA**2, OMEGA**2, 0.0),
    damping=(2.7, 2.7, 0.0),
    amplitude=5e-6,
    sense_gain=(4e4, 4e4),
    noise=(5e-4, 5e-4),
)


def ring_down(rate: float) -> Record:
    """Of a gyro that turns at a constant rate: a linear system, from one sample to the next by its exponential."""
    coriolis = np.array([[0.0, 1.0], [-1.0, 0.0]])
    stiffness = OMEGA**2 * np.array([[0.976, -7e-4], [-7e-4, 1.006]])
    flow = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-stiffness - rate**2 * coriolis @ coriolis, -2.7 * np.eye(2) + 2.0 * rate * coriolis],
        ]
    )
    step = expm(flow / SAMPLE_RATE)
    states = np.zeros((N, 4))
    states[0] = DEVICE.amplitude * np.array([0.8, 0.6, 0.0, 0.0])
    for tick in range(1, N):
        states[tick] = step @ states[tick - 1]
    noise = 5e-4 * np.random.default_rng(4).standard_normal((N, 2))
    return Record(4e4 * states[:, :2] + noise, np.zeros((N, 2, 1)), np.full(N, 1.0 / SAMPLE_RATE))


@pytest.mark.moderate
def test_a_rate_that_stands_still_is_known_from_the_first_sample_of_the_second_pass() -> None:
    settings = ObserverSettings(
        memory=0.09,
        spread=Spread(rate=1.25, stiffness=0.018, damping=0.6),
        process_noise=ProcessNoise(rate=1e-3),
    )
    model = fit(Problem(ring_down(RATE), DEVICE, settings))
    normalised = (model.estimates.innovation / model.estimates.innovation_deviation)[: N // 8]
    assert np.sqrt(np.nanmean(normalised**2)) < 1.05
    assert abs(model.settings.initial["rate"] - RATE) < 0.1


@pytest.mark.moderate
def test_a_rate_that_moves_begins_where_it_is_declared() -> None:
    settings = ObserverSettings(
        memory=0.09, spread=Spread(rate=0.2, stiffness=0.018, damping=0.6), process_noise=ProcessNoise(rate=1.0)
    )
    assert "rate" not in fit(Problem(ring_down(RATE), DEVICE, settings)).settings.initial


def behind_low_passes(lags: tuple[float, float]) -> Record:
    """Of a gyro that is driven by noise in steps, each channel behind a first-order low-pass: one linear system."""
    rng = np.random.default_rng(8)
    flow = np.zeros((8, 8))  # x ẋ y ẏ, what each filter shows, the drives
    flow[0, 1] = flow[2, 3] = 1.0
    flow[1, [0, 1, 2, 3, 6]] = -0.99 * OMEGA**2, -2.7, 1e-3 * OMEGA**2, 2.0 * RATE, 1.0
    flow[3, [0, 1, 2, 3, 7]] = 1e-3 * OMEGA**2, -2.0 * RATE, -1.01 * OMEGA**2, -2.7, 1.0
    for axis, lag in enumerate(lags):
        flow[4 + axis, [2 * axis, 4 + axis]] = 1.0 / lag, -1.0 / lag
    step = expm(flow / SAMPLE_RATE)
    states = np.zeros((N, 8))
    states[0, :6] = DEVICE.amplitude * np.array([0.8, 0.0, 0.5, 0.0, 0.8, 0.5])  # let go from rest
    for tick in range(1, N):
        states[tick - 1, 6:] = 0.02 * OMEGA**2 * DEVICE.amplitude * rng.standard_normal(2)
        states[tick] = step @ states[tick - 1]
    drive = np.vstack([np.zeros(2), states[:-1, 6:]])
    noise = 5e-4 * rng.standard_normal((N, 2))
    return Record(4e4 * states[:, 4:6] + noise, drive[:, :, None], np.full(N, 1.0 / SAMPLE_RATE))


@pytest.mark.moderate
def test_an_effect_far_from_linear_is_fitted_about_where_it_is() -> None:
    """A low-pass near the resonance, begun without any: the first pass is led astray, the intervals still hold."""
    true = (0.55 / OMEGA, 0.4 / OMEGA)
    settings = ObserverSettings(memory=0.09, spread=Spread(rate=1.25, stiffness=0.018, damping=0.6))
    model = fit(Problem(behind_low_passes(true), DEVICE, settings).carrying({"sense_low_pass": {}}))
    normalised = model.estimates.innovation / model.estimates.innovation_deviation
    assert abs(np.sqrt(np.nanmean(normalised**2)) - 1.0) < 0.02
    observer = model.observer
    sure = np.sqrt(np.diagonal(observer.covariance))
    for name, lag in zip(("tlx", "tly"), true, strict=True):
        off = observer.state[observer.names.index(name)] - lag
        deviation = sure[observer.estimated.index(name)]
        assert deviation < 1e-3 * lag
        assert abs(off) < 4.0 * deviation


LINE = 2.0 * np.pi * 3000.0
VOLTS = {"lcx": 0.02, "lsx": -0.01, "lcy": 0.005, "lsy": 0.015}
HUM = {"interference": {"omega": LINE, **{name: volts / 4e4 for name, volts in VOLTS.items()}}}


SETTLED = ObserverSettings(
    memory=0.09, spread=Spread(rate=1.25, stiffness=0.018, damping=0.6), process_noise=ProcessNoise(rate=1e-3)
)


def hummed(record: Record) -> Record:
    """With a line on both sense channels, of 40 times the noise; time counts from one step before the first sample."""
    time = np.cumsum(record.step)
    line = np.column_stack([np.cos(LINE * time), np.sin(LINE * time)])
    return replace(record, sense=record.sense + line @ np.reshape(list(VOLTS.values()), (2, 2)).T)


@pytest.mark.moderate
def test_begun_about_a_part_of_the_record_one_pass_says_what_two_do() -> None:
    settings = ObserverSettings(
        memory=0.09, spread=Spread(rate=1.25, stiffness=0.018, damping=0.6), process_noise=ProcessNoise(rate=1e-3)
    )
    problem = Problem(hummed(ring_down(RATE)), DEVICE, settings).carrying({"interference": {"omega": LINE}})
    part = fit(problem.part(slice(0, N // 4)))
    one, two = fit(problem.under(part.settings), passes=1, about=part.observer), fit(problem)
    deviation = dict(zip(two.observer.estimated, np.sqrt(np.diagonal(two.observer.covariance)).tolist(), strict=True))
    for name, value in constants_of(two.observer).items():
        if deviation.get(name):
            assert abs(constants_of(one.observer)[name] - value) < 0.1 * deviation[name], name
    found, known = coefficients_of(one.observer)["interference"], coefficients_of(two.observer)["interference"]
    for name in VOLTS:
        assert abs(found[name] - known[name]) < 0.1 * deviation[name], name
    widths = [np.sqrt(np.diagonal(model.observer.covariance)) for model in (one, two)]
    np.testing.assert_allclose(widths[0], widths[1], rtol=0.02)


@pytest.mark.moderate
@pytest.mark.parametrize(("opening", "share", "warm", "first"), [
    (N // 4, 0.1, False, N // 4),
    (N // 8, 0.5, False, N // 2),
    (N, 0.1, False, N),
    (N // 4, 0.1, True, N),
])  # fmt: skip
def test_a_first_pass_is_of_a_part_and_finds_what_two_whole_ones_do(
    monkeypatch: pytest.MonkeyPatch, opening: int, share: float, first: int, *, warm: bool
) -> None:
    record = hummed(ring_down(RATE))
    record = replace(record, channels={"temperature": np.full(N, 20.0)}) if warm else record
    problem = Problem(record, DEVICE, SETTLED).carrying({"interference": {"omega": LINE}})
    two = fit(problem)  # shorter than what a first pass is made of
    passes: list[int] = []

    def counted(observer: Observer, one: Record, every: int | None = None) -> Estimates:
        passes.append(len(one))
        return run(observer, one, every)

    monkeypatch.setattr(fitting, "run", counted)
    monkeypatch.setattr(fitting, "_SET", replace(fitting._SET, opening=opening, opening_share=share))
    one = fit(problem)
    assert passes == [first, N]
    assert len(one.estimates.innovation) == N
    sure = dict(zip(two.observer.estimated, np.sqrt(np.diagonal(two.observer.covariance)).tolist(), strict=True))
    found, known = coefficients_of(one.observer)["interference"], coefficients_of(two.observer)["interference"]
    for name in VOLTS:
        assert abs(found[name] - known[name]) < 0.1 * sure[name], name


@pytest.mark.moderate
def test_free_runs_of_a_long_record_are_around_the_split_and_count_time_from_its_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reach, split = 4000, 9000
    monkeypatch.setattr(prediction, "_SET", replace(prediction._SET, read=reach))
    settings = ObserverSettings(memory=0.005, initial={"rate": RATE})
    errors = prediction.free_run_error(Problem(hummed(ring_down(RATE)), DEVICE, settings).carrying(HUM), split)
    there = np.flatnonzero(np.all(np.isfinite(errors), axis=1))
    assert split - reach < there[0] < split < there[-1] < split + reach
    assert np.sqrt(np.nanmean(errors**2)) < 0.01  # the line alone is 0.016


@pytest.mark.parametrize(
    ("size", "given", "starts", "best"),
    [
        (1.02, {}, [0.0], 0.0),  # as large as predicted
        (1.03, {}, [0.0, 0.3], 0.3),
        (1.03, {"tlx": 1e-5}, [1e-5], 1e-5),  # it has a start already
    ],
)
def test_a_fit_that_comes_to_nothing_is_begun_elsewhere_too(
    monkeypatch: pytest.MonkeyPatch, size: float, given: dict[str, float], starts: list[float], best: float
) -> None:
    """Of a low-pass, from a lag of 0.3/ω0 on both axes, beside what else is carried."""
    omega0, asked = np.sqrt(DEVICE.target), []

    def fitted(problem: Problem, passes: int, about: object, again: int) -> SimpleNamespace:
        (drag, low_pass) = problem.effects.values()
        assert (drag, passes, about, again) == ({"dqx": 2.0}, 1, None, 2)
        begun = low_pass.get("tlx", 0.0)
        asked.append(begun)
        assert low_pass == (given if begun in (0.0, 1e-5) else {"tlx": begun, "tly": begun})
        estimates = SimpleNamespace(innovation=np.full((4, 2), size), innovation_deviation=np.ones((4, 2)))
        return SimpleNamespace(begun=begun, likelihood=begun, estimates=estimates)

    monkeypatch.setattr(fitting, "_fit", fitted)
    record = Record(np.zeros((9, 2)), np.zeros((9, 2, 1)), np.full(9, 1.0 / SAMPLE_RATE))
    problem = Problem(record, DEVICE, ObserverSettings(effects={"drag": {"dqx": 2.0}, "sense_low_pass": given}))
    found = fit(problem, passes=1)
    scaled = [start / omega0 if start == 0.3 else start for start in starts]
    assert asked == pytest.approx(scaled)
    assert vars(found)["begun"] == pytest.approx(best / omega0 if best == 0.3 else best)
