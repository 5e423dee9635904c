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
