"""The step of a plug-in in C: `plugin.c` beside this file, built when the package is installed.

The structures are those of `gyro_plugin.h`, which plug-ins are compiled with, and of `structs.h` and `watch.h`; the
loader compares their sizes.
"""

import ctypes
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

_PATH = Path(__file__).with_name("libplugin.so.1")
HEADER = Path(__file__).with_name("gyro_plugin.h")
"""What a plug-in in C includes."""
VERSION = 1
STATES = 64
"""Entries that an estimate has room for."""
TRIMS = 8
"""Electrodes that it may be told of."""
WORDS = 512
"""Bytes of a line for the process that watches, its end included."""

_double, _int = ctypes.c_double, ctypes.c_int64
_pointer = ctypes.c_void_p


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


class Device(ctypes.Structure):
    """`gyro_plugin_device`"""

    _fields_ = (
        *[(name, _double) for name in ("sample_rate_Hz", "latency", "mass_kg")],
        ("stiffness_per_s2", _double * 3),
        ("damping_per_s", _double * 3),
        *[(name, _double) for name in ("target_stiffness_per_s2", "amplitude_m")],
        ("sense_gain_V_per_m", _double * 2),
        *[(name, _double) for name in ("sense_order", "noise_V", "sense_scale_V", "drive_scale_mps2")],
        *[(name, _double) for name in ("drive_limit_mps2", "angular_gain", "virtual_rotation_rad_s")],
        ("virtual_reversal_s", _double),
    )


class Sample(ctypes.Structure):
    """`gyro_plugin_sample`"""

    _fields_ = (
        ("number", _int),
        ("sense_V", _double * 2),
        ("applied_mps2", _double * 2),
        ("virtual_rotation_rad_s", _double),
        ("sense_codes", ctypes.c_int32 * 2),
        ("applied_codes", ctypes.c_int32 * 2),
        ("lost", ctypes.c_int32),
        ("reserved", ctypes.c_int32),
        ("quadrature_V", _double * 2),
        ("applied_quadrature_mps2", _double * 2),
    )


class Estimate(ctypes.Structure):
    """`gyro_plugin_estimate`"""

    _fields_ = (
        *[(name, _double) for name in ("angle_rad", "angle_u_rad")],
        ("innovation_V", _double * 2),
        ("innovation_deviation_V", _double * 2),
        *[(name, _double) for name in ("energy_ratio", "quadrature_ratio", "angle_forced_rad", "angle_pattern_rad")],
        *[(name, _double) for name in ("angle_plain_rad", "rate_integral_rad")],
        ("state", _double * STATES),
        ("deviation", _double * STATES),
    )


class Drive(ctypes.Structure):
    """`gyro_plugin_drive`"""

    _fields_ = (("force_mps2", _double * 2), ("virtual_rotation_rad_s", _double))


class Trims(ctypes.Structure):
    """`gyro_plugin_trims`"""

    _fields_ = (
        ("count", _int),
        ("volts", _double * TRIMS),
        ("softening_per_s2_per_V2", _double * 3 * TRIMS),
        ("softening_u_per_s2_per_V2", _double * 3 * TRIMS),
        ("settling_s", _double * TRIMS),
        ("softened_per_s2", _double * 3),
    )


class Named(ctypes.Structure):
    """`gyro_plugin_named`"""

    _fields_ = (("name", ctypes.c_char_p), ("unit", ctypes.c_char_p), ("value", _double), ("limit", _double))


class Lent(ctypes.Structure):
    """`lent_t`"""

    _fields_ = (("pages", _pointer), ("length", _int), ("at", _pointer), ("size", _int), ("room", _int))


class Own(ctypes.Structure):
    """`own_t`"""

    _fields_ = (
        *[(name, _pointer) for name in ("estimator", "observe", "passed", "follow", "control", "commanded", "trimmed")],
        *[(name, _pointer) for name in ("x", "variance", "row", "factors", "entries")],
        ("estimated", _int),
        ("volts", _double * 2),
        ("per_second", _double),
    )


class Turned(ctypes.Structure):
    """`turned_t`"""

    _fields_ = (("started", _int), ("counted", _double * 6))


class Held(ctypes.Structure):
    """`held_t`"""

    _fields_ = (("motion", _double * 4), ("sense_V", _double * 2), ("unchanged", _int))


class PluginState(ctypes.Structure):
    """`plugin_t`"""

    _fields_ = (
        *[(name, _pointer) for name in ("observe", "observer", "trimmed", "control", "controller")],
        ("own", Own),
        *[(name, _pointer) for name in ("sample", "estimate", "drive", "trims")],
        ("lent", Lent * 6),
        *[(name, _pointer) for name in ("row", "state", "variance", "declared")],
        ("states", _int),
        ("turned", Turned),
        ("held", Held),
        ("device", Device),
        ("step_s", _double),
        *[(name, _int) for name in ("code_limit", "drive_on", "number", "limit_ns")],
        *[(name, _int) for name in ("begun_pages", "most_pages")],
        *[(name, ctypes.c_uint64) for name in ("given", "withdrawn")],
        *[(name, _int) for name in ("withdrawn_at", "fault", "part", "entry")],
        ("value", _double),
        ("raised", _int),
        ("failed", _pointer),
    )


class Watch(ctypes.Structure):
    """`watch_t`"""

    _fields_ = (
        ("fd", _int),
        ("patience_ns", _int),
        ("words", ctypes.c_char * WORDS * len(Death) * len(Part)),
    )


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
    kinds: tuple[type[Any], ...] = (Device, Sample, Estimate, Drive, PluginState, Watch, Trims)
    expected = tuple(map(ctypes.sizeof, kinds))
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
