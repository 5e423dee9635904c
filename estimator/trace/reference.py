"""What a rate reference in the record says of a model: errors of rate and angle on the part held out."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.scaling import Array
from estimator.trace.examination import Examination
from estimator.trace.problem import Problem

EXPECTED = 2.6
"""Times what an angle is expected to be off, one in a hundred is off by more: it has been so in one draw."""


@dataclass(frozen=True)
class Departure:
    """An error against the reference, rms, before and after; allowed: what it may be after."""

    what: str
    unit: str
    before: float
    after: float
    allowed: float


def departures(problem: Problem, before: Examination, after: Examination, split: int) -> Iterator[Departure]:
    """Errors of rate and angle on the part held out, from `split` on; none without a reference.

    An angle may be off by what its deviation and the noise of the reference, which its changes tell, let it be; or half
    of the power beyond that has to go.  An estimate of the rate lags by any model: it only must not become worse.  With
    e the error before and δ what the model moves the estimate by, |e + δ|² − |e|² has, of n independent samples, a
    standard deviation of 2 |e| |δ| / √n.
    """
    reference = problem.record.reference
    was, now = before.held_out, after.held_out
    if reference is None or was.rate_error_rms is None or now.rate_error_rms is None:
        return
    later, steps = reference[split:], problem.record.step[split:]
    draws = max(float(np.sum(steps)) / problem.settings.memory, 1.0)
    by_chance = 2.0 * TWO_SIDED * was.rate_error_rms * _moved(before, after, split) / np.sqrt(draws)
    allowed = float(np.sqrt(was.rate_error_rms**2 + by_chance))
    yield Departure("rate", "rad/s", was.rate_error_rms, now.rate_error_rms, allowed)
    if was.angle_error_rms is None or now.angle_error_rms is None:
        return
    random_walk = _random_walk(later, float(np.sum(steps)))
    expected = float(np.sqrt(np.nanmean(after.estimates.angle_deviation[split:] ** 2) + random_walk**2))
    halved = np.sqrt(max(was.angle_error_rms**2 - expected**2, 0.0) / 2.0 + expected**2)
    yield Departure(
        "angle", "rad", was.angle_error_rms, now.angle_error_rms, max(EXPECTED * expected, float(halved))
    )  # fmt: skip


def _random_walk(reference: Array, seconds: float) -> float:
    """What the noise of a reference (n,) makes of its integral; one that is slower than the record stays in between."""
    steps = np.diff(reference)
    steps = steps[steps != 0.0]
    return float(np.nanstd(steps)) / np.sqrt(2.0) * seconds / np.sqrt(len(steps)) if len(steps) else 0.0


def _moved(before: Examination, after: Examination, split: int) -> float:
    """By what the estimate of the rate differs, rms over the part held out."""
    was, now = (one.estimates.of("rate")[one.estimates.index >= split] for one in (before, after))
    return float(np.sqrt(np.nanmean((now - was) ** 2)))
