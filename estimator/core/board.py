"""The law of a board in gain mode, on the host: what it did while nothing was heard of it (gain_board.h)."""

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.core.layout import Floats, Record
from estimator.core.library import LIBRARY

_ADDRESS, _COUNT = ctypes.c_void_p, ctypes.c_int64
LIBRARY.estimator_board_follow.argtypes = (_ADDRESS, _COUNT, _ADDRESS, _COUNT, _COUNT)
LIBRARY.estimator_board_tell.argtypes = (_ADDRESS, _ADDRESS, _ADDRESS, _COUNT)
LIBRARY.gyro_board_foresee.argtypes = (_ADDRESS, _ADDRESS, _ADDRESS, _COUNT, _COUNT, _ADDRESS)


def follow(board: Record, first: int, codes: NDArray[Any]) -> None:
    """Carry the board (1,) over rows that were received: codes (n, ≥ 2) begin with those sampled, from tick `first`."""
    rows = np.ascontiguousarray(codes, np.int32)
    LIBRARY.estimator_board_follow(board.ctypes.data, first, rows.ctypes.data, *rows.shape)


def tell(board: Record, gain: Floats, bias: Floats, effective_tick: int) -> None:
    """Send the board (1,) a matrix (2, 4) and a bias (2,), in force from `effective_tick` on."""
    LIBRARY.estimator_board_tell(
        board.ctypes.data, np.ascontiguousarray(gain).ctypes.data, np.ascontiguousarray(bias).ctypes.data,
        effective_tick,
    )  # fmt: skip


def foresee(settings: Record, board: Record, x: Floats, first: int, rows: int) -> Floats:
    """Carry the board (1,) over rows that were not, from tick `first` on, by what the model says it sampled.

    x is the state vector at the row before.  Returns the drive codes (rows, 2) over the interval that ends at each.
    """
    drives = np.zeros((rows, 2))
    LIBRARY.gyro_board_foresee(
        settings.ctypes.data, board.ctypes.data, x.ctypes.data, first, rows, drives.ctypes.data
    )  # fmt: skip
    return drives
