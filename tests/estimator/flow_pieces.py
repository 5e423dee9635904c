"""Functions of the flow one by one, as Python calls them: arrays are changed in place."""

import ctypes
from typing import Any

import numpy as np

from estimator.core.layout import MAX_ENTRIES, MAX_SIGNALS, MAX_SLIPS, SETTINGS
from estimator.scaling import Array
from tests.estimator.core_pieces import built, piece

MAX_COLUMNS = (MAX_ENTRIES + 3) // 4 * 4
_PUSH = np.dtype(
    [
        ("constants", "i8"),
        ("force", "f8", (2,)),
        ("by_states", "f8", (8,)),
        ("by_constants", "f8", (2 * (MAX_COLUMNS + 4),)),
        ("drive", "f8", (2,)),
        ("signals", "f8", (2 * MAX_SIGNALS,)),
        ("slips", "f8", (MAX_SLIPS, MAX_COLUMNS)),
    ]
)
_FLOW_WORK = np.dtype(
    [
        ("columns", "i8"),
        ("term", "f8", (4 * MAX_COLUMNS,)),
        ("other", "f8", (4 * MAX_COLUMNS,)),
        ("out", "f8", (4 * MAX_COLUMNS,)),
        ("push", _PUSH),
        ("powers", "f8", (61, 16)),
        ("drifts", "f8", (4, 80)),
        ("entries", "f8", (4, 8)),
    ]
)


class Push:
    """What effects do: arrays that are live in `record`."""

    def __init__(self, states: int, constants: int, record: Any = None) -> None:
        self.record = np.zeros(1, _PUSH)[0] if record is None else record
        self.record["constants"] = constants
        self.force, self.drive, self.signals = (self.record[name] for name in ("force", "drive", "signals"))
        self.slips = self.record["slips"]
        self.by_states = self.record["by_states"][: 2 * states].reshape(2, states)
        self.by_constants = self.record["by_constants"][: 2 * constants].reshape(2, constants)


class FlowWork:
    """Scratch of a flow whose columns are so many: arrays that are live in `record`."""

    def __init__(self, states: int, constants: int, columns: int) -> None:
        assert piece("flow_work_size", result=ctypes.c_int64, source="flow_pieces.c") == _FLOW_WORK.itemsize
        self.record = np.zeros(1, _FLOW_WORK)[0]
        self.record["columns"] = columns
        self.out = self.record["out"][: states * columns].reshape(states, columns)
        self.push = Push(states, constants, self.record["push"])


class _Interval(ctypes.Structure):
    _fields_ = (("time", ctypes.c_double), ("h", ctypes.c_double), ("u", ctypes.c_void_p), ("terms", ctypes.c_int64))


class Interval:
    """A stretch of time with its drive u (axes, terms)."""

    def __init__(self, time: float, h: float, u: Array) -> None:
        self.u = np.ascontiguousarray(u, float)
        self.record = np.frombuffer(_Interval(time, h, self.u.ctypes.data, self.u.shape[1]), np.uint8)


class Cuts:
    """Where an interval is cut."""

    def __init__(self) -> None:
        self._record = np.zeros(25)
        self.at = self._record[1:]

    @property
    def record(self) -> Array:
        return self._record

    @property
    def count(self) -> int:
        return int(self._record[:1].view(np.int64)[0])


class _Way(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_double) for name in ("value", "by_value", "by_way", "by_reach"))


def _call(name: str, *given: Any, result: Any = None) -> Any:
    return piece(name, *(getattr(one, "record", one) for one in given), result=result, source="flow_pieces.c")


def _number(name: str, *given: Any) -> float:
    return float(_call(name, *given, result=ctypes.c_double))


def _settings(states: int, first: int) -> Any:
    settings = np.zeros(1, SETTINGS)
    settings["states"], settings["axes"], settings["sense_constants"] = states, states // 2, first
    return settings[0]


def drive_at(u: Array, at: float, out: Array) -> None:
    _call("drive_at", u, *u.shape, float(at), out)


def part_of(u: Array, start: float, length: float) -> Array:
    out = np.full(u.shape, 9.0)
    _call("part_of", u, *u.shape, float(start), float(length), out)
    return out


def along(*cubic: float) -> float:
    return _number("along", np.array(cubic[:4]), float(cubic[4]))


def passing(*cubic: float) -> float:
    return _number("passing", np.array(cubic))


def insert_sorted(cuts: Cuts, value: float) -> None:
    _call("insert_sorted", cuts, value)


def late_polynomial(u: Array, past: Array, axis: int, delay: float, start: float, length: float, out: Array) -> None:
    _call("late_polynomial", Interval(0.0, 1.0, u), past, axis, float(delay), float(start), float(length), out)


def late_by(delay: float, h: float) -> float:
    return _number("late_by", float(delay), float(h))


