"""Gain mode: the board closes the loop with a matrix, the host estimates blocks of samples and sends the next matrix.

A gap in the samples is bridged by what the board must have done.
"""

import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.foresight import Foresight
from estimator.gain_matrix import GainMatrix
from estimator.observer import Observer
from hil.bench import Bench
from hil.declared import board_dither_of, board_filter_of
from hil.loop.blocks import BlockLoop
from hil.loop.matrices import SentMatrices
from hil.loop.skeleton import NOTHING_WRITTEN
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.messages import DriveGains, Identity, SafeReason
from hil.wire.sense import Sense

_LATER = 64  # matrices whose effect is still to be seen
_RECENT = 16  # of those whose lateness the next is made for
_CAPTURE = np.dtype([("tick", "<i8"), ("codes", "<i4", 4), ("flags", "u1")])  # the capture's row, its codes as one


class _Sent(NamedTuple):
    """A row of the ledger, before it is known when the matrix came into force."""

    matrix_id: int
    effective_tick: int
    tick: int
    times_ns: tuple[int, int, int]  # received, estimated, sent


class GainLoop(BlockLoop):
    """One run in gain mode."""

    DRIVE = DriveGains

    def __init__(
        self,
        endpoint: Endpoint,
        identity: Identity,
        bench: Bench,
        observer: Observer,
        tracks: Mapping[str, Track],
        registers: Mapping[str, float] = NOTHING_WRITTEN,
    ) -> None:
        super().__init__(endpoint, identity, bench, observer, tracks, registers)
        block = bench.loop.block
        # A board that does not wait has gone on by up to a block when it hears: its next block is the first that a
        # matrix can be meant for from its beginning.
        self._lead = 1 if self._lockstep else block
        board = board_filter_of(bench)
        self._matrix = GainMatrix(observer, board)
        self._horizon = self._lead + block + identity.latency_ticks
        self._late: deque[int] = deque((0,), maxlen=_RECENT)  # ticks by which matrices came into force too late
        self._foresight = Foresight(observer, board, self._drive_limit, board_dither_of(bench, identity))
        self._sent: deque[_Sent] = deque(maxlen=_LATER)
        self._matrices = SentMatrices(block)

    def _contradicted(self, sense: Sense, first: int, last: int) -> str:
        return self._matrices.named(sense.matrix_id, first, last)

    def _follow(self, tick: int, codes: NDArray[np.int32]) -> None:
        self._foresight.follow(tick, codes)

    def _answer(self, last: int, received_ns: int, estimated_ns: int) -> int:
        """Solve for the matrix and send it, zeros while the loop is open."""
        gain, bias = self._matrix.solve(self._horizon + max(self._late), self._lead)
        if not self._closed:
            gain[:] = 0.0
            bias[:] = 0.0
        name, effective = self._matrices.next_name, last + self._lead
        matrix = DriveGains(name, tuple(gain.ravel().tolist()), tuple(bias.tolist()), effective)
        self._endpoint.send(matrix)
        sent_ns = time.monotonic_ns()
        self._matrices.sent(effective)
        self._foresight.tell(gain, bias, effective)
        if len(self._sent) == _LATER:
            self._close(self._sent.popleft(), -1)
        self._sent.append(_Sent(name, effective, last, (received_ns, estimated_ns, sent_ns)))
        return sent_ns

    def _account(self, tick: int, last: int, sense: Sense) -> None:
        """Close the accounts of the matrices that must have come into force by the end of a block."""
        while self._sent and self._sent[0].effective_tick <= last:
            sent = self._sent[0]
            applied = -1
            if sent.matrix_id == sense.matrix_id:
                applied = max(sent.effective_tick, tick)
                self._late.append(last - sent.effective_tick if tick > sent.effective_tick else 0)
            elif len(self._sent) == 1 or all(later.matrix_id != sense.matrix_id for later in self._sent):
                return  # late: it is still to come
            self._close(self._sent.popleft(), applied)

    def _close(self, sent: _Sent, applied: int) -> None:
        """Enter a matrix into the ledger, with the first tick computed with it, -1 where none was seen."""
        self._tracks["timing"].put(sent.tick, *sent.times_ns, applied)

    def _leave_open(self) -> None:
        """The effect of what was sent will not be seen any more."""
        while self._sent:
            self._close(self._sent.popleft(), -1)

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
