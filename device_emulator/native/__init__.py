"""The emulator's inner loop in C: `device.c` beside this file, built when the package is installed.

It takes NumPy records by address.  The loader compares their sizes with those of the C structures, and the names of the
effects, so that one without the other cannot run.  No fast-math and no contraction: one seed gives the same bytes on
every instruction set.
"""

import ctypes
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PATH = Path(__file__).with_name("libdevice.so.1")
_WHOLE = ctypes.c_int64
NONE = -(1 << 63)
"""In place of a tick or a sequence number."""
HORIZON = 1 << 16
"""An effective tick up to this far ahead is to come; any other, in 32 bits, has passed."""
MOST_ROWS = 1023
"""Rows of a SENSE."""
MOST_SAID = 1 << 15
"""Bytes of what a board says to one drive."""
PASS = -1
"""In place of a number of bytes: Python is to take what was heard, or has raised."""


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


class Ask(IntEnum):
    """What the board's turn asks Python to do; board.h has the words."""

    PAGE = 0
    PROTECT = 1
    STARVED = 2
    SENSE = 3
    STATUS = 4


class BoardState(ctypes.Structure):
    """`board_t` of board.h: the one copy of where a board stands. Addresses are numbers, so that it can be pickled."""

    _fields_ = (
        *((name, _WHOLE) for name in ("device", "ask", "waiting")),
        *((name, _WHOLE) for name in ("stream", "width", "latency", "protects")),
        *((name, _WHOLE) for name in ("lockstep", "gain_mode", "block", "watchdog", "status_every", "limit")),
        *((name, _WHOLE) for name in ("state", "late", "held", "saturated", "trips", "due", "fed")),
        *((name, _WHOLE) for name in ("expected", "seq", "heard", "run", "pending")),
        ("u", ctypes.c_int32 * 2),
        *((name, _WHOLE) for name in ("limited", "round", "newest")),
        *((name, _WHOLE) for name in ("count", "flags", "matrix")),
        ("codes", ctypes.c_int32 * 4 * MOST_ROWS),
    )


COMMAND = np.dtype([("tick", "i8"), ("round", "i8"), ("u", "i4", 2), ("limited", "i8")], align=True)
"""`command_t` of board.h: a drive that waits for its tick."""
ASK = ctypes.CFUNCTYPE(_WHOLE, _WHOLE, _WHOLE, ctypes.c_void_p)


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(_PATH))
    except OSError as error:
        raise ImportError(f"{_PATH.name} of the emulator cannot be loaded ({error}); run `make install`") from None
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    library.device_advance.argtypes = (pointer, count, count)
    library.device_advance_closed.argtypes = (pointer, count, count, pointer)
    library.device_rate_at.argtypes = (pointer, ctypes.c_double, pointer)
    library.board_answer.argtypes = (pointer, ctypes.c_char_p, count, pointer)
    library.board_go_on.argtypes = library.board_tell.argtypes = (pointer, pointer)
    library.board_queue.argtypes = (pointer, ctypes.c_int32, ctypes.c_int32, ctypes.c_uint32)
    for function in (library.board_answer, library.board_go_on, library.board_tell, library.board_queue):
        function.restype = count
    library.board_forget.argtypes = library.board_limit.argtypes = (pointer,)
    library.board_forget.restype = library.board_limit.restype = None
    library.device_effects.restype = ctypes.c_char_p
    return library


_LIBRARY = _load()
advance = _LIBRARY.device_advance
advance_closed = _LIBRARY.device_advance_closed
answer, go_on, tell, queue = (getattr(_LIBRARY, f"board_{name}") for name in ("answer", "go_on", "tell", "queue"))
forget, limit = _LIBRARY.board_forget, _LIBRARY.board_limit
ANSWER = ctypes.cast(answer, ctypes.c_void_p).value or 0
"""Address of `answer`, for the host's turn."""


def rate_at(piece: np.void | NDArray[Any], t_s: float) -> tuple[float, float, float]:
    """(Ω in rad/s, Ω̇ in rad/s², ∫Ω dt in rad since t = 0) at t_s, which lies in `piece`, a record of dtype `PIECE`."""
    record = np.asarray(piece)
    values = (ctypes.c_double * 3)()
    _LIBRARY.device_rate_at(record.ctypes.data, t_s, values)
    return values[0], values[1], values[2]


def require_same(effects: str, expected: tuple[int, ...]) -> None:
    """ImportError unless C has the same effects in the same order, and structures as large, as `device_sizes` tells."""
    if _LIBRARY.device_effects().decode() != effects:
        raise ImportError(f"{_PATH.name} has other hidden effects than device_emulator/effects: make install")
    sizes = (ctypes.c_int64 * len(expected))()
    _LIBRARY.device_sizes(sizes)
    if tuple(sizes) != expected:
        raise ImportError(f"{_PATH.name} has structures of {tuple(sizes)} bytes, its records {expected}: make install")
