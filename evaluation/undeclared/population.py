"""Which records there are, and what is hidden in each.

A record's seed is drawn from its name alone, so a larger population keeps the records of a smaller one.  The tracer was
developed on draws 1, 2 and 7; figures are of a draw that it had not been tried on.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from evaluation.undeclared.effects import DRAWABLE, NEVER, OUTSIDE

# Pairs of which each leaves a mark of its own: another line, another harmonic, another dependence.
PAIRS = (
    ("cubic_stiffness", "sense_gain"),
    ("cubic_isotropic", "drive_feedthrough"),
    ("quadratic_stiffness", "drive_gain"),
    ("sense_cubic", "interference"),
    ("sense_cross_coupling", "cubic_stiffness"),
    ("nonlinear_damping", "sense_quadratic"),
    ("dry_friction", "drive_feedthrough"),
    ("sense_gain", "drive_feedthrough"),
    ("base_vibration", "sense_cubic"),
    ("sense_delay", "cubic_stiffness"),
    ("sense_clipping", "drive_gain"),
    ("interference", "nonreciprocal_stiffness"),
)

DRAW = 11
"""The draw that figures are published of."""

SHARES = {"single": 0.44, "clean": 0.21, "calm": 0.11, "outside": 0.1, "double": 0.1, "never": 0.04}


@dataclass(frozen=True)
class Order:
    """One record to be made: a category, the effects that are hidden in it, and of which draw it is."""

    category: str
    effects: tuple[str, ...]
    number: int
    draw: int

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.category}-{'+'.join(self.effects) or 'none'}-{self.number:03d}"

    @property
    def seed(self) -> int:
        """From the draw and the name."""
        return zlib.crc32(f"{self.draw} {self.name}".encode())


def kinds(category: str) -> tuple[tuple[str, ...], ...]:
    """What is hidden in the records of a category, one after the other."""
    if category == "clean":
        return ((),)
    if category == "double":
        return PAIRS
    return tuple((name,) for name in {"outside": OUTSIDE, "never": NEVER}.get(category, DRAWABLE))


def population(n: int, draw: int = DRAW) -> list[Order]:
    """About n records, categories and kinds interleaved, so that the first of them are a fair sample."""
    ranked: list[tuple[float, Order]] = []
    for category, share in SHARES.items():
        wanted = max(round(n * share), 1)
        for i, order in zip(range(wanted), _orders(category, draw), strict=False):
            ranked.append(((i + 0.5) / wanted, order))
    return [order for _, order in sorted(ranked, key=lambda r: r[0])]


def _orders(category: str, draw: int) -> Iterator[Order]:
    number = 0
    while kinds(category):
        for effects in kinds(category):
            yield Order(category, effects, number, draw)
        number += 1
