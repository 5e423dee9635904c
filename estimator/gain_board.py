"""Bridging a gap in gain mode: the board went on driving, and what it drove follows from what it was told to do."""

import numpy as np
from numpy.typing import NDArray

from estimator.core.board import follow, foresee, tell
from estimator.core.layout import BOARD
from estimator.gain_matrix import BoardFilter
from estimator.observer import Observer
from estimator.scaling import Array


class GainBoard:
    """A board in gain mode, carried along on the host by what it sampled, or must have sampled.

    `limit` is its largest drive code, `dither` (amplitude in drive codes, start of the shift register) what it adds.
    """

    def __init__(self, observer: Observer, board: BoardFilter, limit: int, dither: tuple[int, int]) -> None:
        self._observer = observer
        self._seed = dither[1]
        self._board = np.zeros(1, BOARD)
        self._board["a"] = board.a
        self._board["b"] = board.b
        self._board["c"] = board.c
        self._board["delay"] = board.delay
        self._board["latency"] = observer.latency
        self._board["limit"] = limit
        self._board["dither"] = dither[0]
        self.arm()

    @property
    def address(self) -> int:
        """Of the board's record, for a caller in C (`estimator_board_follow`, `estimator_board_tell`)."""
        return int(self._board.ctypes.data)

    def arm(self) -> None:
        """The board starts anew, without a matrix."""
        board = self._board
        for name in ("s", "past", "queue", "closed", "waiting"):
            board[name] = 0
        board["shift"] = self._seed

    def tell(self, gain: Array, bias: Array, effective_tick: int) -> None:
        """A matrix was sent, in force from `effective_tick` on."""
        tell(self._board, gain, bias, effective_tick)

    def follow(self, first: int, codes: NDArray[np.int32]) -> None:
        """Rows that were received, from tick `first` on; codes (n, ≥ 2) begin with those sampled."""
        follow(self._board, first, codes)

    def foresee(self, first: int, missing: int) -> Array:
        """Drive codes (missing, 2) of the rows from tick `first` on, which follow the observer's newest."""
        arrays = self._observer.arrays
        return foresee(arrays.settings, self._board, arrays.x, first, missing)
