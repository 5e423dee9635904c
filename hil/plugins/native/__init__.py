"""The step of a plug-in in C: `plugin.c` beside this file, built when the package is installed.

The structures are read from `gyro_plugin.h`, which plug-ins are compiled with, and from the headers beside it; the
loader compares their sizes, so that a library of before cannot run.
"""

import ctypes
from enum import IntEnum
from functools import cache
from pathlib import Path

from estimator.core.declared import Header

_PATH = Path(__file__).with_name("libplugin.so.1")
HEADER = Path(__file__).with_name("gyro_plugin.h")
"""What a plug-in in C includes."""
_double, _int, _pointer = ctypes.c_double, ctypes.c_int64, ctypes.c_void_p


class Part(IntEnum):
    """Which of its functions is called."""

    NONE = 0
    OBSERVE = 1
    CONTROL = 2


class Fault(IntEnum):
    """What was wrong with a plug-in that came back."""

    NONE = 0
    RAISED = 1
    LATE = 2
    NUMBER = 3
    BEYOND = 4
    OVERRUN = 5
    GROWN = 6
    HELD = 7
    ABSURD = 8


class Death(IntEnum):
    """Why one did not come back."""

    BLOCKED = 0
    EXIT = 1
    OVERRUN = 2
    SEGV = 3
    BUS = 4
    FPE = 5
    ILL = 6
    ABRT = 7


_HEADER = Header(
    HEADER,
    {"PARTS": len(Part), "DEATHS": len(Death)},
    *(_PATH.with_name(f"{name}.h") for name in ("structs", "watch", "drive_table")),
)
VERSION = _HEADER.numbers["GYRO_PLUGIN_VERSION"]
STATES = _HEADER.numbers["GYRO_PLUGIN_STATES"]
"""Entries that an estimate has room for."""


class Sample(ctypes.Structure):
    """`gyro_plugin_sample`"""

    _fields_ = _HEADER.fields("gyro_plugin_sample")


class Estimate(ctypes.Structure):
    """`gyro_plugin_estimate`"""

    _fields_ = _HEADER.fields("gyro_plugin_estimate")


class Trims(ctypes.Structure):
    """`gyro_plugin_trims`"""

    _fields_ = _HEADER.fields("gyro_plugin_trims")


class Named(ctypes.Structure):
    """`gyro_plugin_named`"""

    _fields_ = _HEADER.fields("gyro_plugin_named")


class PluginState(ctypes.Structure):
    """`plugin_t`"""

    _fields_ = _HEADER.fields("plugin_t")


class Watch(ctypes.Structure):
    """`watch_t`"""

    _fields_ = _HEADER.fields("watch_t")


class Table(ctypes.Structure):
    """`drive_table_t`"""

    _fields_ = _HEADER.fields("drive_table_t")


OBSERVE = ctypes.CFUNCTYPE(None, _pointer, _pointer, _pointer)
TRIMMED = ctypes.CFUNCTYPE(None, _pointer, _pointer)
CONTROL = ctypes.CFUNCTYPE(None, _pointer, _pointer, ctypes.c_int, _pointer)


@cache
def library() -> ctypes.CDLL:
    """The library. Raises ImportError where it was not built, or is of another version."""
    try:
        found = ctypes.CDLL(str(_PATH))
    except OSError as error:
        raise ImportError(f"{_PATH.name} of plug-ins cannot be loaded ({error}); run `make install`") from None
    told = ("device", "sample", "estimate", "drive", "trims")
    expected = (*(_HEADER.size(f"gyro_plugin_{name}") for name in told), *map(_HEADER.size, ("plugin_t", "watch_t")))
    sizes = (ctypes.c_int64 * len(expected))()
    found.plugin_sizes(sizes)
    if tuple(sizes) != expected:
        raise ImportError(f"{_PATH.name} has structures of {tuple(sizes)} bytes, Python {expected}: make install")
    for name, result, arguments in (
        ("plugin_watch", _int, (_pointer,)),
        ("plugin_lend", _int, (_pointer, _pointer)),
        ("plugin_give_back", None, (_pointer,)),
        ("plugin_init", ctypes.c_char_p, (_pointer, _pointer, _int, _int)),
        ("plugin_remember", None, (_pointer,)),
        ("plugin_step", None, (_pointer, *[_double] * 4, _pointer)),
        ("plugin_observe", _int, (_pointer, *[_int] * 3, *[_pointer] * 5)),
    ):
        call = getattr(found, name)
        call.restype, call.argtypes = result, arguments
    return found
