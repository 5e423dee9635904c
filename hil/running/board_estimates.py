"""What a board says that its own estimator estimates: believed where a device as declared can be so, and recorded."""

import math
from collections.abc import Iterator

from hil.bench import Bench
from hil.running.recorder import Track
from hil.wire.messages import Estimate, EstimateFlags, Identity

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
            return f"the board's own estimate at tick {tick}: {wrong}; correct its estimator"
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
