"""The loop's turn in C: `turn.c` beside this file, built when the package is installed.

The structures are read from `structs.h`; the loader compares their sizes, so that a library of before cannot run.
"""

import ctypes
from enum import IntEnum
from pathlib import Path

import numpy as np

from estimator.core.declared import Header
from hil.wire.can_format import ROOM as PART_ROOM
from hil.wire.framing import MAX_ENCODED
from hil.wire.spec import SPEC

_PATH = Path(__file__).with_name("libturn.so.1")
NONE = -(1 << 63)
"""In place of a tick."""
ALWAYS = (1 << 63) - 1
"""Beyond every tick."""
TRACKS = ("capture", "timing", "innovation")
"""Record files whose rows are written here, in the order of `turn_t.tracks`."""

_HEADER = Header(
    _PATH.with_name("structs.h"),
    {"INT64_MIN": NONE, "HIL_MAX_ENCODED": MAX_ENCODED, "PART_ROOM": PART_ROOM, "TRACKS": len(TRACKS)},
)
MOST_ROWS = (MAX_ENCODED + _HEADER.numbers["READ_SIZE"]) // 8 + 1
"""Rows that one read can complete."""
SAID_ROOM = 2 * 65536
"""Bytes for messages beside samples; one read needs half of it."""

ROW = np.dtype(
    [
        ("tick", "<i8"),
        *[(name, "<i4") for name in ("vx", "vy", "ux", "uy", "flags")],
        ("matrix", "<i2"),
        ("left", "<i2"),
    ]
)
"""A sample; `left` are the rows of its SENSE from this one on."""
SAID = _HEADER.row("said_t")
"""What stands before the payload of a message that is no sample."""


class Kind(IntEnum):
    """How bytes come and go: by a descriptor in three ways, by Python, or to and from a board in this process."""

    STREAM = 0
    DATAGRAM = 1
    CAN = 2
    BYTES = 3
    MEMORY = 4


class Mode(IntEnum):
    FORCE = 0
    GAIN = 1
    BOARD = 2


class Why(IntEnum):
    """Why a call returns; structs.h has the words."""

    DONE = 0
    QUIET = 1
    NEWS = 2
    GAP = 3
    DUE = 4
    ODD = 5
    LOOK = 6
    FULL = 7
    WOKEN = 8
    CLOSED = 9
    FAILED = 10
    BEYOND = 11


class ReceiverState(ctypes.Structure):
    _fields_ = [("short" if name == "too_short" else name, kind) for name, kind in _HEADER.fields("receiver_t")]


class CanState(ctypes.Structure):
    _fields_ = _HEADER.fields("can_t")


class Batch(ctypes.Structure):
    _fields_ = _HEADER.fields("batch_t")


class EchoState(ctypes.Structure):
    _fields_ = _HEADER.fields("echo_t")


class MatricesState(ctypes.Structure):
    _fields_ = _HEADER.fields("matrices_t")


class GainsState(ctypes.Structure):
    _fields_ = _HEADER.fields("gains_t")


class PermitState(ctypes.Structure):
    _fields_ = _HEADER.fields("permit_t")


class BlocksState(ctypes.Structure):
    _fields_ = _HEADER.fields("blocks_t")


class TurnState(ctypes.Structure):
    _fields_ = _HEADER.fields("turn_t")


STEP = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, *[ctypes.c_double] * 4, ctypes.POINTER(ctypes.c_double)
)  # context, vx, vy, ux, uy, codes
ROOM = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
RECEIVE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
SEND = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
OBSERVE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 3)  # context, n, z, u, outputs


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(_PATH))
    except OSError as error:
        raise ImportError(f"{_PATH.name} of the loop cannot be loaded ({error}); run `make install`") from None
    pointer, whole, code = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int32
    for name, (result, *arguments) in {
        "turn_run": (code, pointer),
        "turn_leave_open": (None, pointer),
        "turn_feed": (whole, *[pointer] * 3, ctypes.c_char_p, whole),
        "matrices_forget": (None, pointer),
        "matrices_sent": (None, pointer, whole),
        "matrices_named": (whole, pointer, *[whole] * 3),
        "echo_forget": (None, pointer),
        "echo_sent": (None, pointer, code, code, whole),
        "echo_saw": (whole, pointer, whole, *[code] * 3),
    }.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    shared = EchoState, MatricesState, GainsState, PermitState, BlocksState, TurnState, CanState
    expected = ROW.itemsize, ctypes.sizeof(ReceiverState), SAID.itemsize, *map(ctypes.sizeof, shared)
    sizes = (ctypes.c_int64 * len(expected))()
    library.turn_sizes(sizes)
    if tuple(sizes) != expected:
        raise ImportError(f"{_PATH.name} has structures of {tuple(sizes)} bytes, Python {expected}: make install")
    return library


LIBRARY = _load()


def payload_sizes() -> "ctypes.Array[ctypes.c_int32]":
    """Of each type of message how long its payload is: −1 where there is no such type; 0x10000 + the least where it has
    no fixed length.
    """
    sizes = (ctypes.c_int32 * 256)(*[-1] * 256)
    for layout in SPEC.messages.values():
        sizes[layout.type] = layout.size + 0x10000 * layout.open_ended
    return sizes
