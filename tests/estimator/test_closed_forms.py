"""Pieces of tracing by themselves, each beside its closed form or what its page promises."""

import math
from types import SimpleNamespace
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy import stats

from estimator.diagnosis import Verdict
from estimator.errors import DivergedError
from estimator.observer import Observer
from estimator.record import Record
from estimator.residual import spectrum, whiteness
from estimator.residual.analysis import analyse
from estimator.settings import Device, ObserverSettings, Spread
from estimator.trace import examination
from estimator.trace.problem import Problem

RATE, HZ = 4000.0, 200.0
OMEGA = 2.0 * math.pi * HZ
DEVICE = Device(
    sample_rate=RATE, stiffness=(OMEGA**2, OMEGA**2, 0.0), damping=(0.8, 0.8, 0.0), amplitude=1e-4,
    sense_gain=(890.0, 890.0), noise=(1e-4, 1e-4),
)  # fmt: skip


def ring(samples: int, **channels: Any) -> Problem:
    """A motion that nothing drives, with noise."""
    t = np.arange(samples) / RATE
    sense = 0.089 * np.exp(-0.4 * t)[:, None] * np.stack([np.cos(OMEGA * t), np.sin(OMEGA * t)], axis=1)
    sense += 1e-4 * np.random.default_rng(1).standard_normal((samples, 2))
    record = Record(sense, np.zeros((samples, 2, 1)), np.full(samples, 1.0 / RATE), channels)
    return Problem(record, DEVICE, ObserverSettings())


def of(innovation: Any, deviation: Any) -> Any:
    """A fitted model with these innovations."""
    return SimpleNamespace(
        estimates=SimpleNamespace(innovation=innovation, innovation_deviation=deviation * np.ones_like(innovation)),
    )


# -- records and problems --------------------------------------------------------------------------------------------


def test_time_begins_with_the_first_sample() -> None:
    record = Record(np.zeros((4, 1)), np.zeros((4, 1, 1)), np.array([9.0, 1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(record.time, [0.0, 1.0, 3.0, 6.0])


def test_a_problem_on_another_record_is_the_same_but_for_that() -> None:
    problem, other = ring(20), ring(9).record
    moved = problem.on(other)
    assert moved.record is other
    assert (moved.device, moved.settings) == (problem.device, problem.settings)


@pytest.mark.parametrize(
    ("verdict", "is_open"),
    [(Verdict.ADEQUATE, False), (Verdict.EXPLAINED, False), (Verdict.PARTLY, True), (Verdict.UNEXPLAINED, True)],
)
def test_a_verdict_is_open_where_something_is_left(verdict: Verdict, *, is_open: bool) -> None:
    assert verdict.is_open is is_open


# -- likelihoods -----------------------------------------------------------------------------------------------------


def test_what_is_held_is_known_and_what_is_not_stays_as_sure_as_it_was() -> None:
    settings = ObserverSettings(
        spread=Spread(stiffness=0.01, damping=0.5), effects={"drive_gain": {"hx": 0.1}, "drag": {"dqx": 1.0}}
    )
    observer = Observer(DEVICE, settings)
    before = {name: getattr(observer.arrays, name).copy() for name in ("p", "c", "prior", "spread")}
    observer.hold_coefficients()
    names = list(observer.estimated)
    coefficients = [names.index(c.name) for _, effect in observer.effects for c in effect.coefficients]
    rest = [row for row in range(len(names)) if row not in coefficients]
    assert len(coefficients) == 4
    for name in ("p", "c"):
        matrix = getattr(observer.arrays, name)
        assert not matrix[coefficients].any()
        assert not matrix[:, coefficients].any()
        np.testing.assert_array_equal(matrix[np.ix_(rest, rest)], before[name][np.ix_(rest, rest)])
    for name in ("prior", "spread"):
        values, was = getattr(observer.arrays, name), before[name]
        held = len(was) - 4
        assert not values[held:].any()
        assert was[:held].any()
        np.testing.assert_array_equal(values[:held], was[:held])


# -- examinations and votes ------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_a_long_record_keeps_four_states_a_cycle_and_scores_them_in_time() -> None:
    n, split = 202_000, 120_000
    t = np.arange(n) / RATE
    rate = 0.05 * np.sin(2.0 * np.pi * 0.1 * t)
    found = examination.examine(ring(n, rate=rate), split)
    index = found.estimates.index
    every = int(index[1] - index[0])
    assert every in (4, 5)  # of twenty samples a cycle
    assert index[0] == every - 1
    np.testing.assert_array_equal(np.diff(index), every)
    off = found.estimates.of("rate") - rate[index]
    later = index >= split // every * every
    assert found.held_out.rate_error_rms == pytest.approx(float(np.sqrt(np.mean(off[later] ** 2))))
    fitted = (index >= found.settled.start) & ~later
    assert found.fitted.rate_error_rms == pytest.approx(float(np.sqrt(np.mean(off[fitted] ** 2))))


@pytest.mark.moderate
@pytest.mark.parametrize("k3", [-1e40, 1e40])
def test_an_observer_that_does_not_follow_is_told(k3: float) -> None:
    problem = ring(8000, rate=np.zeros(8000)).carrying({"cubic_stiffness": {"k3x": k3, "k3y": k3}})
    with np.errstate(all="ignore"), pytest.raises(DivergedError, match="the observer diverges on this record; correct"):
        examination.examine(problem, 5000)


# -- the residual ----------------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_a_floor_above_the_declared_noise_is_a_finding() -> None:
    n, noise = 20_000, 9e-5
    series = 1.5 * noise * np.random.default_rng(5).standard_normal((n, 2))
    record = Record(series, np.zeros((n, 2, 1)), np.full(n, 1.0 / RATE))
    _, found = analyse(series, np.full((n, 2), noise), record, HZ)
    (level,) = (one for one in found if one.kind == "level")
    assert level.text.startswith("the noise floor itself is 1.5")
    assert level.size == pytest.approx(noise * np.sqrt(1.5**2 - 1.0), rel=0.05)


def test_tails_that_underflow_are_those_of_many_digits() -> None:
    mpmath.mp.dps = 60
    above, below, ratio = 300.0, 4000.0, 30.0
    x = mpmath.mpf(below) / (below + above * ratio)
    expected = mpmath.log(mpmath.betainc(below / 2, above / 2, 0, x, regularized=True))
    assert expected < -800.0
    assert spectrum._log_f(ratio, above, below) == pytest.approx(float(expected), rel=2e-2)
    assert spectrum._log_f(1.5, 10.0, 200.0) == pytest.approx(stats.f.logsf(1.5, 10.0, 200.0))
    assert np.isfinite(spectrum._log_f(1e6, above, below))
    tail = mpmath.log(mpmath.gammainc(10, 4000, mpmath.inf, regularized=True))
    assert whiteness._log_chi2(8000.0, 20) == pytest.approx(float(tail), rel=1e-3)
