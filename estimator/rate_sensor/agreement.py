"""The straight line that was fitted beside the one that the data sheet declares."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from estimator.diagnosis import Interval
from estimator.written import significant


@dataclass(frozen=True)
class Line:
    """V = offset + scale Ω as declared, V and V·s/rad, each with how far a good sensor may be from it: the offset in
    volts, the scale as a fraction; unit: of the output, where it is not the volt; meant: what makes a ratio, in words,
    nothing where that is not known.
    """

    offset: float
    scale: float
    offset_tolerance: float
    scale_tolerance: float
    unit: str = "V"
    meant: Callable[[float], str] = lambda ratio: ""


def against(base: Mapping[str, Interval], line: Line) -> tuple[str, ...]:
    """What of the fitted line, V0 and S, is not what is declared, a sentence each."""
    said = []
    offset, scale = base["V0"], base["S"]
    reach = line.scale_tolerance * abs(line.scale)
    if scale.high < line.scale - reach or scale.low > line.scale + reach:
        ratio = scale.value / line.scale
        meant = ", ".join(word for word in ("the other sign" if ratio < 0.0 else "", line.meant(ratio)) if word)
        why = f" ({meant})" if meant else ""
        said.append(
            f"the scale factor S comes out at {significant(scale.value, 4)} {line.unit}·s/rad, {_times(ratio)} the "
            f"declared {significant(line.scale, 4)}{why}: correct the reference or the bench file"
        )
    reach, off = line.offset_tolerance, abs(offset.value - line.offset)
    if offset.high < line.offset - reach or offset.low > line.offset + reach:
        said.append(
            f"the offset V0 comes out at {significant(offset.value, 4)} {line.unit}, {off:.3g} from the declared "
            f"{significant(line.offset, 4)}, which may be off by {reach:.3g}: correct the bench file"
        )
    return tuple(said)


def _times(ratio: float) -> str:
    return f"{ratio:.3g} times".replace("-", "−")
