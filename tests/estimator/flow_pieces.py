"""Functions of the flow one by one, as Python calls them: arrays are changed in place."""

import ctypes
from typing import Any

import numpy as np

from estimator.scaling import Array
from tests.estimator.core_pieces import STRUCTURES, piece

_PUSH, _FLOW_WORK = (STRUCTURES.row(name) for name in ("Push", "FlowWork"))


class Push:
    """What effects do: arrays that are live in `record`."""

    def __init__(self, states: int, constants: int, record: Any = None) -> None:
        self.record = np.zeros(1, _PUSH)[0] if record is None else record
        self.record["constants"] = constants
        self.force, self.drive, self.signals = (self.record[name] for name in ("force", "drive", "signals"))
        self.slips = self.record["slips"]
        self.by_states = self.record["by_states"][: 2 * states].reshape(2, states)
        self.by_constants = self.record["by_constants"][: 2 * constants].reshape(2, constants)


def _filled(columns: int) -> int:
    return columns if columns == 1 else -(-columns // 4) * 4


class FlowWork:
    """Scratch of a flow whose columns are so many, filled up to fours: arrays that are live in `record`."""

    def __init__(self, states: int, constants: int, columns: int) -> None:
        assert piece("flow_work_size", result=ctypes.c_int64, source="flow_pieces.c") == _FLOW_WORK.itemsize
        self.record = np.zeros(1, _FLOW_WORK)[0]
        self.record["columns"] = self.columns = _filled(columns)
        self.out = self.record["out"][: states * self.columns].reshape(states, -1)[:, :columns]
        self.push = Push(states, constants, self.record["push"])


class _Interval(ctypes.Structure):
    _fields_ = STRUCTURES.fields("Interval")


class Interval:
    """A stretch of time with its drive u (axes, terms)."""

    def __init__(self, time: float, h: float, u: Array) -> None:
        self.u = np.ascontiguousarray(u, float)
        self.record = np.frombuffer(_Interval(time, h, self.u.ctypes.data, self.u.shape[1]), np.uint8)


class _Way(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_double) for name in ("value", "by_value", "by_way", "by_reach"))


def _call(name: str, *given: Any, result: Any = None) -> Any:
    return piece(name, *(getattr(one, "record", one) for one in given), result=result, source="flow_pieces.c")


def slid(z: float, way: float, reach: float) -> tuple[float, float, float, float]:
    return _way("slid", z, way, reach)


def caught(s: float, way: float, width: float) -> tuple[float, float, float, float]:
    return _way("caught", s, way, width)


def _way(name: str, *numbers: float) -> tuple[float, float, float, float]:
    found = _call(name, *(float(one) for one in numbers), result=_Way)
    return found.value, found.by_value, found.by_way, found.by_reach


def signal_values(settings: Any, memory: Any, time: float, w: Array) -> None:
    _call("signal_values", settings, memory, float(time), w)


def advance_signals(settings: Any, memory: Any, c: Array, u: Array, h: float) -> None:
    _call("advance_signals", settings, memory, c, u, u.shape[1], float(h))


def flow(settings: Any, interval: Interval, past: Array, c: Array, s: Array, columns: int, work: FlowWork) -> None:
    _call("flow", settings, interval, past, c, s, 1 if columns == 1 else work.columns, work)


def taylor(model: int, c: Array, u: Array, h: float, order: int, columns: int, out: Array) -> None:
    filled = _filled(columns)
    wide = np.zeros((len(out), max(filled, out.shape[1])))
    wide[:, : out.shape[1]] = out
    _call("taylor", model, c, u, u.shape[1], float(h), order, filled, np.zeros_like(wide), wide, wide.shape[1])
    out[:] = wide[:, : out.shape[1]]


def senses_otherwise(settings: Any) -> bool:
    return bool(_call("senses_otherwise", settings, result=ctypes.c_int))


def sensed_at(settings: Any, c: Array, s: Array, push: Push, predicted: Array, full: Array) -> None:
    """full (2, states + constants) the derivatives."""
    _call("sensed_at", settings, c, s, push, full.shape[1], predicted, full)
