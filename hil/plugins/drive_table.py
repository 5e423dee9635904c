"""A table of drives in the place of a plug-in, `FILE.npz`: an experiment that is planned before the board is armed.

Arrays of the file: `forces` (rows, 2) m/s²; `pieces` (rows,), numbers of parts of it, in order; `limit_V` (2,), sense
voltages beyond which the piece at work is not driven to its end.  As observer it estimates nothing.
"""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hil.errors import InputError
from hil.plugins import native
from hil.plugins.finding import Kind
from hil.plugins.native import PluginState
from hil.plugins.parts import PluginPart
from hil.plugins.protocol import DeclaredDevice

_SHAPES = {"forces": 2, "pieces": 1, "limit_V": 1}


class _Table(ctypes.Structure):
    """`drive_table_t`"""

    _fields_ = (
        ("forces", ctypes.c_void_p),
        ("pieces", ctypes.c_void_p),
        ("rows", ctypes.c_int64),
        ("limit_V", ctypes.c_double * 2),
        ("at", ctypes.c_int64),
        ("ended", ctypes.c_int64),
    )


class DriveTable(PluginPart):
    """Played by C, a row a sample from the one on with which the loop is closed."""

    size = ctypes.sizeof(_Table)

    def __init__(self, kinds: Sequence[Kind], name: str, path: Path) -> None:
        super().__init__(kinds, name)
        try:
            with np.load(path, allow_pickle=False) as file:
                given = {key: np.array(file[key], dtype=float) for key in _SHAPES}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            told = f"no array {error}" if isinstance(error, KeyError) else "no table of drives"
            raise InputError(f"{self.called}: {path}: {told}; expected forces, pieces and limit_V in an .npz") from None
        forces, pieces, limit = (given[key] for key in _SHAPES)
        if forces.ndim != 2 or forces.shape[1] != 2 or pieces.shape != forces.shape[:1] or limit.shape != (2,):
            raise InputError(f"{self.called}: {path}: expected forces (n, 2), pieces (n,) and limit_V (2,)")
        if not np.isfinite(forces).all() or not (limit > 0.0).all() or not np.isfinite(pieces).all():
            raise InputError(f"{self.called}: {path}: every force has to be finite, and limit_V above 0")
        self._forces: NDArray[np.float64] = np.ascontiguousarray(forces)
        self._pieces = np.ascontiguousarray(pieces, np.int32)
        self._limit = limit

    def address(self, kind: Kind) -> int:
        call = "drive_table_observe" if kind == "observer" else "drive_table_control"
        return ctypes.cast(getattr(native.library(), call), ctypes.c_void_p).value or 0

    def begin(self, state: PluginState, at: int, device: DeclaredDevice, names: Sequence[str]) -> None:
        if np.abs(self._forces).max(initial=0.0) > device.drive_limit_mps2 * (1.0 + 1e-9):
            most = np.abs(self._forces).max()
            raise InputError(f"{self.called}: it asks for {most:g} m/s², the limit is {device.drive_limit_mps2:g} m/s²")
        table = _Table(self._forces.ctypes.data, self._pieces.ctypes.data, len(self._forces))
        table.limit_V[:] = self._limit.tolist()
        table.ended = -1
        ctypes.memmove(state.lent[at].at, ctypes.byref(table), ctypes.sizeof(table))
