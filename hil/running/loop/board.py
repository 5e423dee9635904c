"""Board mode: the board's own estimator closes the loop; the host permits it to, block by block, and watches.

For each block the host sends DRIVE_BOARD: without it the board's watchdog stops it. It permits a drive once its own
observer has acquired the motion and the levels are right. It observes the same samples with the drive that the board
echoes, as in gain mode, and records the board's estimates beside its own. Of the drive in samples that are missing it
knows nothing: its motion is acquired anew behind them.
"""

import ctypes
import math
from collections.abc import Iterator, Sequence

from hil.bench import Bench
from hil.running.loop.gain import BlockLoop
from hil.running.loop.skeleton import Setup
from hil.running.native import Mode, PermitState
from hil.running.recording.recorder import Track
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveBoard, Estimate, EstimateFlags, Identity, Message
from hil.wire.stream import unwrap

_BEYOND = 1  # of what is odd


class BoardLoop(BlockLoop):
    """One run in board mode; native/blocks.h has its answer."""

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
            raise ProtocolError(f"{self._name}: {wrong}", "correct the board's estimator")

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


_SWING = 10.0  # times the declared amplitude that a position may be
_STIFF = 4.0  # times the target stiffness that a stiffness may be
_FIRST, _ANGLE = Estimate._fields.index("x"), Estimate._fields.index("angle")  # places in the message


class BoardEstimates:
    """Takes ESTIMATE messages of one run in their order.

    Attributes:
        count: how many were recorded.
    """

    def __init__(self, bench: Bench, identity: Identity, track: Track) -> None:
        self._track = track
        self._bounds = _bounds(bench, identity)
        self._settle_ticks = math.ceil(bench.loop.settle_s * identity.tick_rate_Hz)
        self._zero_tick: int | None = None  # known with the first estimate
        self._zero: float | None = None
        self._scored = False
        self._newest = -1
        self._angle = 0.0
        self.count = 0

    def begin_again(self) -> None:
        """The board was armed again, and its angle begins at its own zero: it goes on from the last one."""
        self._zero = None

    def take(self, tick: int, estimate: Estimate, *, driving: bool) -> str:
        """Judge and record the estimate of a tick (64 bits); what is wrong with it, "" for nothing.

        No number may be other than finite, and no deviation negative. Once the board drives by it, each has to be
        within what a device as declared can be.
        """
        if wrong := self._wrong(estimate, driving=driving):
            return f"the board's own estimate at tick {tick}: {wrong}"
        if tick <= self._newest:
            return ""  # said again, or from before a stop
        self._newest = tick
        if self._zero is None:
            self._zero = estimate.angle - self._angle
        if self._zero_tick is None:
            self._zero_tick = tick + self._settle_ticks
        if not self._scored and tick >= self._zero_tick:
            self._zero, self._scored = estimate.angle, True
        self._angle = estimate.angle - self._zero
        flags = EstimateFlags(estimate.flags)
        self._track.put(
            tick, *estimate[_FIRST:_ANGLE], *estimate[_ANGLE + 1 : -1], self._angle, estimate.sd_angle,
            EstimateFlags.VALID in flags, EstimateFlags.DRIVING in flags,
        )  # fmt: skip
        self.count += 1
        return ""

    def _wrong(self, estimate: Estimate, *, driving: bool) -> str:
        for name, value in zip(Estimate._fields[_FIRST:], estimate[_FIRST:], strict=True):
            if not math.isfinite(value):
                return f"{name} is {value}, which is no number"
            if name.startswith("sd_") and value < 0.0:
                return f"{name} is {value:g}, and no deviation is negative"
        if driving:
            for name, least, most, unit in self._bounds:
                value = getattr(estimate, name)
                if not least <= value <= most:
                    return f"{name} is {value:g} {unit}, out of {least:g} to {most:g} for the declared device"
        return ""


def _bounds(bench: Bench, identity: Identity) -> list[tuple[str, float, float, str]]:
    """(entry, least, most, unit): far beyond what a device as declared does, near enough to catch an estimator that is
    lost."""
    target = bench.target_stiffness_per_s2
    omega = math.sqrt(target)
    position = _SWING * bench.device.amplitude_m
    full_V = identity.sense_scale_V * 2 ** (identity.sense_bits - 1)
    return [*_each(("x", "y"), position, "m"), *_each(("vx", "vy"), omega * position, "m/s"),
            *_each(("phi_x", "phi_y"), full_V, "V"), *_each(("rate",), omega, "rad/s"),
            *_each(("kxx", "kyy", "kxy"), _STIFF * target, "1/s²"),
            *_each(("dxx", "dyy", "dxy"), 2.0 * omega, "1/s")]  # fmt: skip


def _each(names: tuple[str, ...], most: float, unit: str) -> Iterator[tuple[str, float, float, str]]:
    return ((name, -most, most, unit) for name in names)
