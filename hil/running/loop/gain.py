"""Gain mode: the board closes the loop with a matrix, the host estimates blocks of samples and sends the next matrix.

A gap in the samples is bridged by what the board must have done.

Every matrix that was sent in gain mode since ARM, and which of them a SENSE may name.

A host that is late hears of a matrix long after it was sent: so the list is complete, however far the host lags.
docs/wire.md, "What a host does", has the rule; native/matrices.h judges by it.

Loops whose board computes the drive: samples come in blocks, which the host observes, answers and records.

The order of work, in C (native/blocks.h): receive, observe the block, judge its samples, answer it; then what hangs off
the loop.  Where blocks have piled up all of them are observed, and only the newest is answered.  Nothing is lost
without being counted: what the link did not take the board counts, what is missing between two ticks the host, which
marks the gap in the capture.
"""

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from estimator.core.layout import OUTPUT
from estimator.core.library import LIBRARY as CORE
from estimator.gain_board import GainBoard
from estimator.gain_matrix import GainMatrix
from hil.inputs.declared import board_dither_of, board_filter_of
from hil.running.loop.skeleton import Loop, Setup
from hil.running.loop.turn import address_of
from hil.running.native import LIBRARY, MOST_ROWS, NONE, BlocksState, GainsState, MatricesState, Mode
from hil.wire.messages import DriveGains, SafeReason


class BlockLoop(Loop):
    """One run in a mode of which samples come in blocks."""

    def __init__(self, setup: Setup) -> None:
        identity, bench, observer = setup.identity, setup.bench, setup.observer
        self._blocks = BlocksState(began=NONE)
        super().__init__(setup, self._blocks)
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        blocks, block = self._blocks, bench.loop.block
        blocks.rows = block
        blocks.every = bench.loop.estimate_every
        blocks.covariance_every = bench.loop.covariance_stride(self._rate_Hz) // block
        blocks.clip, blocks.saturation = 2 ** (identity.sense_bits - 1) - 1, self._drive_limit
        units = (*observer.volts, *[observer.scaling.drive] * 2)
        for column in range(4):
            blocks.code[column], blocks.unit[column] = self._scale[column], units[column]
        self._columns = np.zeros((2, MOST_ROWS, 2))  # z and u of a block
        self._outputs = np.zeros(MOST_ROWS, OUTPUT)

    def _bind(self) -> None:
        blocks = self._blocks
        blocks.z, blocks.u = (column.ctypes.data for column in self._columns)
        blocks.outputs = self._outputs.ctypes.data
        self._state.blocks = ctypes.addressof(blocks)

    def _close(self) -> None:
        super()._close()
        self._blocks.closed = 1

    def _begin_again(self) -> None:
        self._blocks.began = NONE


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
        self._gain_board = GainBoard(observer, board, self._drive_limit, board_dither_of(bench, identity))
        self._matrices = SentMatrices(block)
        self._gains = GainsState(lead=lead, horizon=lead + block + identity.latency_ticks)

    def _bind(self) -> None:
        super()._bind()
        gains = self._gains
        gains.solve, gains.folding = address_of(CORE.estimator_gains), self._matrix.address
        gains.gain, gains.bias = (part.ctypes.data for part in self._matrix.newest)
        gains.follow, gains.tell = address_of(CORE.estimator_board_follow), address_of(CORE.estimator_board_tell)
        gains.board = self._gain_board.address
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
        drives = self._gain_board.foresee(self._next, missing) * self._scale[2:]
        self._observer.run(np.full((missing, 2), math.nan), drives, every=missing)
        return bool(np.any(drives[-1])) == any(drive)

    def _forget(self) -> None:
        """It follows the board, not the motion."""

    def _begin_again(self) -> None:
        super()._begin_again()
        self._gain_board.arm()
        self._leave_open()
        self._matrices.forget()

    def finish(self, reason: SafeReason) -> None:
        """As of any loop; what is still to be seen of the last matrices is not."""
        super().finish(reason)
        self._leave_open()


NAMES = 255  # 1 to 255, given again and again
_UNNAMED, _UNSENT = 1, 2  # of what is odd
_ROOM = 1 << 12


class SentMatrices:
    """The k-th matrix since the start, from 0, is called k % 255 + 1.

    A board switches in the order in which matrices arrive, and computes with one from its effective tick on.  So what
    SENSE names must be one that was sent since ARM, not before the one in force, with an effective tick that has come.

    Attributes:
        state: what is known, for the turn in C.
    """

    def __init__(self, block: int) -> None:
        self.state = MatricesState(block=block, in_force=NONE)
        self._effective = np.zeros(0, np.int64)  # first tick that each is meant for
        self.make_room()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__

    def __setstate__(self, kept: dict[str, Any]) -> None:
        self.__dict__.update(kept)
        self.state.effective = self._effective.ctypes.data

    def make_room(self) -> None:
        if self.state.count == len(self._effective):
            self._effective = np.concatenate([self._effective, np.zeros(max(_ROOM, self.state.count), np.int64)])
            self.state.effective, self.state.room = self._effective.ctypes.data, len(self._effective)

    def sent(self, effective_tick: int) -> None:
        """The next one has left, for ticks from `effective_tick` on."""
        self.make_room()
        LIBRARY.matrices_sent(ctypes.byref(self.state), effective_tick)

    def forget(self) -> None:
        """The board was armed again: it has forgotten what was sent before."""
        LIBRARY.matrices_forget(ctypes.byref(self.state))

    def named(self, name: int, first: int, last: int) -> str:
        """SENSE with rows from tick `first` to `last` names a matrix; in words what is wrong with one a block before,
        "" if nothing is.

        The block in which a board stops by itself names none, and STATUS may come after it: so what cannot be is held
        against the board only with the next block.  On CAN a block comes in several SENSE, each with its name.
        """
        return self.odd if LIBRARY.matrices_named(ctypes.byref(self.state), name, first, last) else ""

    @property
    def odd(self) -> str:
        """In words what is wrong with a SENSE, "" if nothing is."""
        state = self.state
        if not state.odd:
            return ""
        if state.odd == _UNNAMED:
            told = f"names no matrix; {state.in_force % NAMES + 1} was in force"
        elif state.odd == _UNSENT:
            told = f"names matrix {state.odd_name}; {self._told()}"
        else:
            told = f"names matrix {state.odd_name}, which is for tick {state.odd_effective} and later"
        return f"SENSE of tick {state.odd_tick} {told}"

    def _told(self) -> str:
        state = self.state
        begin, count = state.odd_begin, state.odd_count - state.odd_begin
        if not count:
            return "none was sent since ARM"
        first, last = begin % NAMES + 1, (state.odd_count - 1) % NAMES + 1
        since = "since ARM" if state.in_force == NONE else f"from matrix {first}, which was in force, on"
        return f"{count} were sent {since}, the last is {last}"
