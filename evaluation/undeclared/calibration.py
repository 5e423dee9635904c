"""Whether stated probabilities hold: expected calibration error of a campaign.

A statement is a probability and whether what it was stated of was so.  Of all statements of about p, a share of p
should be so.  The expected calibration error is the mean distance of the two over the statements (Naeini, Cooper &
Hauskrecht, AAAI 2015).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from scipy.stats import beta

BINS = 10

Statement = tuple[float, bool]


@dataclass(frozen=True)
class Bin:
    """Statements of about the same probability: how many, the mean of what was stated, the share that was so, and the
    95 % interval of that share (Clopper and Pearson).
    """

    number: int
    stated: float
    so: float
    low: float
    high: float


@dataclass(frozen=True)
class Calibration:
    """number: of statements; error: expected calibration error, None without a statement; bins: those with any."""

    number: int
    error: float | None
    bins: tuple[Bin, ...]

    def written(self) -> dict[str, Any]:
        """As it goes into a file of figures."""
        return {"n": self.number, "error": self.error, "bins": [asdict(one) for one in self.bins]}


def calibration(statements: Iterable[Statement], bins: int = BINS) -> Calibration:
    """Of statements (probability, whether it was so), in bins of equal width.

    Raises ValueError for what is no probability.
    """
    sorted_in: dict[int, list[Statement]] = {}
    for probability, so in statements:
        if not 0.0 <= probability <= 1.0:
            raise ValueError(f"{probability} is no probability; give numbers from 0 to 1")
        sorted_in.setdefault(min(int(probability * bins), bins - 1), []).append((probability, so))
    found = tuple(_bin(inside) for _, inside in sorted(sorted_in.items()))
    number = sum(one.number for one in found)
    error = sum(one.number * abs(one.stated - one.so) for one in found) / number if number else None
    return Calibration(number, error, found)


def _bin(inside: Sequence[Statement]) -> Bin:
    number, right = len(inside), sum(so for _, so in inside)
    low = float(beta.ppf(0.025, right, number - right + 1)) if right else 0.0
    high = float(beta.ppf(0.975, right + 1, number - right)) if right < number else 1.0
    return Bin(number, math.fsum(stated for stated, _ in inside) / number, right / number, low, high)


def most_probable(entry: Mapping[str, Any], alike: Iterable[frozenset[str]]) -> tuple[frozenset[str], float]:
    """The account that an entry of `probabilities` in diagnosis.json calls the most probable, with all that the same
    diagnosis says the record does not tell from it (`alike`: sets of kinds), and the probability of them together.
    """
    classes = entry["classes"]
    top = max(classes, key=lambda name: classes[name])
    members = frozenset({top}).union(*(pair for pair in alike if top in pair))
    return members, min(math.fsum(classes.get(name, 0.0) for name in members), 1.0)
