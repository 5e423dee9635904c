"""What a record says about the sense chain itself: a converter at its end, a channel that is stuck, or one that
saturates before the converter does.

The first is flagged by the board. The others are judged by the noise: a channel whose noise exceeds half a code does
not repeat itself for long, and has no code that is much more frequent than its neighbours.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from estimator.thresholds import THRESHOLDS
from hil.numbers import counted
from hil.records.capture import Capture, RowFlag

_STUCK = 50  # equal codes in a row
_SHARE = 0.01  # of the samples at one code
_CROWD = 50  # samples at one code, in a short record
_EXCESS = 10.0  # over the codes beside it
_BESIDE = 5
_CODES = 1 << 25  # more than any converter has


class SenseFault(NamedTuple):
    """What is wrong, in words, and what to do about it; from when to when, s of bench time; whether it `voids` what is
    estimated of those samples: no model of the device explains them.
    """

    text: str
    cure: str
    from_s: float
    until_s: float
    voids: bool


def sense_faults(capture: Capture, noise_V: float) -> list[SenseFault]:
    """One per fault, the first in time first, as others follow from it; of a record without codes, or with less noise
    than half a code, only what its board flagged.
    """
    if len(capture) < _STUCK:
        return []
    axes = [axis for axis in "xy"[: capture.axes] if f"v{axis}_code" in capture.columns]
    runs, counts, ends = {a: Runs() for a in axes}, {a: Counts() for a in axes}, {a: Counts() for a in axes}
    flagged, first_s, last_s = 0, 0.0, 0.0
    for piece in capture.pieces():
        at = np.flatnonzero(piece.flags & RowFlag.ADC_CLIPPED)
        if len(at):
            first_s = first_s if flagged else float(piece.t_s[at[0]])
            flagged, last_s = flagged + len(at), float(piece.t_s[at[-1]])
        for axis in axes:
            codes = np.asarray(piece.columns[f"v{axis}_code"])
            runs[axis].add(codes)
            counts[axis].add(codes)
            if len(at):
                ends[axis].add(codes[at])
    told, clipped = [], []
    if flagged > THRESHOLDS.fitness.clipped_share * len(capture):
        clipped = [axis for axis in axes if ends[axis].crowded() is not None]
        where = f" of channel{'s' if len(clipped) > 1 else ''} {' and '.join(clipped)}" if clipped else ""
        told.append(
            SenseFault(
                f"the converter{where} was at its end (flag CLIPPED) in {counted(flagged, 'sample')}, from "
                f"{first_s:.4g} s to {last_s:.4g} s",
                "lower [device] amplitude_m, or the gain before the converter, and run again",
                first_s,
                last_s,
                voids=True,
            )
        )
    for axis in axes:
        scale = abs(float(capture.header["columns"][f"v{axis}_code"]["scale"]))
        if noise_V < 0.5 * scale:
            continue
        start, length = runs[axis].longest
        from_s, until_s = (float(capture.part(row, row + 1).t_s[0]) for row in (start, start + length - 1))
        if length >= _STUCK:
            told.append(
                SenseFault(
                    f"channel {axis} repeated one code for {until_s - from_s:.4g} s from {from_s:.4g} s on: it is "
                    "stuck",
                    f"check the amplifier, the converter and the cable of channel {axis}",
                    from_s,
                    until_s,
                    voids=True,
                )
            )
        elif axis not in clipped and (code := counts[axis].crowded()) is not None:
            words = f"channel {axis} went no further than {abs(code) * scale:.3g} V: its amplifier saturates"
            told.append(SenseFault(words, "", from_s, until_s, voids=False))
    return sorted(told, key=lambda fault: (not fault.voids, fault.from_s))


class Runs:
    """Stretches of equal codes in a record that comes in parts."""

    def __init__(self) -> None:
        self.longest = (0, 0)
        """(first row, length) of the longest so far."""
        self._rows = 0
        self._last: tuple[int, int] | None = None  # (code, length) of the stretch at the end

    def add(self, codes: npt.NDArray[np.int32]) -> None:
        """Take the next part, not empty."""
        edges = np.flatnonzero(np.diff(codes) != 0) + 1
        starts = np.concatenate([[0], edges])
        lengths = np.diff(np.concatenate([starts, [len(codes)]]))
        before = self._last[1] if self._last is not None and self._last[0] == codes[0] else 0
        lengths[0] += before
        longest = int(np.argmax(lengths))
        if lengths[longest] > self.longest[1]:
            self.longest = self._rows + int(starts[longest]) - (before if longest == 0 else 0), int(lengths[longest])
        self._last = int(codes[-1]), int(lengths[-1])
        self._rows += len(codes)


class Counts:
    """How often each code was, in a record that comes in parts."""

    def __init__(self) -> None:
        self._low = 0
        self._dense: npt.NDArray[np.int64] = np.zeros(0, np.int64)

    def add(self, codes: npt.NDArray[np.int32]) -> None:
        """Take the next part, not empty."""
        low, high = int(codes.min()), int(codes.max())
        if self._dense.size:
            low, high = min(low, self._low), max(high, self._low + self._dense.size - 1)
        if high - low >= _CODES:  # of no converter: only the commonest code matters, and these have none
            return
        if not self._dense.size or low < self._low or high >= self._low + self._dense.size:
            grown = np.zeros(high - low + 1, np.int64)
            at = self._low - low if self._dense.size else 0
            grown[at : at + self._dense.size] = self._dense
            self._dense, self._low = grown, low
        first = int(codes.min())
        counts = np.bincount(codes.astype(np.int64) - first)
        self._dense[first - self._low : first - self._low + counts.size] += counts

    def crowded(self) -> int | None:
        """The code of a hundredth of the samples, at least fifty, and ten times what the codes beside it have."""
        if not self._dense.size:
            return None
        most = int(np.argmax(self._dense))
        count = int(self._dense[most])
        if count < max(_SHARE * int(self._dense.sum()), _CROWD):
            return None
        beside = int(self._dense[max(most - _BESIDE, 0) : most + _BESIDE + 1].sum()) - count
        return most + self._low if count > _EXCESS * beside / (2 * _BESIDE) else None
