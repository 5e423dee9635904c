"""The straight line that was fitted beside the one that the data sheet declares."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from estimator.diagnosis import Interval

_NEAR = 0.1  # relative: a ratio is taken for one that has a name
_NAMED = {
    1.0: "the sign of the reference, of the output or of the declared scale factor",
    180.0 / math.pi: "degrees for radians, or converted twice",
    60.0: "minutes for seconds",
    30.0 / math.pi: "rpm for rad/s",
    2.0: "one of two outputs, or peak to peak",
    1e3: "milli",
    1e6: "micro",
    180e3 / math.pi: "milli, and degrees for radians",
}
"""Ratios that a mistake makes, and the mistake."""


@dataclass(frozen=True)
class Line:
    """V = offset + scale Ω as declared, V and V·s/rad, each with how far a good sensor may be from it: the offset in
    volts, the scale as a fraction; unit: of the output, where it is not the volt.
    """

    offset: float
    scale: float
    offset_tolerance: float
    scale_tolerance: float
    unit: str = "V"


def against(base: Mapping[str, Interval], line: Line) -> tuple[str, ...]:
    """What of the fitted line, V0 and S, is not what is declared, a sentence each."""
    said = []
    offset, scale = base["V0"], base["S"]
    reach = line.scale_tolerance * abs(line.scale)
    if scale.high < line.scale - reach or scale.low > line.scale + reach:
        ratio = scale.value / line.scale
        said.append(
            f"the scale factor S comes out at {scale.value:.4g} {line.unit}·s/rad, {_times(ratio)} the declared "
            f"{line.scale:.4g}{_meant(ratio)}: correct the reference or the bench file"
        )
    reach, off = line.offset_tolerance, abs(offset.value - line.offset)
    if offset.high < line.offset - reach or offset.low > line.offset + reach:
        said.append(
            f"the offset V0 comes out at {offset.value:.4g} {line.unit}, {off:.3g} from the declared "
            f"{line.offset:.4g}, which may be off by {reach:.3g}: correct the bench file"
        )
    return tuple(said)


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times".replace("-", "−")


def _meant(ratio: float) -> str:
    """What makes such a ratio, where anything known does."""
    size = abs(ratio) if abs(ratio) >= 1.0 else 1.0 / abs(ratio) if ratio else math.inf
    named = next((what for one, what in _NAMED.items() if abs(size / one - 1.0) < _NEAR), None)
    if named is None or (size < 1.0 + _NEAR and ratio > 0.0):
        return ""
    return f" ({named}{', with the other sign' if ratio < 0.0 and size > 1.0 + _NEAR else ''}?)"
