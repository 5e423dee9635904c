"""A plug-in made ready to be called from C: one in C by its own functions, one in Python by callbacks."""

import ctypes
import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.errors import InputError
from hil.plugins import native
from hil.plugins.finding import METHODS, Kind, called, said
from hil.plugins.native import CONTROL, OBSERVE, TRIMMED, Fault, Part, PluginState
from hil.plugins.protocol import DeclaredDevice, Drive, Estimate, TrimVoltages

_FIGURES = 100
_double = ctypes.c_double
_FUNCTIONS: dict[Kind, str] = {"observer": "gyro_plugin_observe", "controller": "gyro_plugin_control"}
_SAMPLE = struct.Struct("q5d").unpack_from
_SINGLES = 12
_MOTION = ("x", "vx", "y", "vy")
CARRIER = "carrier_Hz"
"""The option by which a plug-in takes demodulated streams."""
_LACKING = {CARRIER: ", so that it takes samples, no demodulated streams; use slow_flow"}


class Named(NamedTuple):
    """A figure that a plug-in tells of itself, beside the limit that it had, where it had one."""

    name: str
    value: float
    unit: str
    limit: float | None


class PluginPart(ABC):
    """A plug-in in one place, or in both.

    Attributes:
        size: bytes of the instance that it is lent.
        options: numbers of its own that the bench file gives it.
        raised: what it raised, in Python.
    """

    size = 0
    in_python = False

    def __init__(self, kinds: Sequence[Kind], name: str) -> None:
        self.kinds, self.name = tuple(kinds), name
        self.raised: BaseException | None = None
        self.options: Mapping[str, float] = {}

    @property
    def called(self) -> str:
        """As messages call it."""
        return called(self.kinds[0], self.name)

    @abstractmethod
    def address(self, kind: Kind) -> int:
        """Of the function that does it."""

    def trimmed(self) -> int:
        """Address of the function that is told of trim voltages, once it has begun; 0: it has none."""
        return 0

    def why(self) -> str:
        """Why it cannot go on, as it says itself; empty where it does not."""
        return ""

    def figures(self) -> list[Named]:
        """What it tells of itself at the end of a run."""
        return []

    @abstractmethod
    def begin(self, state: PluginState, at: int, device: DeclaredDevice, names: Sequence[str]) -> None:
        """Make the instance, number `at` of what is lent; the names of the estimate's entries.

        Raises InputError where it cannot be made, or does not take the device.
        """


class Compiled(PluginPart):
    """A library."""

    def __init__(self, kinds: Sequence[Kind], name: str, path: Path) -> None:
        super().__init__(kinds, name)
        try:
            self._library = ctypes.CDLL(str(path))
        except OSError as error:
            raise InputError(f"{self.called}: {path} cannot be loaded: {error}") from None
        needed = ["gyro_plugin_version", "gyro_plugin_size", "gyro_plugin_init", *(_FUNCTIONS[kind] for kind in kinds)]
        if missing := [function for function in needed if not hasattr(self._library, function)]:
            raise InputError(f"{self.called}: {path} has no function {', '.join(missing)}; see gyro_plugin.h")
        self._library.gyro_plugin_version.restype = ctypes.c_uint
        version = self._library.gyro_plugin_version()
        if version != native.VERSION:
            raise InputError(
                f"{self.called}: {path} is of version {version} of gyro_plugin.h, this bench has {native.VERSION}; "
                "compile it with the header that `hil generate` or `hil init --plugin` writes"
            )
        self._library.gyro_plugin_size.restype = ctypes.c_size_t
        self.size = int(self._library.gyro_plugin_size())
        if self.size > 1 << 30:
            raise InputError(f"{self.called}: gyro_plugin_size gives {self.size} bytes, at most {1 << 30} are lent")

    def address(self, kind: Kind) -> int:
        return ctypes.cast(getattr(self._library, _FUNCTIONS[kind]), ctypes.c_void_p).value or 0

    def trimmed(self) -> int:
        if not hasattr(self._library, "gyro_plugin_trimmed"):
            return 0
        return ctypes.cast(self._library.gyro_plugin_trimmed, ctypes.c_void_p).value or 0

    def why(self) -> str:
        if not hasattr(self._library, "gyro_plugin_why"):
            return ""
        self._library.gyro_plugin_why.restype = ctypes.c_char_p
        return _line(self._library.gyro_plugin_why(ctypes.c_void_p(self._instance)))

    def figures(self) -> list[Named]:
        if not hasattr(self._library, "gyro_plugin_figure"):
            return []
        told, figures = native.Named(), list[Named]()
        while len(figures) < _FIGURES and self._library.gyro_plugin_figure(
            ctypes.c_void_p(self._instance), len(figures), ctypes.byref(told)
        ):
            limit = None if math.isnan(told.limit) else told.limit
            name, unit = (_line(ctypes.string_at(words) if words else None) for words in (told.name, told.unit))
            figures.append(Named(name[:31], told.value, unit[:15], limit))
        return figures

    def begin(self, state: PluginState, at: int, device: DeclaredDevice, names: Sequence[str]) -> None:
        self._instance = state.lent[at].at
        for name, value in self.options.items():
            if not self._library.gyro_plugin_option(ctypes.c_void_p(self._instance), name.encode(), _double(value)):
                raise InputError(f"{self.called}: it has no option {name}{_LACKING.get(name, '')}")
        part = Part.OBSERVE if "observer" in self.kinds else Part.CONTROL
        why = native.library().plugin_init(ctypes.byref(state), self._library.gyro_plugin_init, at, part)
        if why is not None:
            raise InputError(f"{self.called}: {_line(why) or 'it does not take this device'}")


