"""The first rows of a run, kept in memory: before the first drive they tell sense levels, after the run signs.

Whether the sense channels of a board that streams can be those of the declared device; before it is first driven.

The mass may be at rest or swing, so that a low level is nothing to refuse.  What is refused is a channel that stands
still although its noise should move it, one at the end of its converter, one that sits far from its declared offset,
and one that swings far beyond the declared amplitude.

Whether a drive acts the wrong way round, told from the beginning of a record by trying both signs of each axis.

The observer is run over the same samples with each combination of signs of the drive.  A wrong sign of the sense gain
of one axis looks the same as one of its drive: what turns it round in the observer turns it right.  The combination of
the bench file is refuted when it predicts the samples far worse than another one, which predicts them well.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Observer
from hil.bench import Bench
from hil.wire.messages import Identity


class Opening:
    """Told rows (tick, vx, vy, ux, uy, …) until it has as many as it needs.

    Attributes:
        judged: whether there were enough rows to tell the sense levels by.
        wrong: what is wrong with the sense levels, "" while that is nothing or not known yet.
    """

    def __init__(self, bench: Bench, identity: Identity) -> None:
        self._bench = bench
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        self._end = 2 ** (identity.sense_bits - 1) - 1
        self._levels = Levels(bench, identity)
        self._needed = max(self._levels.rows, samples_needed(bench))
        self._rows: list[Sequence[int]] = []
        self.judged = False
        self.wrong = ""

    @property
    def lacking(self) -> int:
        """Rows until there are as many as the next judgement needs, at least one."""
        return max((self._needed if self.judged else self._levels.rows) - len(self._rows), 1)

    def saw(self, rows: Iterable[Sequence[int]]) -> bool:
        """Note the next rows; whether they were the last that are needed."""
        self._rows.extend(rows)
        if not self.judged and len(self._rows) >= self._levels.rows:
            self.judged = True
            self.wrong = self._levels.wrong(np.array([row[1:3] for row in self._rows]))
        return len(self._rows) >= self._needed

    def wrong_way(self, make_observer: Callable[[], Observer]) -> str:
        """As the function `wrong_way`, for what came of the run so far."""
        if len(self._rows) < 2:
            return ""
        rows = np.array([row[:5] for row in self._rows])
        clipped = np.flatnonzero((np.abs(rows[:, 1:3]) >= self._end).any(axis=1))
        if len(clipped):  # from there on the samples are not what the device did
            rows = rows[: clipped[0]]
        if len(rows) < 2:
            return ""
        at = rows[:, 0] - rows[0, 0]
        if at[-1] >= 2 * self._needed:  # more gap than record
            return ""
        si = np.full((int(at[-1]) + 1, 4), math.nan)
        si[:, 2:] = 0.0
        si[at] = rows[:, 1:] * self._scale
        return wrong_way(self._bench, make_observer, si[:, :2], si[:, 2:])


_STUCK = 50  # equal codes in a row; the noise being half a code or more
_CLIPPED = 0.02  # share of the samples at the end of the converter
_SWING = 3.0  # amplitudes
_OFFSET_SD = 6.0
_MOST = 20_000  # rows that are looked at


class Levels:
    """What the sense channels of the device that `bench` declares can show.

    Attributes:
        rows: how many rows are needed: those of the acquisition, a cycle of the vibration at least.
    """

    def __init__(self, bench: Bench, identity: Identity) -> None:
        device = bench.device
        cycle = math.ceil(device.sample_rate_Hz / device.resonance_Hz) if device.resonance_Hz > 0.0 else _STUCK
        acquired = math.ceil(bench.observer.acquisition_s * identity.tick_rate_Hz)
        self.rows = min(max(acquired, cycle, _STUCK), _MOST)
        self._axes = device.axes
        self._scale_V = identity.sense_scale_V
        self._ends = -(2 ** (identity.sense_bits - 1)), 2 ** (identity.sense_bits - 1) - 1
        self._noise_V = device.sense.noise_V
        self._offset_V = _OFFSET_SD * bench.offset_sd_V
        self._swing_V = bench.swing_V

    def wrong(self, codes: NDArray[np.int64]) -> str:
        """The first thing that is wrong with `codes` (n, 2) of the first rows, one line; "" if nothing is."""
        for axis in range(self._axes):
            if found := self._of(codes[:, axis], "xy"[axis], self._swing_V[axis]):
                return found
        return ""

    def _of(self, codes: NDArray[np.int64], axis: str, swing_V: float) -> str:
        noisy = self._noise_V >= 0.5 * self._scale_V
        if noisy and len(codes) >= _STUCK and (codes == codes[0]).all():
            volts = codes[0] * self._scale_V
            return f"sense {axis} stands still at {volts:.3g} V; check its amplifier, its converter and the cable"
        at_end = float(np.mean((codes <= self._ends[0]) | (codes >= self._ends[1])))
        if at_end > _CLIPPED:
            return f"sense {axis} is at the end of its converter in {at_end:.0%} of the samples; check gain and offset"
        middle_V = float(np.mean(codes)) * self._scale_V
        slack_V = self._offset_V + swing_V + 6.0 * self._noise_V
        if abs(middle_V) > slack_V:
            return (
                f"sense {axis} sits at {middle_V:.3g} V, [device.sense] offset_sd_V and the amplitude allow "
                f"{slack_V:.3g} V; correct them, or check the amplifier"
            )
        peak_V = float(np.abs(codes - np.mean(codes)).max()) * self._scale_V
        allowed_V = _SWING * swing_V + 6.0 * self._noise_V
        if peak_V > allowed_V:
            return (
                f"sense {axis} swings by {peak_V:.3g} V, [device] amplitude_m × gain_V_per_m is {swing_V:.3g} V; "
                "correct them, or check the amplifier"
            )
        return ""


Floats = NDArray[np.float64]

_CYCLES = 40.0  # of the vibration after the loop was closed: enough to see a drive, few enough to be quick
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
