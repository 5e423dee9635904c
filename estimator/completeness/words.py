"""What a closing scan answers, in one line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.completeness.answer import Lacking
from estimator.written import plus_minus


@dataclass(frozen=True)
class Nearest:
    """The effect that explains most of a record, and not what is missing, so that its coefficients are those of
    something else; left: what it leaves, in words.
    """

    effect: str
    left: str


def in_words(
    lacks: Sequence[Lacking],
    harmless: Sequence[Sequence[Lacking]],
    left: Sequence[str],
    watched: int,
    nearest: Nearest | None = None,
) -> str:
    """Why the outcome is what it is, one line; what was found together is told together."""
    small = [_small(found) for found in harmless]
    if nearest is not None:
        missing = (
            f"something is missing that no effect explains by itself: {nearest.effect} comes nearest and leaves "
            f"{nearest.left}; hil trace tells"
        )
        return "; ".join([missing, *map(told, harmless)])
    if lacks:
        return "; ".join([told(lacks), *small])
    if left:
        beside = "beside what is harmless, the" if harmless else "the"
        return "; ".join([f"{beside} residual is explained by no effect known: {', '.join(left)}", *small])
    return "; ".join(small) or f"none of the {watched} effects tested is significant"


def told(found: Sequence[Lacking]) -> str:
    """What is lacking, in one line."""
    name, sizes = _name_and_sizes(found)
    return f"lacks {name}: {sizes}; the angle is off by up to {_off(found):.3g} rad"


def _small(found: Sequence[Lacking]) -> str:
    """What is there and harmless, in one line."""
    name, sizes = _name_and_sizes(found)
    return f"small effect found: {name}, negligible: {sizes}, {_off(found):.3g} rad of the angle"


def _off(found: Sequence[Lacking]) -> float:
    return float(np.sqrt(sum(item.angle.value**2 for item in found)))


def _name_and_sizes(found: Sequence[Lacking]) -> tuple[str, str]:
    if len(found) > 1:
        each = "; ".join(f"{item.effect} {_sizes(item)}" for item in found)
        return "the constants of the calibration together, each a little off", each
    item = found[0]
    like = f" (or {', '.join(item.alike)})" if item.alike else ""
    return f"{item.effect}{like}", _sizes(item)


def _sizes(item: Lacking) -> str:
    return ", ".join(
        f"{symbol} = {plus_minus(c.value, 0.5 * (c.high - c.low))}" + (f" {c.unit}" if c.unit != "1" else "")
        for symbol, c in item.coefficients.items()
    )