class InPython(PluginPart):
    """A class, called back from C: an exception does not pass through it, but is told to it."""

    in_python = True

    def __init__(self, kinds: Sequence[Kind], name: str, make: Callable[..., Any]) -> None:
        super().__init__(kinds, name)
        self._make = make
        self._state: PluginState | None = None
        self._calls = {"observer": OBSERVE(self._observe), "controller": CONTROL(self._control)}
        self._told = TRIMMED(self._trimmed)

    def address(self, kind: Kind) -> int:
        return ctypes.cast(self._calls[kind], ctypes.c_void_p).value or 0

    def trimmed(self) -> int:
        if not callable(getattr(self._instance, "trimmed", None)):
            return 0
        return ctypes.cast(self._told, ctypes.c_void_p).value or 0

    def begin(self, state: PluginState, at: int, device: DeclaredDevice, names: Sequence[str]) -> None:
        self._state, self.raised = state, None
        for name in self.options:
            raise InputError(f"{self.called}: a class has no option {name}{_LACKING.get(name, '')}")
        try:
            self._instance = self._make(device)
        except (Exception, SystemExit) as error:  # noqa: BLE001 - whatever another's class does
            raise InputError(f"{self.called}: it cannot be made: {said(error)}") from None
        for kind in self.kinds:
            if not callable(getattr(self._instance, METHODS[kind], None)):
                raise InputError(f"{self.called}: a method {METHODS[kind]} is expected (hil.{kind.title()})")
        size = ctypes.sizeof(native.Sample)
        self._sample = memoryview((ctypes.c_uint8 * size).from_address(state.sample))
        self._said = _doubles(state.estimate, ctypes.sizeof(native.Estimate) // 8)
        self._forces = _doubles(state.drive, 3)
        self._at = {name: _SINGLES + i for i, name in enumerate(names)}
        self._names = tuple(names)

    def _observe(self, *_: int) -> None:
        assert self._state is not None
        try:
            _, vx, vy, ux, uy, imposed = _SAMPLE(self._sample)
            self._put(self._instance.observe((vx, vy), (ux, uy), imposed))
        except BaseException as error:  # noqa: BLE001 - it must not pass through C
            self.raised, self._state.raised = error, 1

    def _trimmed(self, *_: int) -> None:
        assert self._state is not None
        try:
            told = native.Trims.from_address(self._state.trims)
            count = told.count
            self._instance.trimmed(
                TrimVoltages(
                    volts=tuple(told.volts[:count]),
                    softening=tuple(_three(row) for row in told.softening_per_s2_per_V2[:count]),
                    softening_u=tuple(_three(row) for row in told.softening_u_per_s2_per_V2[:count]),
                    settling_s=tuple(told.settling_s[:count]),
                    softened=_three(told.softened_per_s2),
                )
            )
        except BaseException as error:  # noqa: BLE001 - it must not pass through C
            self.raised, self._state.raised = error, 1

    def _put(self, estimate: Estimate) -> None:
        if not isinstance(estimate, Estimate):
            raise TypeError(f"observe gave {_kind(estimate)}, hil.Estimate is expected")
        said, at = self._said, self._at
        said[0], said[1] = _number("angle", estimate.angle), _number("angle_u", estimate.angle_u)
        said[2], said[3] = _pair("innovation", estimate.innovation)
        said[4], said[5] = _pair("innovation_deviation", estimate.innovation_deviation)
        said[6] = _number("energy_ratio", estimate.energy_ratio)
        said[7] = _number("quadrature_ratio", estimate.quadrature_ratio)
        for name in (*_MOTION, "rate"):
            said[at[name]] = _number(name, getattr(estimate, name))
        self._put_named("constants", estimate.constants, 0)
        self._put_named("deviation", estimate.deviation, native.STATES)

    def _put_named(self, what: str, values: Mapping[str, float], beyond: int) -> None:
        for name, value in values.items():
            if name not in self._at:
                raise ValueError(f"{what} has {name!r}, known are {', '.join(self._names)}")
            number = _number(f"{what}[{name!r}]", value)
            if beyond == 0 and math.isnan(number) and self._state is not None:  # said, and no number: which is told
                self._state.given |= 1 << (self._at[name] - _SINGLES)
            self._said[self._at[name] + beyond] = number

    def _control(self, _: int, __: int, on: int, ___: int) -> None:
        assert self._state is not None
        try:
            asked = self._instance.control(self._estimate(), bool(on))
            if isinstance(asked, str) or not hasattr(asked, "__len__") or len(asked) not in (2, 3):
                raise TypeError(f"control gave {_kind(asked)}, hil.Drive or two numbers are expected")
            for i, value in enumerate(asked):
                self._forces[i] = _number(Drive._fields[i], value)
        except BaseException as error:  # noqa: BLE001 - it must not pass through C
            self.raised, self._state.raised = error, 1

    def _estimate(self) -> Estimate:
        """That of the part that observed."""
        said, states = self._said.tolist(), len(self._names)
        state = dict(zip(self._names, said[_SINGLES : _SINGLES + states], strict=True))
        beyond = _SINGLES + native.STATES
        deviation = dict(zip(self._names, said[beyond : beyond + states], strict=True))
        x, vx, y, vy, rate = (state.pop(name) for name in (*_MOTION, "rate"))
        return Estimate(
            x, vx, y, vy, rate, said[0], said[1], state, deviation, (said[2], said[3]), (said[4], said[5]), said[6],
            said[7],
        )  # fmt: skip


def _three(row: Sequence[float]) -> tuple[float, float, float]:
    xx, yy, xy = row
    return xx, yy, xy


def _line(words: bytes | None) -> str:
    return " ".join((words or b"").decode("utf-8", "replace").split())


def fault_words(state: PluginState, names: Sequence[str]) -> str:
    """What was wrong with a plug-in that came back, but for what it raised."""
    entry, value = int(state.entry), float(state.value)
    match Fault(state.fault):
        case Fault.LATE:
            return f"it took {value:.3g} s for a sample, {1e-9 * state.limit_ns:.3g} s are allowed"
        case Fault.NUMBER:
            kind = "a finite number" if not np.isfinite(value) else "zero or more"
            return f"{_entry(entry, names)} is {value:g}; it must be {kind}"
        case Fault.ABSURD:
            return f"{_entry(entry, names)} is {value:g}, a billion times what the declared device has; see to its unit"
        case Fault.HELD:
            return f"its motion has not changed over {value:g} periods, while the samples have"
        case Fault.BEYOND:
            limit = state.code_limit * state.device.drive_scale_mps2
            return f"{_entry(entry, names)} is {value:.6g} m/s², the limit is ± {limit:.6g}"
        case Fault.OVERRUN:
            return "it wrote beyond the memory that it was lent"
        case Fault.GROWN:
            return f"this process has grown by {value / 1e6:.0f} MB since it began to run"
        case _:
            return "it failed"


def _entry(entry: int, names: Sequence[str]) -> str:
    others = (
        "angle", "angle_u", "the drive on x", "the drive on y", "virtual_rotation", "innovation_deviation on x",
        "innovation_deviation on y",
    )  # fmt: skip
    if entry >= 2 * native.STATES:
        return others[entry - 2 * native.STATES]
    at = entry % native.STATES
    name = names[at] if at < len(names) else str(at)
    return name if entry < native.STATES else f"the deviation of {name}"


def _doubles(address: int, count: int) -> NDArray[np.float64]:
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))


def _number(name: str, value: Any) -> float:
    try:
        if isinstance(value, str) or getattr(value, "shape", ()) != ():
            raise TypeError
        return float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {_kind(value)}, a number is expected") from None


def _pair(name: str, values: Any) -> tuple[float, float]:
    try:
        first, second = values
    except (TypeError, ValueError):
        raise TypeError(f"{name} is {_kind(values)}, two numbers are expected") from None
    return _number(name, first), _number(name, second)


def _kind(value: Any) -> str:
    shape = getattr(value, "shape", None)
    return f"{type(value).__name__} of shape {shape}" if shape else f"a {type(value).__name__}"
