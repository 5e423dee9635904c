"""Board mode: the board's own estimator closes the loop; the host permits it to, block by block, and watches.

For each block the host sends DRIVE_BOARD: without it the board's watchdog stops it. It permits a drive once its own
observer has acquired the motion and the levels are right. It observes the same samples with the drive that the board
echoes, as in gain mode, and records the board's estimates beside its own. Of the drive in samples that are missing it
knows nothing: its motion is acquired anew behind them.
"""

import ctypes
from collections.abc import Sequence

from hil.running.blocks import BlockLoop
from hil.running.board_estimates import BoardEstimates
from hil.running.native import Mode, PermitState
from hil.running.skeleton import Setup
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveBoard, Estimate, Message
from hil.wire.stream import unwrap

_BEYOND = 1  # of what is odd


class BoardLoop(BlockLoop):
    """One run in board mode; native/permit.h has its answer."""

    DRIVE = DriveBoard
    MODE = Mode.BOARD

    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._permit = PermitState(limit=int(setup.registers.get("DRIVE_LIMIT", self._drive_limit)))
        track = setup.tracks.get("board_estimates")
        self._said_by_it = None if track is None else BoardEstimates(setup.bench, setup.identity, track)
        self._beside: list[Message] = []  # messages that are no estimates, to be seen to

    def _bind(self) -> None:
        super()._bind()
        self._state.permit = ctypes.addressof(self._permit)

    def _odd(self) -> str:
        permit = self._permit
        shown = f"SENSE of tick {permit.odd_tick} shows a drive"
        if permit.odd == _BEYOND:
            return f"{shown} of {permit.odd_drive} codes, DRIVE_LIMIT is {permit.limit}"
        return f"{shown} that this host has not permitted"

    def _refused(self) -> str:
        raise AssertionError("board mode sends no drive")

    def _heard(self) -> None:
        """Judge what the board's estimator says: C has let the board go on with nothing that came with it."""
        for message in self._endpoint.said():
            if isinstance(message, Estimate):
                self._judge_estimate(message, self._endpoint.rx.tick)
            else:
                self._beside.append(message)

    def _judge_estimate(self, estimate: Estimate, near: int) -> None:
        """Record it. Raises ProtocolError where the board's estimator has failed."""
        if self._said_by_it is None:
            return
        wrong = self._said_by_it.take(unwrap(estimate.tick, near), estimate, driving=bool(self._permit.permitted))
        self.counters.estimates = self._said_by_it.count
        if wrong:
            raise ProtocolError(f"{self._name}: {wrong}")

    def _said(self) -> list[Message]:
        self._heard()
        said, self._beside = self._beside, []
        return said

    def _predict(self, missing: int, drive: Sequence[int]) -> bool:
        return False

    def _forget(self) -> None:
        """Nothing follows the motion but the observer."""

    def _begin_again(self) -> None:
        super()._begin_again()
        self._permit.permitted = 0
        if self._said_by_it is not None:
            self._said_by_it.begin_again()
