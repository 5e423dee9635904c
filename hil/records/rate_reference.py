"""Estimates beside the rate that a record has as a reference, integrated to the angle."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.capture import Capture
from hil.records.estimates import Estimates

Floats = npt.NDArray[np.float64]


class Compared(NamedTuple):
    """A stretch of the estimates beside their reference: rows (n,) of it where that is known, its rate and the integral
    of its rate there.
    """

    estimates: Estimates
    rows: npt.NDArray[np.intp]
    angle_rad: Floats
    rate_rad_s: Floats

    @property
    def t_s(self) -> Floats:
        """Bench time (n,)."""
        return self.estimates.t_s[self.rows]

    def estimated(self, column: str) -> Floats:
        """A column of the estimates (n,)."""
        return np.asarray(self.estimates[column][self.rows])


def beside_rate(capture: Capture, estimates: Estimates) -> Iterator[Compared]:
    """Part by part, angles from the first sample of the capture on; the rate is straight between its samples."""
    before: tuple[float, float, float] | None = None
    for piece in capture.pieces():
        rate, t_s = piece.rate_rad_s, piece.t_s
        assert rate is not None
        t_0, rate_0, angle_0 = before or (float(t_s[0]), float(rate[0]), 0.0)
        steps = np.diff(t_s, prepend=t_0) * (rate + np.concatenate([[rate_0], rate[:-1]])) / 2
        angle = angle_0 + np.cumsum(steps)
        before = float(t_s[-1]), float(rate[-1]), float(angle[-1])
        tick = piece.tick
        part = estimates.between(int(tick[0]), int(tick[-1]))
        _, rows, ours = np.intersect1d(part.tick, tick, assume_unique=True, return_indices=True)
        if rows.size:
            yield Compared(part, rows, angle[ours], rate[ours])


class Errors(NamedTuple):
    """Root mean squares from `settle_s` on: of the angle, whose error is zero there, and of the rate; None where the
    model has none, or the record no reference.
    """

    angle_rms_rad: float | None
    rate_rms_rad_s: float | None


def errors(capture: Capture | None, estimates: Estimates | None, settle_s: float) -> Errors:
    """Of the estimates beside the record's own reference."""
    if capture is None or estimates is None or not len(estimates) or capture.rate_rad_s is None:
        return Errors(None, None)
    angle, rate = _Squares(), _Squares()
    first = None
    for part in beside_rate(capture, estimates):
        scored = part.t_s >= settle_s
        if not scored.any():
            continue
        if "angle_rad" in part.estimates:
            off = (part.estimated("angle_rad") - part.angle_rad)[scored]
            first = float(off[0]) if first is None else first
            angle.add(off - first)
        if "rate_rad_s" in part.estimates:
            rate.add((part.estimated("rate_rad_s") - part.rate_rad_s)[scored])
    return Errors(angle.rms, rate.rms)


class _Squares:
    """A root mean square, gathered part by part."""

    def __init__(self) -> None:
        self._count, self._sum = 0, 0.0

    def add(self, values: Floats) -> None:
        self._count += values.size
        self._sum += float(np.sum(values**2))

    @property
    def rms(self) -> float | None:
        """None of nothing, and of what is not finite."""
        return math.sqrt(self._sum / self._count) if self._count and math.isfinite(self._sum) else None
