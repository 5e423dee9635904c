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
from tests.estimator.gyro_loop import Array

_CORE = Path(__file__).parents[2] / "estimator" / "core"
ATTENTION = 0.05


class Constants(NamedTuple):
    intensity: Array
    prior: Array
    spread: Array
    initial: Array


class Estimate(NamedTuple):
    x: Array
    p: Array
    c: Array
    memory: Any


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
        places = np.zeros(9, np.int64)
        piece("p_places", places)
        size, push, *fields = places.tolist()
        self.buffer = np.zeros(size, np.uint8)
        piece("p_workspace", self.buffer, settings, n, total)
        self.push = ctypes.c_void_p(self.buffer.ctypes.data + push)
        shapes = ((2, n), (2, total), (n, 2), (2,), (2,), (2,), (2,))
        self.jacobian, self.full, self.gain, self.predicted, self.noise, self.innovation, self.variance = (
            self.buffer[at : at + 8 * int(np.prod(shape))].view(float).reshape(shape)
            for at, shape in zip(fields, shapes, strict=True)
        )


def workspace(settings: Any, n: int, total: int) -> Workspace:
    return Workspace(settings, n, total)


def pattern(s: Array, k: float, w: float, rate: float) -> tuple[float, float, float]:
    out = np.zeros(3)
    piece("p_pattern", np.ascontiguousarray(s), k, float(w), float(rate), out)
    return float(out[0]), float(out[1]), float(out[2])


def unwrap_half_turns(double: float, before: float) -> float:
    return float(piece("p_unwrap", float(double), float(before), result=ctypes.c_double))


def note_forced_rotation(settings: Any, memory: Any, x: Array, h: float) -> None:
    piece("p_note_forced", settings, memory, x, h)


def read_angle(settings: Any, memory: Any, x: Array, h: float, row: Any) -> None:
    piece("p_read_angle", settings, memory, x, h, row)


def note_gradient(settings: Any, memory: Any, s: Array) -> None:
    piece("p_note_gradient", settings, memory, s)


def refer_angle(settings: Any, memory: Any) -> bool:
    return bool(piece("p_refer", settings, memory, result=ctypes.c_int64))


def correct_angle(memory: Any, c: Array, h: Array, noise: Array, channels: int, gain: Array) -> None:
    piece("p_correct_angle", memory, c, len(c), h, noise, channels, gain)


def recall_angle(memory: Any, c: Array, row: int, gain: Array, noise: float) -> None:
    piece("p_recall_angle", memory, c, len(c), row, gain, noise)


def dither_force(memory: Any, amplitude: float) -> float:
    return float(piece("p_dither", memory, amplitude, result=ctypes.c_double))


def virtual_rate(settings: Any, time: float) -> float:
    return float(piece("p_virtual_rate", settings, float(time), result=ctypes.c_double))


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


def advance_queue(settings: Any, memory: Any, u: Array) -> None:
    piece("p_advance_queue", settings, memory, u)


def orbit(t: float, rotation: float, s: Array) -> None:
    piece("p_orbit", float(t), rotation, s)


def holding_force(c: Array, s: Array, rotation: float, u: Array) -> None:
    piece("p_holding", c, s, rotation, u)


def widened(p: Array) -> Array:
    """A covariance (n, n) with rows filled up to a multiple of four by zeros."""
    wide = np.zeros((len(p), -(-len(p) // 4) * 4))
    wide[:, : len(p)] = p
    return wide


def propagate(p: Array, g: Array, scratch: Array, factor: float) -> None:
    piece("p_propagate", p, len(g), p.shape[1], g, g.shape[1], scratch, factor)


def add_process_noise(
    p: Array, settings: Any, h: float, s: Array, active: Array, intensity: Array, jump: Array
) -> None:
    piece("p_process_noise", p, p.shape[1], settings, h, s, active, len(active), intensity, jump)


def kalman_gain(p: Array, h: Array, noise: Array, channels: int, nu: Array, gain: Array) -> float:
    return float(piece("p_kalman_gain", p, len(p), h, noise, channels, nu, gain, result=ctypes.c_double))


def joseph(p: Array, h: Array, noise: Array, channels: int, gain: Array) -> None:
    piece("p_joseph", p, len(p), h, noise, channels, gain)


def rank_one(p: Array, row: int, gain: Array, noise: float) -> None:
    piece("p_rank_one", p, len(p), row, gain, noise)


def measure_two(p: Array, memory: Any, work: Workspace) -> float:
    return float(piece("p_measure_two", p, len(p), p.shape[1], memory, work.buffer, result=ctypes.c_double))


def fading_factor(settings: Any, memory: Any) -> float:
    return float(piece("p_fading", settings, memory, result=ctypes.c_double))


def recall_initial(settings: Any, active: Array, index: int, initial: float, noise: float, estimate: Estimate) -> None:
    x, p, c, memory = estimate
    piece("p_recall_initial", settings, active, index, initial, noise, len(p), x, p, c, memory)


def remember_prior(settings: Any, active: Array, constants: Constants, estimate: Estimate) -> None:
    _, prior, spread, initial = constants
    x, p, c, memory = estimate
    piece("p_remember_prior", settings, active, len(active), prior, spread, initial, len(p), x, p, c, memory)


def add_correction(settings: Any, active: Array, gain: Array, nu: Array, x: Array) -> None:
    piece("p_add_correction", settings, active, len(gain), gain, nu, x)


def tabulated_gain(table: Array, s: Array, gain: Array) -> None:
    piece("p_tabulated", table, *table.shape[:3], np.ascontiguousarray(s), gain)


def runs_riccati(settings: Any, memory: Any) -> bool:
    return bool(piece("p_riccati", settings, memory, result=ctypes.c_int64))


def shift_drives(past: Array, u: Array) -> None:
    piece("p_shift_drives", past, u, u.shape[1])


def remember_drive(settings: Any, memory: Any, u: Array) -> None:
    piece("p_remember_drive", settings, memory, u)


def correct(
    settings: Any,
    active: Array,
    constants: Constants,
    table: Array,
    estimate: Estimate,
    sample: Sample,
    work: Workspace,
) -> None:
    x, p, c, memory = estimate
    piece(
        "p_correct", settings, active, len(active), *constants, table, *table.shape[:2], len(p), x, p, c, memory,
        *sample, work.buffer,
    )  # fmt: skip


def predict_measurement(settings: Any, active: Array, memory: Any, x: Array, sample: Sample, work: Workspace) -> bool:
    z, u, h = sample
    given = (settings, active, len(active), memory, x, z, u, u.shape[1], h, work.buffer)
    return bool(piece("p_predict_measurement", *given, result=ctypes.c_int64))
