"""Functions of the core's headers one by one, as Python calls them: arrays are changed in place.

They are compiled from `core_pieces.c` when the first test asks for them, and kept by the content of the headers.
"""

import ctypes
import hashlib
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from estimator.core.compiler import WARNINGS, compile_library
from estimator.core.declared import Header
from tests.estimator.gyro_loop import Array

_CORE = Path(__file__).parents[2] / "estimator" / "core"
STRUCTURES = Header(_CORE / "structs.h", Header(_CORE / "layout.h", {}).numbers)


class Sample(NamedTuple):
    z: Array
    u: Array
    h: float


@cache
def built(name: str) -> ctypes.CDLL:
    """The library of a source beside this file."""
    source = Path(__file__).with_name(name)
    digest = hashlib.sha256()
    for path in (source, *sorted(_CORE.glob("*.h"))):
        digest.update(path.read_bytes())
    library = Path(tempfile.gettempdir()) / f"gyrohil-pieces-{digest.hexdigest()[:16]}.so"
    if not library.exists():
        compile_library([source], library, (*WARNINGS, f"-I{_CORE}"))
    return ctypes.CDLL(str(library))


def piece(name: str, *given: Any, result: Any = None, source: str = "core_pieces.c") -> Any:
    """Call one: arrays and records by their addresses, whole numbers and others as C takes them."""
    function = built(source)[name]
    function.restype = result
    return function(*(_argument(one) for one in given))


def _argument(one: Any) -> Any:
    if isinstance(one, np.ndarray | np.void):
        array = np.asarray(one)
        assert array.flags.c_contiguous
        return ctypes.c_void_p(array.ctypes.data)
    if isinstance(one, bool | int | np.integer):
        return ctypes.c_int64(int(one))
    return one if isinstance(one, ctypes.c_void_p) else ctypes.c_double(float(one))


class Workspace:
    """Scratch of one observer of n states and active constants, `total` with all constants; arrays are live."""

    def __init__(self, settings: Any, n: int, total: int) -> None:
        self.buffer = np.zeros(1, STRUCTURES.row("Workspace"))[0]
        size = piece("p_workspace", self.buffer, settings, n, result=ctypes.c_int64)
        assert size == self.buffer.nbytes
        self.push = self.buffer["flow"]["push"]
        self.jacobian, self.full, self.gain = (
            self.buffer[name][: 2 * size].reshape(shape)
            for name, size, shape in (("jacobian", n, (2, n)), ("full", total, (2, total)), ("gain", n, (n, 2)))
        )
        self.predicted, self.noise, self.innovation, self.variance = (
            self.buffer[name] for name in ("predicted", "noise", "innovation", "variance")
        )


def workspace(settings: Any, n: int, total: int) -> Workspace:
    return Workspace(settings, n, total)


def pattern(s: Array, k: float, w: float, rate: float) -> tuple[float, float, float]:
    out = np.zeros(3)
    piece("p_pattern", np.ascontiguousarray(s), k, float(w), float(rate), out)
    return float(out[0]), float(out[1]), float(out[2])


def unwrap_half_turns(double: float, before: float) -> float:
    return float(piece("p_unwrap", float(double), float(before), result=ctypes.c_double))


def correct_angle(memory: Any, c: Array, h: Array, noise: Array, channels: int, gain: Array) -> None:
    piece("p_correct_angle", memory, c, len(c), h, noise, channels, gain)


def recall_angle(memory: Any, c: Array, row: int, gain: Array, noise: float) -> None:
    piece("p_recall_angle", memory, c, len(c), row, gain, noise)


def acting(settings: Any, memory: Any) -> float:
    return float(piece("p_acting", settings, memory, result=ctypes.c_double))


def holds(settings: Any, memory: Any, s: Array, rate: float, w: float, fastest: float) -> tuple[float, float]:
    out = np.zeros(2)
    piece("p_holds", settings, memory, s, float(rate), float(w), float(fastest), out)
    return float(out[0]), float(out[1])


def control_law(settings: Any, memory: Any, s: Array, c: Array, out: Array) -> None:
    piece("p_control_law", settings, memory, s, c, out)


def undo_effects(settings: Any, c: Array, s: Array, work: Workspace, force: Array) -> None:
    piece("p_undo", settings, c, s, work.push, force)


def command(settings: Any, memory: Any, x: Array, work: Workspace, out: Array) -> None:
    piece("p_command", settings, memory, x, work.buffer, out)


def predict_measurement(settings: Any, active: Array, memory: Any, x: Array, sample: Sample, work: Workspace) -> bool:
    z, u, h = sample
    given = (settings, active, len(active), memory, x, z, u, u.shape[1], h, work.buffer)
    return bool(piece("p_predict_measurement", *given, result=ctypes.c_int64))
