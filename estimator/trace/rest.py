"""Up to where a motion that nothing drives is seen: a mass that has come to rest tells no more of what stopped it."""

import math

import numpy as np

from estimator.chance import chi2_isf
from estimator.record import Record
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.fitness


def moves_until(record: Record, device: Device) -> int:
    """How many samples of a free response show a motion that comes to rest: up to the last stretch of some cycles of
    the declared resonance that shows more than the declared noise about one value, in which it stops.  All where a
    drive acts, and where it moves to the end.

    Where nothing moves, the sum of squares of n samples over the variance of the noise is χ² of n − 1 degrees.
    """
    samples = len(record)
    if np.any(record.drive) or device.target <= 0.0:
        return samples
    period = 2.0 * math.pi / math.sqrt(device.target)
    length = max(round(_SET.rest * period / float(np.median(record.step))), 2)
    stretches = samples // length
    last = -1
    for series, noise in zip(record.sense.T, device.noise, strict=True):
        rows = series[: stretches * length].reshape(stretches, length)
        seen = np.sum(np.isfinite(rows), axis=1)
        mean = np.nansum(rows, axis=1) / np.maximum(seen, 1)
        squares = np.nansum((rows - mean[:, None]) ** 2, axis=1) / noise**2
        chance = THRESHOLDS.criterion.chance / max(stretches, 1)
        least = np.array([chi2_isf(chance, float(max(count - 1, 1))) for count in seen])
        moving = np.flatnonzero(squares > least)
        last = int(np.max(moving, initial=last))
    return samples if last >= stretches - 1 else max(last, 0) * length
