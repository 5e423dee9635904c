"""Board mode: the board's own estimator closes the loop; the host permits it to, block by block, and watches.

For each block the host sends DRIVE_BOARD: without it the board's watchdog stops it. It permits a drive once its own
observer has acquired the motion and the levels are right. It observes the same samples with the drive that the board
echoes, as in gain mode, and records the board's estimates beside its own. Of the drive in samples that are missing it
knows nothing: its motion is acquired anew behind them.
"""

import time
from collections.abc import Mapping, Sequence

from estimator.observer import Observer
from hil.bench import Bench
from hil.loop.blocks import BlockLoop
from hil.loop.board_estimates import BoardEstimates
from hil.loop.skeleton import NOTHING_WRITTEN
from hil.records.recorder import Track
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveBoard, Estimate, Identity, Message
from hil.wire.sense import Sense
from hil.wire.stream import Received, unwrap


class BoardLoop(BlockLoop):
    """One run in board mode."""

    DRIVE = DriveBoard

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
        self._permitted = False  # to drive, since it was armed
        track = tracks.get("board_estimates")
        self._said_by_it = None if track is None else BoardEstimates(bench, identity, track)
        self._limit = int(registers.get("DRIVE_LIMIT", self._drive_limit))

    def _answer(self, last: int, received_ns: int, estimated_ns: int) -> int:
        """Permit the board to go on, and to drive once the loop may be closed."""
        self._endpoint.send(DriveBoard(int(self._closed)))
        self._permitted = self._closed
        return time.monotonic_ns()

    def _contradicted(self, sense: Sense, first: int, last: int) -> str:
        drive = abs(sense.codes[:, 2:]).max()
        if drive > self._limit:
            return f"SENSE of tick {first} shows a drive of {drive} codes, DRIVE_LIMIT is {self._limit}"
        if drive and not self._permitted:
            return f"SENSE of tick {first} shows a drive that this host has not permitted"
        return ""

    def _hear(self, item: Received) -> None:
        if isinstance(item.message, Estimate):
            self._judge_estimate(item.message, item.tick)
        else:
            super()._hear(item)

    def _judge_estimate(self, estimate: Estimate, near: int) -> None:
        """Record it. Raises ProtocolError where the board's estimator has failed."""
        if self._said_by_it is None:
            return
        wrong = self._said_by_it.take(unwrap(estimate.tick, near), estimate, driving=self._permitted)
        self.counters.estimates = self._said_by_it.count
        if wrong:
            raise ProtocolError(f"{self._name}: {wrong}")

    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        return False

    def _said(self) -> list[Message]:
        said = super()._said()
        for message in said:
            if isinstance(message, Estimate):  # came with the answer to a request
                self._judge_estimate(message, self._endpoint.rx.tick)
        return [message for message in said if not isinstance(message, Estimate)]

    def _forget(self) -> None:
        """Nothing follows the motion but the observer."""

    def _begin_again(self) -> None:
        super()._begin_again()
        self._permitted = False
        if self._said_by_it is not None:
            self._said_by_it.begin_again()
