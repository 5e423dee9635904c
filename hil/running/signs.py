"""Whether a drive acts the wrong way round, told from the beginning of a record by trying both signs of each axis.

The observer is run over the same samples with each combination of signs of the drive.  A wrong sign of the sense gain
of one axis looks the same as one of its drive: what turns it round in the observer turns it right.  The combination of
the bench file is refuted when it predicts the samples far worse than another one, which predicts them well.
"""

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Observer
from hil.bench import Bench

Floats = NDArray[np.float64]

_CYCLES = 40.0  # of the vibration after the loop was closed: enough to see a drive, few enough to be quick
_MOST = 20_000  # samples
_WORSE = 4.0  # in mean square of the innovation over its own expectation
_WELL = 4.0


def samples_needed(bench: Bench) -> int:
    """From the first sample of a run on."""
    rate_Hz = bench.device.sample_rate_Hz
    cycles = rate_Hz * (bench.observer.acquisition_s + _CYCLES / bench.device.resonance_Hz)
    return min(int(cycles) + 1, _MOST)


def wrong_way(bench: Bench, make_observer: Callable[[], Observer], sense_V: Floats, drive: Floats) -> str:
    """One line that names the axes whose drive acts the wrong way round, "" where none does or nobody can tell.

    `sense_V` (n, 2) in volts, NaN where samples were lost; `drive` (n, 2) as applied, in the drive's unit.
    """
    axes = [axis for axis in range(2) if drive[:, axis].any()]
    if not axes or len(sense_V) < 2:
        return ""
    begin = int(np.flatnonzero(drive.any(axis=1))[0])
    nis: dict[tuple[int, ...], float] = {}
    for signs in itertools.product((1, -1), repeat=2):
        if all(sign == 1 or axis in axes for axis, sign in enumerate(signs)):
            nis[signs] = _mean_nis(make_observer(), sense_V, drive * signs, begin)
    declared, best = nis[1, 1], min(nis, key=lambda signs: nis[signs])
    if best == (1, 1) or nis[best] > _WELL or declared < _WORSE * nis[best]:
        return ""
    turned = [axis for axis, sign in zip("xy", best, strict=True) if sign < 0]
    act = f"the drive of {turned[0]} acts" if len(turned) == 1 else "the drives of x and y act"
    return f"{act} the wrong way round: check the sign of [device.sense] gain_V_per_m and the wiring of drive and sense"


def _mean_nis(observer: Observer, sense_V: Floats, drive: Floats, begin: int) -> float:
    """Mean NIS over the samples from `begin` on, an axis at a time: the squared innovation over its predicted variance;
    1 for a model that is right."""
    with np.errstate(all="ignore"):
        estimates = observer.run(sense_V, drive)
        squares = np.square(estimates.innovation / estimates.innovation_deviation)[begin:].mean(axis=1)
    squares = squares[~np.isnan(sense_V[begin:, 0])]
    if not len(squares) or not np.isfinite(squares).all():
        return float("inf")
    return float(np.mean(squares))
