"""Gain mode: the board closes the loop with a matrix, the host estimates blocks of samples and sends the next matrix.

A gap in the samples is bridged by what the board must have done.
"""

import ctypes
import math
from collections.abc import Sequence

import numpy as np

from estimator.core.library import LIBRARY as CORE
from estimator.foresight import Foresight
from estimator.gain_matrix import GainMatrix
from hil.inputs.declared import board_dither_of, board_filter_of
from hil.running.blocks import BlockLoop
from hil.running.matrices import SentMatrices
from hil.running.native import LIBRARY, GainsState, Mode
from hil.running.skeleton import Setup
from hil.running.turn import address_of
from hil.wire.messages import DriveGains, SafeReason


class GainLoop(BlockLoop):
    """One run in gain mode; native/gains.h has its answer."""

    DRIVE = DriveGains
    MODE = Mode.GAIN

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        identity, bench, observer = setup.identity, setup.bench, setup.observer
        block = bench.loop.block
        # A board that does not wait has gone on by up to a block when it hears: its next block is the first that a
        # matrix can be meant for from its beginning.
        lead = 1 if self._lockstep else block
        board = board_filter_of(bench)
        self._matrix = GainMatrix(observer, board)
        self._foresight = Foresight(observer, board, self._drive_limit, board_dither_of(bench, identity))
        self._matrices = SentMatrices(block)
        self._gains = GainsState(lead=lead, horizon=lead + block + identity.latency_ticks)

    def _bind(self) -> None:
        super()._bind()
        gains = self._gains
        gains.solve, gains.folding = address_of(CORE.estimator_gains), self._matrix.address
        gains.gain, gains.bias = (part.ctypes.data for part in self._matrix.newest)
        gains.follow, gains.tell = address_of(CORE.estimator_board_follow), address_of(CORE.estimator_board_tell)
        gains.board = self._foresight.address
        gains.matrices = ctypes.addressof(self._matrices.state)
        self._state.gains = ctypes.addressof(gains)

    def _odd(self) -> str:
        return self._matrices.odd

    def _refused(self) -> str:
        return f"the control law gave a matrix with {self._state.refused[0]:g} in it, which no board takes"

    def _full(self) -> None:
        self._matrices.make_room()

    def _leave_open(self) -> None:
        """The effect of what was sent will not be seen any more."""
        if self._gains.count:
            self._c.lent(lambda: LIBRARY.turn_leave_open(ctypes.byref(self._state)))

    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        """By what the board must have driven; it drove, or did not, as it does at the sample at hand."""
        assert self._next is not None
        drives = self._foresight.foresee(self._next, missing) * self._scale[2:]
        self._observer.run(np.full((missing, 2), math.nan), drives, every=missing)
        return bool(np.any(drives[-1])) == any(drive)

    def _forget(self) -> None:
        """The foresight follows the board, not the motion."""

    def _begin_again(self) -> None:
        super()._begin_again()
        self._foresight.arm()
        self._leave_open()
        self._matrices.forget()

    def finish(self, reason: SafeReason) -> None:
        """As of any loop; what is still to be seen of the last matrices is not."""
        super().finish(reason)
        self._leave_open()
