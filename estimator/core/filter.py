"""The filter of one observer in the core: its arrays by their addresses, with the scratch that C works in."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.core.arguments import Arguments
from estimator.core.layout import MEMORY, OUTPUT, SETTINGS, TRIMS
from estimator.core.library import ESTIMATOR_BYTES, LIBRARY
from estimator.core.structures import Arrays

Array = NDArray[np.float64]

_OBSERVER, _BLOCK = Arguments("structs.h", "Observer"), Arguments("estimator.h", "Block")
_GATHERING = Arguments("stationary.h", "Gathering")
_KINDS = {"settings": SETTINGS, "memory": MEMORY, "rows": OUTPUT, "active": np.dtype(np.int64), "trims": TRIMS}
_LINE = 64  # bytes of a line of the cache, at which `Estimator` begins
STEP = ctypes.cast(LIBRARY.estimator_tick, ctypes.c_void_p).value or 0
"""Address of the function by which a caller in C has a filter take a sample and answer it."""
LIBRARY.estimator_tick.argtypes = (ctypes.c_void_p, *4 * (ctypes.c_double,), ctypes.c_void_p)


class Filter:
    """`Estimator` of estimator.h about an observer's arrays, which it holds: they are changed in place only.

    Raises ValueError for an array that is no contiguous one of the type that C takes.
    """

    def __init__(self, arrays: Arrays) -> None:
        given = arrays._asdict()
        for name, array in given.items():
            _require(name, array, _KINDS.get(name, np.dtype(float)))
        self._buffer = np.zeros(ESTIMATOR_BYTES + _LINE, np.uint8)
        self.address = -(-int(self._buffer.ctypes.data) // _LINE) * _LINE
        self._held = _OBSERVER(
            count=len(arrays.active), n=len(arrays.p), width=len(arrays.p), total=len(arrays.x),
            angles=arrays.table.shape[0], phases=arrays.table.shape[1], **given,
        )  # fmt: skip
        ctypes.memmove(self.address, self._held, ctypes.sizeof(self._held.contents))
        self._here = ctypes.c_void_p(self.address)
        self._tick, self._codes = LIBRARY.estimator_tick, (ctypes.c_double * 2)()

    def tick(self, vx: float, vy: float, ux: float, uy: float) -> tuple[int, int]:
        """One sample of the closed loop: sense codes (NaN where lost) and echoed drive codes in, drive codes out."""
        self._tick(self.address, vx, vy, ux, uy, self._codes)
        x, y = self._codes
        return int(x), int(y)

    def run(
        self,
        z: Array,
        u: Array,
        h: Array,
        temperature: Array,
        truth: Array,
        rows: NDArray[np.void],
        states: Array,
        deviations: Array,
        every: int,
    ) -> int:
        """Go through n samples z (n, axes) with the drives u (n, axes, terms) over the intervals h (n,) that end there;
        temperature (n,) or (0,); truth (n, states + constants) that replaces the state before each step, or (0, …).

        Fills rows (n,) and, of every `every`-th sample, states and deviations; returns how many of them it filled.
        """
        given = {"z": z, "u": u, "h": h, "states": states, "deviations": deviations, "rows": rows}
        given |= {name: array for name, array in (("temperature", temperature), ("truth", truth)) if len(array)}
        for name, array in given.items():
            _require(name, array, _KINDS.get(name, np.dtype(float)))
        block = _BLOCK(n=len(z), terms=u.shape[2], every=every, **given)
        return int(LIBRARY.gyro_observe_block(self._here, block))

    def gather(self, total: Array, weight: Array, **course: float) -> None:
        """Sum of the gains (angles, phases, n, axes) along an orbit and their number (angles, phases) (stationary.h);
        course: the pattern's rotation, h between samples, so many of them to settle, so many samples that count.
        """
        for name, array in (("total", total), ("weight", weight)):
            _require(name, array, np.dtype(float))
        LIBRARY.gyro_gather_gains(self._here, _GATHERING(total=total, weight=weight, **course))


def _require(name: str, array: NDArray[Any], kind: np.dtype[Any]) -> None:
    """Refuse what C would read as something else."""
    if array.dtype != kind or not array.flags.c_contiguous:
        raise ValueError(f"{name} is an array of {array.dtype}; the core takes contiguous ones of {kind}")
