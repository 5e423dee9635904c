"""Gain mode: the board closes the loop with a matrix, the host estimates blocks of samples and sends the next matrix.

The order of work: receive, observe the block, solve for the matrix, send it; then what hangs off the loop.  Where
blocks have piled up all of them are observed, and only the newest is answered.  Nothing is lost without being counted:
what the link did not take the board counts, what is missing between two ticks the host, which marks the gap in the
capture and bridges it by what the board must have done.
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
from estimator.observer import Estimates, Observer
from hil.bench import Bench
from hil.declared import board_dither_of, board_filter_of, drive_limit_of
from hil.loop.angle import ReportedAngle
from hil.loop.matrices import SentMatrices
from hil.loop.skeleton import RESIDUAL_SAMPLES, Loop
from hil.loop.tracks import estimate_rows, innovation_rows, put_covariance, run_layouts
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveGains, Identity, Message, SafeReason, SenseFlags
from hil.wire.sense import Sense
from hil.wire.stream import Received

_LATER = 64  # matrices whose effect is still to be seen
_RECENT = 16  # of those whose lateness the next is made for
_NOTHING_WRITTEN: Mapping[str, float] = {}
_CAPTURE = np.dtype([("tick", "<i8"), ("codes", "<i4", 4), ("flags", "u1")])  # the capture's row, its codes as one


class _Sent(NamedTuple):
    """A row of the ledger, before it is known when the matrix came into force."""

    matrix_id: int
    effective_tick: int
    tick: int
    times_ns: tuple[int, int, int]  # received, estimated, sent


class GainLoop(Loop):
    """One run in gain mode."""

    def __init__(
        self,
        endpoint: Endpoint,
        identity: Identity,
        bench: Bench,
        observer: Observer,
        tracks: Mapping[str, Track],
        registers: Mapping[str, float] = _NOTHING_WRITTEN,
    ) -> None:
        super().__init__(endpoint, identity, bench, observer, tracks, DriveGains, registers)
        self._layouts = run_layouts(observer, bench, identity)
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        self._drive_limit = drive_limit_of(bench, identity)
        self._clip = 2 ** (identity.sense_bits - 1) - 1
        block = bench.loop.block
        # A board that does not wait has gone on by up to a block when it hears: its next block is the first that a
        # matrix can be meant for from its beginning.
        self._lead = 1 if self._lockstep else block
        board = board_filter_of(bench)
        self._matrix = GainMatrix(observer, board)
        self._horizon = self._lead + block + identity.latency_ticks
        self._late: deque[int] = deque((0,), maxlen=_RECENT)  # ticks by which matrices came into force too late
        self._foresight = Foresight(observer, board, self._drive_limit, board_dither_of(bench, identity))
        self._stride = min(bench.loop.estimate_every, block)
        self._every_blocks = max(bench.loop.estimate_every // block, 1)
        self._covariance_blocks = bench.loop.covariance_stride(self._rate_Hz) // block
        self._closed = False
        self._reported = ReportedAngle(bench)
        self._noise_V = bench.device.sense.noise_V
        self._sent: deque[_Sent] = deque(maxlen=_LATER)
        self._matrices = SentMatrices(block)
        self._began: int | None = None  # tick of the first row since ARM, with which a block begins
        self._blocks = 0
        self._news: deque[Message] = deque(maxlen=_LATER)  # beside samples, since it was last seen to

    def _turn(self) -> int:
        listened_ns = time.monotonic_ns()
        items = self._endpoint.poll(self._slice_s)
        blocks = [item for item in items if isinstance(item.message, Sense)]
        if len(blocks) < len(items):
            self._news.extend(item.message for item in items if not isinstance(item.message, Sense))
        if not blocks:
            return 0
        self._turns += 1
        self._behind += self._endpoint.received_ns - listened_ns < self._at_once_ns
        if self._first is None:
            self._first = blocks[0].tick
        for block in blocks:
            self._take(block, self._first, newest=block is blocks[-1])
        assert self._next is not None
        return self._next - self._first

    def _take(self, block: Received, first: int, *, newest: bool) -> None:
        """Observe a block, answer it if it is the newest, record it."""
        sense = block.message
        assert isinstance(sense, Sense)
        codes, received_ns = sense.codes, self._endpoint.received_ns
        stale = self._stale(block.tick)
        self._bridge(block.tick, codes[0, 2:].tolist())
        last = block.tick + len(codes) - 1
        # Rows from before the board was armed again name what it has forgotten.
        if not stale and (wrong := self._matrices.named(sense.matrix_id, block.tick, last)):
            raise ProtocolError(f"{self._name}: {wrong}; correct its firmware")
        if self._waiting and self._may_close(block.tick - first):
            self._waiting, self._closed = False, True
            self._observer.enable_control(True)
        self._step_target(block.tick - first)
        si = codes * self._scale
        estimates = self._observer.run(si[:, :2], si[:, 2:], every=self._stride)
        if not stale:  # else from before it began anew
            self._foresight.follow(block.tick, codes)
        estimated_ns = time.monotonic_ns()
        if self._began is None:
            self._began = block.tick
        # On CAN a block comes in several messages, and a board in lockstep goes on by one for every answer.
        whole = not self._lockstep or (last + 1 - self._began) % self._block == 0
        if newest and whole:
            self._answer(last, received_ns, estimated_ns)
        self._keep(block.tick, sense, estimates)
        self._account(block.tick, last, sense.matrix_id)
        self._next = last + 1
        self._guard(estimates.innovation, last - first)
        if self._opening is not None:
            self._look(np.column_stack([np.arange(block.tick, last + 1), codes]).tolist())

    def _answer(self, last: int, received_ns: int, estimated_ns: int) -> None:
        """Solve for the matrix and send it, zeros while the loop is open."""
        gain, bias = self._matrix.solve(self._horizon + max(self._late), self._lead)
        if not self._closed:
            gain[:] = 0.0
            bias[:] = 0.0
        name, effective = self._matrices.next_name, last + self._lead
        matrix = DriveGains(name, tuple(gain.ravel().tolist()), tuple(bias.tolist()), effective)
        self._endpoint.send(matrix)
        self._drives += 1
        sent_ns = time.monotonic_ns()
        self._matrices.sent(effective)
        self._foresight.tell(gain, bias, effective)
        if sent_ns - self._answered_ns > self._suspicious_ns:
            self._answered(sent_ns)
        self._answered_ns = sent_ns
        if len(self._sent) == _LATER:
            self._close(self._sent.popleft(), -1)
        self._sent.append(_Sent(name, effective, last, (received_ns, estimated_ns, sent_ns)))

    def _keep(self, tick: int, sense: Sense, estimates: Estimates) -> None:
        """Everything that hangs off a block once it is answered."""
        codes, n = sense.codes, len(sense.codes)
        ticks = np.arange(tick, tick + n)
        capture = np.empty(n, _CAPTURE)
        capture["tick"] = ticks
        capture["codes"] = codes
        capture["flags"] = self._flags(sense)
        self._tracks["capture"].push(capture.view(self._layouts["capture"].dtype))
        self._tracks["innovation"].push(innovation_rows(self._layouts["innovation"], ticks, estimates))
        if self._blocks % self._every_blocks == self._every_blocks - 1:
            self._tracks["estimates"].push(estimate_rows(self._layouts["estimates"], ticks, estimates, self._reported))
        if self._blocks % self._covariance_blocks == self._covariance_blocks - 1:
            put_covariance(self._tracks["covariance"], int(ticks[-1]), self._observer)
        self._blocks += 1
        self.counters.samples += n

    def _flags(self, sense: Sense) -> NDArray[np.uint8] | int:
        """The block's flags at the rows they are about."""
        if not sense.flags:
            return 0
        size = np.abs(sense.codes)
        clipped = (size[:, :2] >= self._clip).any(axis=1)
        saturated = (size[:, 2:] >= self._drive_limit).any(axis=1)
        self.counters.clipped += int(np.count_nonzero(clipped))
        self.counters.saturated += int(np.count_nonzero(saturated))
        return np.asarray(clipped * SenseFlags.CLIPPED + saturated * SenseFlags.SATURATED, np.uint8)

    def _account(self, tick: int, last: int, matrix_id: int) -> None:
        """Close the accounts of the matrices that must have come into force by the end of a block."""
        while self._sent and self._sent[0].effective_tick <= last:
            sent = self._sent[0]
            applied = -1
            if sent.matrix_id == matrix_id:
                applied = max(sent.effective_tick, tick)
                self._late.append(last - sent.effective_tick if tick > sent.effective_tick else 0)
            elif len(self._sent) == 1 or all(later.matrix_id != matrix_id for later in self._sent):
                return  # late: it is still to come
            self._close(self._sent.popleft(), applied)

    def _close(self, sent: _Sent, applied: int) -> None:
        """Enter a matrix into the ledger, with the first tick computed with it, -1 where none was seen."""
        self._tracks["timing"].put(sent.tick, *sent.times_ns, applied)

    def _leave_open(self) -> None:
        """The effect of what was sent will not be seen any more."""
        while self._sent:
            self._close(self._sent.popleft(), -1)

    def _guard(self, innovation: NDArray[np.float64], since: int) -> None:
        """Stop the run when the residual leaves its bounds."""
        flat = innovation.ravel()
        mean = float(flat @ flat) / (len(flat) * self._noise_V**2)
        self._judge(mean, min(len(innovation) / RESIDUAL_SAMPLES, 1.0), since)

    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        """By what the board must have driven; it drove, or did not, as it does at the sample at hand."""
        assert self._next is not None
        drives = self._foresight.foresee(self._next, missing) * self._scale[2:]
        self._observer.run(np.full((missing, 2), math.nan), drives, every=missing)
        return bool(np.any(drives[-1])) == any(drive)

    def _said(self) -> list[Message]:
        said = [*self._news, *self._endpoint.said()]
        self._news.clear()
        return said

    def _forget(self) -> None:
        """The foresight follows the board, not the motion."""

    def _begin_again(self) -> None:
        self._foresight.arm()
        self._leave_open()
        self._began = None
        self._matrices.forget()

    def finish(self, reason: SafeReason) -> None:
        """As of any loop; what is still to be seen of the last matrices is not."""
        super().finish(reason)
        self._leave_open()
