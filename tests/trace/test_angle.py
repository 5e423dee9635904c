"""The bound of the angle beside its closed form, and what an examination scores on which part of a record."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from estimator.diagnosis import Fit
from estimator.observer import Observer
from estimator.record import Record
from estimator.settings import ObserverSettings
from estimator.trace import angle, examination
from estimator.trace.angle import AngleReader
from estimator.trace.examination import Examination
from estimator.trace.problem import Problem
from tests.estimator.device import NOMINAL as DEVICE

N, SPLIT = 1200, 700
COVARIANCE = np.array([[4e-4, 3e-4], [3e-4, 9e-4]])
VALUES = (0.05, -0.02)


def problem(samples: int = N) -> Problem:
    sense = np.random.default_rng(4).standard_normal((samples, 2))
    record = Record(sense, np.ones((samples, 2, 1)), np.full(samples, 1 / 4000.0))
    known = {"drive_gain": dict(zip(("hx", "hy"), VALUES, strict=True))}
    return Problem(record, DEVICE, ObserverSettings(effects=known))


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.3, 1.0), (1.0, -1.0)])
def test_the_angles_bound_is_that_of_all_coefficients_together(monkeypatch, weights):
    """Of an angle w·c: 1.96 standard deviations of w·c, √(wᵀ C w), whichever way the two hang together."""
    w = np.array(weights)

    def read(self, effects):
        return np.array([0.0, 0.5, 1.0]) * float(w @ [effects["drive_gain"]["hx"], effects["drive_gain"]["hy"]])

    monkeypatch.setattr(AngleReader, "angle", read)
    asked = problem()
    bound = AngleReader(asked).bound(asked.effects, "drive_gain", COVARIANCE)
    assert bound == pytest.approx(norm.ppf(0.975) * np.sqrt(w @ COVARIANCE @ w), rel=1e-9)


def test_the_angles_bound_is_that_of_coefficients_of_any_size_and_of_none(monkeypatch):
    """Of which one is 10¹⁶ times another, and together they move the angle by √6; a fourth is known exactly."""
    sure = np.array([1e-6, 1e4, 1e-12, 0.0])
    covariance = (0.5 + 0.5 * np.eye(4)) * np.outer(sure, sure)

    def read(self, effects):
        a, b, c, d = effects["mine"].values()
        return np.array([0.0, 1.0]) * (a / 1e-6 + b / 1e4 + c / 1e-12 + d)

    monkeypatch.setattr(AngleReader, "angle", read)
    effects = {"mine": dict.fromkeys("abcd", 0.0)}
    bound = AngleReader(problem()).bound(effects, "mine", covariance)
    assert bound == pytest.approx(norm.ppf(0.975) * np.sqrt(6.0), rel=1e-9)


def test_the_bound_shifts_the_effect_s_coefficients_alone(monkeypatch):
    effects = {"drive_saturation": {"sx": 1.0, "sy": 1.0, "limit": 3.0}, "sense_gain": {"gy": 0.1}}
    seen = []

    def read(self, given):
        seen.append(given)
        return np.zeros(3)

    monkeypatch.setattr(AngleReader, "angle", read)
    AngleReader(problem()).bound(effects, "drive_saturation", np.diag([1e-4, 4e-4]))
    assert len(seen) == 3
    assert all(given["sense_gain"] == {"gy": 0.1} and given["drive_saturation"]["limit"] == 3.0 for given in seen)
    assert effects["drive_saturation"] == {"sx": 1.0, "sy": 1.0, "limit": 3.0}


def test_the_start_of_the_record_is_not_read(monkeypatch):
    """And coefficients stay as given; a reader is the same whatever it has read, which it reads once."""
    held, read = [], []
    observer = SimpleNamespace(hold_coefficients=lambda: held.append(None))
    monkeypatch.setattr(angle, "Observer", lambda *args: observer)

    def run(observer, record):
        read.append(len(held))
        return SimpleNamespace(angle=np.arange(float(len(record))))

    monkeypatch.setattr(angle, "run", run)
    asked = problem()
    reader = AngleReader(asked)
    settled = 3.0 * min(ObserverSettings().memory, 1.0) * DEVICE.sample_rate
    np.testing.assert_array_equal(reader.angle({}), np.arange(float(N - min(int(settled), N // 4))))
    assert reader.angle({}) is reader.angle({})
    assert read == [1]
    assert reader == AngleReader(asked)
    assert "_known" not in repr(reader)


@pytest.mark.parametrize("scored_from", [None, 0.0, 0.1, 10.0])
def test_an_angle_moves_from_where_it_is_reported_to_the_end_of_the_record(monkeypatch, scored_from):
    """Two angles 5 rad apart at first, and by 1 mrad more a sample after half of the record: zero is where they are
    reported, and the part held out counts.  A record that ends before is reported once the observer has settled."""
    later = np.maximum(np.arange(N) - N // 2, 0.0)
    monkeypatch.setattr(angle, "Observer", lambda _, settings, __: SimpleNamespace(
        hold_coefficients=lambda: None, angle=(5.0 + 1e-3 * later) if settings.effects else 0.0 * later
    ))  # fmt: skip
    monkeypatch.setattr(angle, "run", lambda observer, record: observer)
    asked = replace(problem(), scored_from=scored_from)
    reader = AngleReader.of(asked, [])
    begun = {0.0: 0, 0.1: 400}.get(scored_from, N // 4)
    assert len(reader.angle({})) == N - begun
    assert reader.moved({}, asked.effects) == pytest.approx(1e-3 * (N - 1 - N // 2))


def examined(asked: Problem) -> Examination:
    """What the bench's observer made of a record; nothing else of it is asked for."""
    observer = Observer(asked.device, asked.settings, asked.controller)
    observer.hold_coefficients()
    return Examination(None, None, (), None, angle.run(observer, asked.record, every=1), slice(0, N), asked)  # type: ignore[arg-type]


