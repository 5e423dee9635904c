"""Gain mode: the board closes the loop with a matrix, the host estimates blocks of samples and sends the next matrix.

The order of work: receive, observe the block, solve for the matrix, send it; then what hangs off the loop.  Where
blocks have piled up all of them are observed, and only the newest is answered.  Nothing is lost without being counted:
what the link did not take the board counts, what is missing between two ticks the host, which marks the gap in the
capture and bridges it by what the board must have done.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.foresight import Foresight
from estimator.gain_matrix import GainMatrix
from estimator.observer import Estimates, Observer
from hil.bench import Bench
from hil.declared import board_dither_of, board_filter_of, drive_limit_of
from hil.loop.armed import ArmedBoard
from hil.loop.force import Counters
from hil.loop.target import TargetSteps
from hil.loop.tracks import estimate_rows, innovation_rows, put_covariance, run_layouts
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveGains, Identity, Message, SafeReason, SenseFlags
from hil.wire.sense import Sense
from hil.wire.stream import Received

_RESIDUAL_SAMPLES = 200  # over which the residual is averaged before it may stop the run
_LONG_GAP_S = 0.05  # beyond which the phase of the vibration is taken as lost
_LATER = 64  # matrices whose effect is still to be seen
_RECENT = 16  # of those whose lateness the next is made for
_CAPTURE = np.dtype([("tick", "<i8"), ("codes", "<i4", 4), ("flags", "u1")])  # the capture's row, its codes as one


class _Sent(NamedTuple):
    """A row of the ledger, before it is known when the matrix came into force."""

    matrix_id: int
    effective_tick: int
    tick: int
    times_ns: tuple[int, int, int]  # received, estimated, sent


class GainLoop:
    """One run in gain mode with an armed board.

    Attributes:
        counters: kept up to date while the loop runs.
        between: called when something has come that is no sample, or nothing for a while.
        stop: set (from a signal handler) to end the loop after the block at hand.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        identity: Identity,
        bench: Bench,
        observer: Observer,
        tracks: Mapping[str, Track],
    ) -> None:
        self._endpoint = endpoint
        self._name = endpoint.link.name
        self._observer = observer
        self._tracks, self._layouts = tracks, run_layouts(observer, bench, identity)
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        self._drive_limit = drive_limit_of(bench, identity)
        self._clip = 2 ** (identity.sense_bits - 1) - 1
        rate, block, lockstep = identity.tick_rate_Hz, bench.loop.block, bench.loop.clock == "lockstep"
        # A board that does not wait has gone on by up to a block when it hears: its next block is the first that a
        # matrix can be meant for from its beginning.
        self._lead = 1 if lockstep else block
        board = board_filter_of(bench)
        self._matrix = GainMatrix(observer, board)
        self._reign = self._lead + block + identity.latency_ticks
        self._late: deque[int] = deque((0,), maxlen=_RECENT)  # ticks by which matrices came into force too late
        self._foresight = Foresight(observer, board, self._drive_limit, board_dither_of(bench, identity))
        self._stride = min(bench.loop.estimate_every, block)
        self._every_blocks = max(bench.loop.estimate_every // block, 1)
        self._covariance_blocks = bench.loop.covariance_stride(rate) // block
        self._waiting = bench.controller.enabled  # to close the loop
        self._closed = False
        self._acquired = math.ceil(bench.observer.acquisition_s * rate)
        self._step_target = TargetSteps(observer, bench)
        self._long_gap = max(round(_LONG_GAP_S * rate), 2)
        self._silence_s = bench.link.timeout_s
        patient = lockstep and endpoint.link.fileno() is not None
        self._board = ArmedBoard(endpoint, DriveGains, self._silence_s, patient=patient)
        self._limits = bench.limits
        self._noise_V = bench.device.sense.noise_V
        self._sent: deque[_Sent] = deque(maxlen=_LATER)
        self._matrix_id = 0
        self._blocks = 0
        self._next: int | None = None
        self._phase_lost = False
        self._said: deque[Message] = deque(maxlen=_LATER)  # beside samples, since it was last seen to
        self._residual = 1.0
        self._guarded = 0  # sample from which the residual may stop the run
        self.counters = Counters()
        self.between: Callable[[], None] = lambda: None
        self.stop = False

    def run(self, samples: int, report: Callable[[int], None], report_every: int) -> None:
        """Answer `samples` samples (their ticks, gaps included); `report` is told how many are done.

        Raises LinkClosed when the board hangs up, ProtocolError when it falls silent or will not stay armed.
        """
        endpoint = self._endpoint
        self._observer.enable_control(False)
        self._guarded = self._acquired + _RESIDUAL_SAMPLES
        first: int | None = None
        done = reported = 0
        while done < samples and not self.stop:
            items = endpoint.poll(self._silence_s)
            blocks = [item for item in items if isinstance(item.message, Sense)]
            self._said.extend(item.message for item in items)
            if not blocks:
                self._attend()
                continue
            if first is None:
                first = blocks[0].tick
            for block in blocks:
                done = self._take(block, first, newest=block is blocks[-1])
            if done - reported >= report_every:
                reported = done
                report(done)

    def finish(self, reason: SafeReason) -> None:
        """SAFE, and the board's own counters."""
        self.counters.board = self._board.farewell(reason)
        self._leave_open()

    def _take(self, block: Received, first: int, *, newest: bool) -> int:
        """Observe a block, answer it if it is the newest, record it; returns how many ticks are done."""
        sense = block.message
        assert isinstance(sense, Sense)
        codes, received_ns = sense.codes, self._endpoint.received_ns
        self._bridge(block.tick)
        if self._waiting and block.tick - first >= self._acquired:
            self._waiting, self._closed = False, True
            self._observer.enable_control(True)
        self._step_target(block.tick - first)
        si = codes * self._scale
        estimates = self._observer.run(si[:, :2], si[:, 2:], every=self._stride)
        self._foresight.follow(block.tick, codes)
        estimated_ns = time.monotonic_ns()
        last = block.tick + len(codes) - 1
        if newest:
            self._answer(last, received_ns, estimated_ns)
        self._keep(block.tick, sense, estimates)
        self._account(block.tick, last, sense.matrix_id)
        self._next = last + 1
        self._guard(estimates.innovation, last - first)
        return last - first + 1

    def _answer(self, last: int, received_ns: int, estimated_ns: int) -> None:
        """Solve for the matrix and send it, zeros while the loop is open."""
        gain, bias = self._matrix.solve(self._reign + max(self._late))
        if not self._closed:
            gain[:] = 0.0
            bias[:] = 0.0
        self._matrix_id = self._matrix_id % 255 + 1
        effective = last + self._lead
        matrix = DriveGains(self._matrix_id, tuple(gain.ravel().tolist()), tuple(bias.tolist()), effective)
        self._endpoint.send(matrix)
        sent_ns = time.monotonic_ns()
        self._foresight.tell(gain, bias, effective)
        if len(self._sent) == _LATER:
            self._close(self._sent.popleft(), -1)
        self._sent.append(_Sent(self._matrix_id, effective, last, (received_ns, estimated_ns, sent_ns)))

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
            self._tracks["estimates"].push(estimate_rows(self._layouts["estimates"], ticks, estimates, self._limits))
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
        self._residual += (mean - self._residual) * min(len(innovation) / _RESIDUAL_SAMPLES, 1.0)
        within = self._residual <= self._limits.residual_safe**2  # which NaN is not
        if since >= self._guarded and not within:
            self.counters.residual_safe += 1
            self.stop = True

    def _bridge(self, tick: int) -> None:
        """Predict over samples that never came, by what the board must have driven."""
        missing = 0 if self._next is None else tick - self._next
        if missing < 0:
            raise ProtocolError(
                f"{self._name}: the board's tick went back from {tick - missing - 1} to {tick}; did it restart?"
            )
        lost, self._phase_lost = self._phase_lost, False
        self.counters.lost += missing
        self.counters.stopped += missing if lost else 0
        if missing > self._long_gap or lost:
            self._observer.lose_phase(missing)
            self._guarded = self.counters.samples + self.counters.lost + _RESIDUAL_SAMPLES
            self._residual = 1.0
        elif missing > 0:
            drives = self._foresight.foresee(tick - missing, missing) * self._scale[2:]
            self._observer.run(np.full((missing, 2), math.nan), drives, every=missing)

    def _attend(self) -> None:
        """No sample came: see to the board."""
        said = list(self._said)
        self._said.clear()
        if self._board.attend(said):
            self.counters.rearmed += 1
            self._phase_lost = True
            self._foresight.arm()
            self._leave_open()
        self.between()