def push_two(first: int, weight: float, out: Array, push: Push) -> None:
    _call("push_two", _settings(4, first), weight, out.shape[1], out, push)


def push_one(first: int, weight: float, out: Array, push: Push) -> None:
    _call("push_one", _settings(2, first), weight, out.shape[1], out, push)


def kick(settings: Any, c: Array, weight: float, out: Array, push: Push) -> None:
    _call("kick", settings, c, weight, out.shape[1], out.shape[1], np.zeros_like(out), out, push)


def drift_lengths() -> tuple[float, ...]:
    return tuple((ctypes.c_double * 8).in_dll(built("flow_pieces.c"), "DRIFTS"))


def drift_matrices(c: Array, u: Array, h: float, order: int, out: Array) -> None:
    _call("drift_matrices", c, u, float(h), order, np.zeros((order + 1, 16)), out)


def drift(which: int, drifts: Array, out: Array) -> None:
    _call("drift", drifts[which], out.shape[1], out)


def push_entries(weight: float, by_states: Array, entries: Array) -> None:
    _call("push_entries", weight, by_states, entries)


def find_slopes(settings: Any, c: Array, u: Array, begin: Array, end: Array) -> Array:
    swing = np.zeros(17)
    swing[:4], swing[4:8] = begin, end
    _call("find_slopes", settings, Interval(0.0, 1.0, u), c, swing)
    return swing[8:16].reshape(2, 4)


def turnovers(settings: Any, interval: Interval, c: Array, work: FlowWork) -> Cuts:
    cuts = Cuts()
    _call("turnovers", settings, interval, c, work, cuts)
    return cuts


def catches(s: float, width: float, cubic: tuple[float, ...], turn: float, cuts: Cuts) -> None:
    _call("catches", float(s), float(width), np.array(cubic), float(turn), cuts)


def begin_ways(settings: Any, c: Array, s: Array, columns: int, push: Push) -> None:
    _call("begin_ways", settings, c, s, columns, push)


def slid(z: float, way: float, reach: float) -> tuple[float, float, float, float]:
    return _way("slid", z, way, reach)


def caught(s: float, way: float, width: float) -> tuple[float, float, float, float]:
    return _way("caught", s, way, width)


def _way(name: str, *numbers: float) -> tuple[float, float, float, float]:
    found = _call(name, *(float(one) for one in numbers), result=_Way)
    return found.value, found.by_value, found.by_way, found.by_reach


def slide(settings: Any, c: Array, h: float, before: Array, out: Array, push: Push) -> None:
    _call("slide", settings, c, h, out.shape[1], out.shape[1], before, out, push.slips)


def push_slips(settings: Any, weight: float, moves: bool, out: Array, push: Push) -> None:
    # An int where the others are of 64 bits: what stands above it is not read.
    _call("push_slips", settings, weight, moves, out.shape[1], out, push)


def line_values(settings: Any, time: float, w: Array) -> None:
    _call("line_values", settings, float(time), w)


def signal_values(settings: Any, memory: Any, time: float, w: Array) -> None:
    _call("signal_values", settings, memory, float(time), w)


def directions(settings: Any, s: Array, w: Array) -> None:
    _call("directions", settings, s, w)


def turns_over(settings: Any, i: int) -> bool:
    return bool(_call("turns_over", settings, i, result=ctypes.c_int))


def lagged(value: float, u: Array, axis: int, share: float) -> float:
    return _number("lagged", float(value), u[axis], u.shape[1], float(share))


def leaking(value: float, u: Array, axis: int, rate: float, h: float) -> float:
    return _number("leaking", float(value), u[axis], u.shape[1], float(rate), float(h))


def advance_signals(settings: Any, memory: Any, c: Array, u: Array, h: float) -> None:
    _call("advance_signals", settings, memory, c, u, u.shape[1], float(h))


def flow(settings: Any, interval: Interval, past: Array, c: Array, s: Array, columns: int, work: FlowWork) -> None:
    _call("flow", settings, interval, past, c, s, columns, work)


def taylor(model: int, c: Array, u: Array, h: float, order: int, columns: int, out: Array) -> None:
    stride = out.shape[1]
    _call("taylor", model, c, u, u.shape[1], float(h), order, columns, np.zeros_like(out), out, stride)


def senses_otherwise(settings: Any) -> bool:
    return bool(_call("senses_otherwise", settings, result=ctypes.c_int))


def sensed_otherwise(settings: Any, c: Array, s: Array, push: Push, predicted: Array, full: Array) -> None:
    """full (2, states + constants) the derivatives."""
    by_constants = ctypes.c_void_p(full.ctypes.data + 8 * len(s))
    _call("sensed_otherwise", settings, c, s, push, predicted, full, by_constants, full.shape[1])