def test_an_angle_that_an_examination_read_is_the_one_that_would_be_read():
    asked = problem()
    fresh = AngleReader(asked)
    reader = AngleReader.of(asked, [examined(asked), examined(asked.carrying({}))])
    assert len(reader._known) == 2
    for effects in ({}, asked.effects):
        np.testing.assert_array_equal(reader.angle(effects), fresh.angle(effects))


def test_another_observer_or_record_tells_nothing_of_the_angle():
    asked = problem()
    others = asked.under(replace(asked.settings, initial={"kxx": 1.01 * DEVICE.target})), problem()
    assert not AngleReader.of(asked, map(examined, others))._known


def test_what_is_shifted_is_shifted_as_asked():
    effects = {"drive_saturation": {"sx": 1.0, "sy": 2.0, "limit": 3.0}, "drag": {"dqx": 5.0}}
    shifted = angle._shifted(effects, "drive_saturation", np.array([0.25, -0.5]))
    assert shifted == {"drive_saturation": {"sx": 1.25, "sy": 1.5, "limit": 3.0}, "drag": {"dqx": 5.0}}


def test_an_examination_scores_the_part_held_out_by_itself(monkeypatch):
    """No sample of the fitted part is in what is said of the rest, nor the other way round; the start is in neither."""
    asked = problem()
    n = np.arange(float(N))
    fields = dict.fromkeys(("angle", "angle_pattern", "angle_plain", "angle_rate_integral", "energy_ratio"), n)
    fields |= {"quadrature_ratio": n, "innovation": np.stack([n, n], 1), "innovation_deviation": np.ones((N, 2))}
    state = np.zeros((N, 1))
    estimates = SimpleNamespace(**fields, index=np.arange(N), state=state, deviation=state, names=())
    parts = []

    def analyse(innovation, deviation, record, resonance):
        assert resonance == pytest.approx(np.sqrt(DEVICE.target) / (2.0 * np.pi))  # Hz
        parts.append((innovation[:, 0], record.sense))
        return SimpleNamespace(simulation_rmse=None), ()

    held, strides = [], []
    observer = SimpleNamespace(hold_coefficients=lambda: held.append(None))
    monkeypatch.setattr(examination, "Observer", lambda *args: observer)
    monkeypatch.setattr(examination, "run", lambda observer, record, every: strides.append(every) or estimates)
    monkeypatch.setattr(examination, "analyse", analyse)
    monkeypatch.setattr(examination, "STATES", N)
    free = np.where(n[:, None] < SPLIT, 3.0, 4.0) * np.ones((1, 2))
    monkeypatch.setattr(examination, "free_run_error", lambda problem, split: free)
    monkeypatch.setattr(examination, "replace", lambda what, **changes: SimpleNamespace(**{**vars(what), **changes}))
    found = examination.examine(asked, SPLIT)
    (fitting_part, fitted_sense), (held_out, rest) = parts
    np.testing.assert_array_equal(held_out, n[SPLIT:])
    np.testing.assert_array_equal(rest, asked.record.sense[SPLIT:])
    settled = min(int(3.0 * min(ObserverSettings().memory, 1.0) * DEVICE.sample_rate), SPLIT // 4)
    np.testing.assert_array_equal(fitting_part, n[settled:SPLIT])
    np.testing.assert_array_equal(fitted_sense, asked.record.sense[settled:SPLIT])
    assert (found.fitted.simulation_rmse, found.held_out.simulation_rmse) == (3.0, 4.0)
    assert (held, strides) == ([None], [1])  # coefficients stay as given; so many states are all kept
    assert found.estimates is estimates
    assert found.settled == slice(settled, SPLIT)


def test_errors_of_rate_and_angle_are_those_beside_the_reference():
    """A rate that is off by 0.02 and an angle that runs away by that, on its own part of the record."""
    step = 1 / 4000.0
    true = np.full(N, 0.3)
    record = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, step), {"rate": true})
    read = np.cumsum(np.full(N, 0.32)) * step
    estimates = SimpleNamespace(
        names=("rate",), index=np.arange(N), angle=read, of=lambda name: np.where(np.arange(N) < SPLIT, 9.0, 0.32)
    )
    fit = Fit((1.0,), (1.0,), 1.0, 0.5)
    bare = Record(record.sense, record.drive, record.step)
    unseen = SimpleNamespace(**{**vars(estimates), "names": ("x",)})
    assert examination.scored(fit, bare, estimates, slice(SPLIT, N), 1) is fit
    assert examination.scored(fit, record, unseen, slice(SPLIT, N), 1) is fit
    found = examination.scored(fit, record, estimates, slice(SPLIT, N), 1)
    assert found.rate_error_rms == pytest.approx(0.02)
    assert found.angle_error_rms == pytest.approx(0.02 * step * np.sqrt(((N - SPLIT) ** 2 - 1) / 12.0))
