"""Loops whose board computes the drive: samples come in blocks, which the host observes, answers and records.

The order of work: receive, observe the block, answer it; then what hangs off the loop.  Where blocks have piled up all
of them are observed, and only the newest is answered.  Nothing is lost without being counted: what the link did not
take the board counts, what is missing between two ticks the host, which marks the gap in the capture.  A mode adds what
its answer is, and what is to be expected of the board (`_answer`, `_contradicted`, `_follow`, `_account`).
"""

import time
from abc import abstractmethod
from collections import deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.observer import Estimates, Observer
from hil.bench import Bench
from hil.declared import drive_limit_of
from hil.loop.angle import ReportedAngle
from hil.loop.skeleton import NOTHING_WRITTEN, RESIDUAL_SAMPLES, Loop
from hil.loop.tracks import estimate_rows, innovation_rows, put_covariance, run_layouts
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import Identity, Message, SenseFlags
from hil.wire.sense import Sense
from hil.wire.stream import Received

_NEWS = 64  # messages beside samples, between two looks at them
_CAPTURE = np.dtype([("tick", "<i8"), ("codes", "<i4", 4), ("flags", "u1")])  # the capture's row, its codes as one


class BlockLoop(Loop):
    """One run in a mode of which samples come in blocks."""

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
        self._layouts = run_layouts(observer, bench, identity)
        self._scale = np.array([identity.sense_scale_V] * 2 + [identity.drive_scale_mps2] * 2)
        self._drive_limit = drive_limit_of(bench, identity)
        self._clip = 2 ** (identity.sense_bits - 1) - 1
        block = bench.loop.block
        self._stride = min(bench.loop.estimate_every, block)
        self._every_blocks = max(bench.loop.estimate_every // block, 1)
        self._covariance_blocks = bench.loop.covariance_stride(self._rate_Hz) // block
        self._closed = False
        self._reported = ReportedAngle(bench)
        self._noise_V = bench.device.sense.noise_V
        self._began: int | None = None  # tick of the first row since ARM, with which a block begins
        self._blocks = 0
        self._news: deque[Message] = deque(maxlen=_NEWS)  # beside samples, since it was last seen to

    @abstractmethod
    def _answer(self, last: int, received_ns: int, estimated_ns: int) -> int:
        """Answer the block that ends at tick `last`; when that had been sent, ns."""

    def _contradicted(self, sense: Sense, first: int, last: int) -> str:
        """What no board says, of a block from tick `first` to `last`; "" for nothing."""
        return ""

    def _follow(self, tick: int, codes: NDArray[np.int32]) -> None:
        """A block from `tick` on was observed."""

    def _account(self, tick: int, last: int, sense: Sense) -> None:
        """It was answered and recorded."""

    def _hear(self, item: Received) -> None:
        """Something that is no sample has come."""
        self._news.append(item.message)

    def _turn(self) -> int:
        listened_ns = time.monotonic_ns()
        items = self._endpoint.poll(self._slice_s)
        blocks = [item for item in items if isinstance(item.message, Sense)]
        if len(blocks) < len(items):
            for item in items:
                if not isinstance(item.message, Sense):
                    self._hear(item)
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
        # Rows from before the board was armed again tell of what it has forgotten.
        if not stale and (wrong := self._contradicted(sense, block.tick, last)):
            raise ProtocolError(f"{self._name}: {wrong}; correct its firmware")
        if self._waiting and self._may_close(block.tick - first):
            self._waiting, self._closed = False, True
            self._observer.enable_control(True)
        self._step_target(block.tick - first)
        si = codes * self._scale
        estimates = self._observer.run(si[:, :2], si[:, 2:], every=self._stride)
        if not stale:  # else from before it began anew
            self._follow(block.tick, codes)
        estimated_ns = time.monotonic_ns()
        if self._began is None:
            self._began = block.tick
        # On CAN a block comes in several messages, and a board in lockstep goes on by one for every answer.
        whole = not self._lockstep or (last + 1 - self._began) % self._block == 0
        if newest and whole:
            sent_ns = self._answer(last, received_ns, estimated_ns)
            self._drives += 1
            if sent_ns - self._answered_ns > self._suspicious_ns:
                self._answered(sent_ns)
            self._answered_ns = sent_ns
        self._keep(block.tick, sense, estimates)
        self._account(block.tick, last, sense)
        self._next = last + 1
        self._guard(estimates.innovation, last - first)
        if self._opening is not None:
            self._look(np.column_stack([np.arange(block.tick, last + 1), codes]).tolist())

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
            put_covariance(self._tracks["covariance"], int(ticks[-1]), self._observer.covariance)
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

    def _guard(self, innovation: NDArray[np.float64], since: int) -> None:
        """Stop the run when the residual leaves its bounds."""
        flat = innovation.ravel()
        mean = float(flat @ flat) / (len(flat) * self._noise_V**2)
        self._judge(mean, min(len(innovation) / RESIDUAL_SAMPLES, 1.0), since)

    def _said(self) -> list[Message]:
        said = [*self._news, *self._endpoint.said()]
        self._news.clear()
        return said

    def _begin_again(self) -> None:
        self._began = None
