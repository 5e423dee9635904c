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
        codes = np.asarray(capture.columns[name])
        start, length = longest_run(codes)
        if length >= _STUCK:
            since = float(capture.t_s[start])
            for_s = float(capture.t_s[start + length - 1]) - since
            told.append(f"channel {axis} repeated one code for {for_s:.4g} s from {since:.4g} s on: it is stuck")
        elif (code := crowded_code(codes)) is not None:
            told.append(f"channel {axis} went no further than {abs(code) * scale:.3g} V: its amplifier saturates")
    return told


def longest_run(codes: npt.NDArray[np.int32]) -> tuple[int, int]:
    """(first row, length) of the longest stretch of equal codes."""
    edges = np.flatnonzero(np.diff(codes) != 0) + 1
    bounds = np.concatenate([[0], edges, [len(codes)]])
    lengths = np.diff(bounds)
    longest = int(np.argmax(lengths))
    return int(bounds[longest]), int(lengths[longest])


def crowded_code(codes: npt.NDArray[np.int32]) -> int | None:
    """The code that a hundredth of the samples have, and fifty at least, ten times what the codes beside it have."""
    values, counts = np.unique(codes, return_counts=True)
    most = int(np.argmax(counts))
    if counts[most] < max(_SHARE * len(codes), _CROWD):
        return None
    beside = (np.abs(values - values[most]) <= _BESIDE) & (values != values[most])
    return int(values[most]) if counts[most] > _EXCESS * counts[beside].sum() / (2 * _BESIDE) else None
