"""What the codes of a record say about the sense chain itself: a channel that is stuck, or saturates before the
converter does.

Both are judged by the noise: a channel whose noise exceeds half a code does not repeat itself for long, and has no
code that is much more frequent than its neighbours.
"""

import numpy as np
import numpy.typing as npt

from hil.records.capture import Capture

_STUCK = 50  # equal codes in a row
_SHARE = 0.01  # of the samples at one code
_CROWD = 50  # samples at one code, in a short record
_EXCESS = 10.0  # over the codes beside it
_BESIDE = 5
_CODES = 1 << 25  # more than any converter has


def sense_faults(capture: Capture, noise_V: float) -> list[str]:
    """One line per fault, nothing for a record without codes or with less noise than half a code."""
    told = []
    for axis in "xy"[: capture.axes]:
        name = f"v{axis}_code"
        if name not in capture.columns or len(capture) < _STUCK:
            continue
        scale = abs(float(capture.header["columns"][name]["scale"]))
        if noise_V < 0.5 * scale:
            continue
        runs, counts = Runs(), Counts()
        for piece in capture.pieces():
            codes = np.asarray(piece.columns[name])
            runs.add(codes)
            counts.add(codes)
        start, length = runs.longest
        if length >= _STUCK:
            ends = capture.part(start, start + 1).t_s[0], capture.part(start + length - 1, start + length).t_s[0]
            told.append(
                f"channel {axis} repeated one code for {ends[1] - ends[0]:.4g} s from {ends[0]:.4g} s on: it is stuck"
            )
        elif (code := counts.crowded()) is not None:
            told.append(f"channel {axis} went no further than {abs(code) * scale:.3g} V: its amplifier saturates")
    return told


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
