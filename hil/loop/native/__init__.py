"""The loop's turn in C: `turn.c` beside this file, built when the package is installed.

The structures are those of `structs.h`; the loader compares their sizes, so that one without the other cannot run.
Addresses are whole numbers in them, so that what holds one can be pickled.
"""

import ctypes
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from hil.wire.framing import MAX_ENCODED
from hil.wire.spec import SPEC

_PATH = Path(__file__).with_name("libturn.so.1")
_READ_SIZE = 4096
_SENT = 1 << 12
_LATER, _RECENT = 64, 16
NONE = -(1 << 63)
"""In place of a tick."""
ALWAYS = (1 << 63) - 1
"""Beyond every tick."""
MOST_ROWS = (MAX_ENCODED + _READ_SIZE) // 8 + 1
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
SAID = np.dtype(
    [("received_ns", "<i8"), ("tick", "<i8"), ("type", "<i4"), ("seq", "<i4"), ("size", "<i4"), ("reserved", "<i4")]
)
"""What stands before the payload of a message that is no sample."""


class Kind(IntEnum):
    """How bytes, or rows, come and go: by a descriptor in two ways, or by Python in two."""

    STREAM = 0
    DATAGRAM = 1
    BYTES = 2
    ROWS = 3


class Mode(IntEnum):
    """How samples are answered."""

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


def _of(numbers: str, kind: Any = ctypes.c_int64) -> list[tuple[str, Any]]:
    return [(name, kind) for name in numbers.split()]


class ReceiverState(ctypes.Structure):
    """`receiver_t`"""

    _fields_ = (
        *_of("bytes frames cobs_errors short crc_errors oversize dropped_bytes"),
        *_of("lost repeated undecodable passed_over tick expected run run_next skipping held"),
        ("rest", ctypes.c_uint8 * ((MAX_ENCODED + _READ_SIZE + 7) // 8 * 8)),
    )


class Batch(ctypes.Structure):
    """`batch_t`"""

    _fields_ = tuple(_of("rows row_room row_count said said_room said_size sizes"))


class TrackState(ctypes.Structure):
    """`track_t`"""

    _fields_ = tuple(_of("rows row_size capacity head tail written read dropped waits"))


class _Drive(ctypes.Structure):
    _fields_ = (("tick", ctypes.c_int64), ("u", ctypes.c_int32 * 2))


class EchoState(ctypes.Structure):
    """`echo_t`"""

    _fields_ = (
        *_of("latency limit due last"),
        ("shown", ctypes.c_int32 * 2),
        *_of("odd odd_tick"),
        ("odd_shown", ctypes.c_int32 * 2),
        ("odd_meant", ctypes.c_int32 * 2),
        ("sent", _Drive * _SENT),
    )


class MatricesState(ctypes.Structure):
    """`matrices_t`"""

    _fields_ = tuple(
        _of("block effective room count armed in_force odd odd_tick odd_name odd_begin odd_count odd_effective")
    )


class _Sent(ctypes.Structure):
    _fields_ = (*_of("matrix effective"), ("row", ctypes.c_int64 * 5))


class GainsState(ctypes.Structure):
    """`gains_t`"""

    _fields_ = (
        *_of("solve folding gain bias follow tell board matrices lead horizon"),
        ("late", ctypes.c_int64 * _RECENT),
        *_of("late_count first count"),
        ("sent", _Sent * _LATER),
    )


class PermitState(ctypes.Structure):
    """`permit_t`"""

    _fields_ = tuple(_of("limit permitted odd odd_tick odd_drive"))


class BlocksState(ctypes.Structure):
    """`blocks_t`"""

    _fields_ = (
        *_of("observe z u outputs"),
        ("code", ctypes.c_double * 4),
        ("unit", ctypes.c_double * 4),
        *_of("rows every since covariance_every count closed began clip saturation"),
    )


class LinkState(ctypes.Structure):
    """`link_t`"""

    _fields_ = (
        *_of("kind fd waker failure strangers"),
        *_of("peer_ip group_ip", ctypes.c_uint32),
        *_of("peer_port group_port", ctypes.c_uint16),
        ("reserved", ctypes.c_uint32),
        *_of("receive send receive_rows send_message"),
    )


class TurnState(ctypes.Structure):
    """`turn_t`"""

    _fields_ = (
        ("receiver", ctypes.c_int64),
        ("batch", Batch),
        ("link", LinkState),
        *_of("mode echo blocks gains permit"),
        ("tracks", TrackState * 3),
        *_of("room step context newest state covariance queue states estimated outputs latency"),
        ("volts", ctypes.c_double * 2),
        ("noise", ctypes.c_double * 2),
        *_of("estimates estimate_room estimate_count covariances covariance_room covariance_count"),
        *_of("estimate_every covariance_every seen seen_count look_after"),
        *_of("types seq code_limit lockstep slice_ns suspicious_ns at_once_ns"),
        *_of("goal due stale first next row_at fresh news"),
        ("shown", ctypes.c_int32 * 2),
        *_of("received_ns answered_ns sent_ns silence_ns turns behind drives"),
        *_of("samples held clipped saturated residual_safe held_longest held_run held_next"),
        *_of("residual residual_limit", ctypes.c_double),
        *_of("guarded stop failed"),
        ("refused", ctypes.c_double * 2),
    )


TRACKS = ("capture", "timing", "innovation")
"""Record files whose rows are written here, in the order of `turn_t.tracks`."""

STEP = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, *[ctypes.c_double] * 4, ctypes.POINTER(ctypes.c_double)
)  # context, vx, vy, ux, uy, codes
ROOM = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
RECEIVE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
SEND = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
RECEIVE_ROWS = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
SEND_MESSAGE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
OBSERVE = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, *[ctypes.c_void_p] * 3)  # context, n, z, u, outputs


def _load() -> ctypes.CDLL:
    try:
        library = ctypes.CDLL(str(_PATH))
    except OSError as error:
        raise ImportError(f"{_PATH.name} of the loop cannot be loaded ({error}); run `make install`") from None
    pointer, whole, code = ctypes.c_void_p, ctypes.c_int64, ctypes.c_int32
    library.turn_run.argtypes = (pointer,)
    library.turn_leave_open.argtypes = (pointer,)
    library.turn_leave_open.restype = None
    library.matrices_forget.argtypes = (pointer,)
    library.matrices_forget.restype = None
    library.matrices_sent.argtypes = (pointer, whole)
    library.matrices_sent.restype = None
    library.matrices_named.argtypes = (pointer, whole, whole, whole)
    library.matrices_named.restype = whole
    library.turn_feed.argtypes = (pointer, pointer, ctypes.c_char_p, whole)
    library.turn_feed.restype = whole
    library.echo_forget.argtypes = (pointer,)
    library.echo_forget.restype = None
    library.echo_sent.argtypes = (pointer, code, code, whole)
    library.echo_sent.restype = None
    library.echo_saw.argtypes = (pointer, whole, code, code, code)
    library.echo_saw.restype = whole
    expected = (ROW.itemsize, *map(ctypes.sizeof, (ReceiverState,)), SAID.itemsize)
    expected += tuple(map(ctypes.sizeof, (EchoState, MatricesState, GainsState, PermitState, BlocksState, TurnState)))
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
