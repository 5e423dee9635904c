"""The emulator's inner loop in C: `device.c` beside this file, built when the package is installed.

It takes NumPy records by address.  The loader compares their sizes with those of the C structures, so that one without
the other cannot run.  No fast-math and no contraction: one seed gives the same bytes on every instruction set.
"""

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PATH = Path(__file__).with_name("libdevice.so.1")


class DeviceArguments(ctypes.Structure):
    """`device_t` of device.c: what a call works on, each array by its address."""

    _fields_ = (
        ("constants", ctypes.c_void_p),
        ("effects", ctypes.c_void_p),
        ("effect_count", ctypes.c_int64),
        ("pieces", ctypes.c_void_p),
        ("piece_count", ctypes.c_int64),
        ("state", ctypes.c_void_p),
        ("history", ctypes.c_void_p),
        ("history_rows", ctypes.c_int64),
        ("noise", ctypes.c_void_p),
        ("noise_columns", ctypes.c_int64),
        ("drive_codes", ctypes.c_void_p),
        ("sense_codes", ctypes.c_void_p),
        ("truth", ctypes.c_void_p),
    )


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(_PATH))
    except OSError as error:
        raise ImportError(f"{_PATH.name} of the emulator cannot be loaded ({error}); run `make install`") from None
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    library.device_advance.argtypes = (pointer, count, count)
    library.device_advance_closed.argtypes = (pointer, count, count, pointer)
    library.device_rate_at.argtypes = (pointer, ctypes.c_double, pointer)
    return library


_LIBRARY = _load()
advance = _LIBRARY.device_advance
advance_closed = _LIBRARY.device_advance_closed


def rate_at(piece: np.void | NDArray[Any], t_s: float) -> tuple[float, float, float]:
    """(Ω in rad/s, Ω̇ in rad/s², ∫Ω dt in rad since t = 0) at t_s, which lies in `piece`, a record of dtype `PIECE`."""
    record = np.asarray(piece)
    values = (ctypes.c_double * 3)()
    _LIBRARY.device_rate_at(record.ctypes.data, t_s, values)
    return values[0], values[1], values[2]


def require_sizes(expected: tuple[int, ...]) -> None:
    """ImportError unless the C structures are as large as `expected`, in the order of `device_sizes`."""
    sizes = (ctypes.c_int64 * len(expected))()
    _LIBRARY.device_sizes(sizes)
    if tuple(sizes) != expected:
        raise ImportError(f"{_PATH.name} has structures of {tuple(sizes)} bytes, its records {expected}: make install")
