"""Two lines as far above the vibration as below it: what modulates the vibration makes them, no two sources do."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from estimator.identification.problem import Effects
from estimator.record import Record
from estimator.residual.spectrum import summed_power


@dataclass(frozen=True)
class Sidebands:
    """Two effects whose lines lie `distance` [Hz] to either side of the vibration."""

    below: str
    above: str
    distance: float


def sidebands(record: Record, effects: Effects, names: Iterable[str]) -> tuple[Sidebands, ...]:
    """Pairs among the lines of these effects whose middle is the vibration, as nearly as a record of its length tells
    two frequencies apart.
    """
    lines = {name: effects[name]["omega"] / (2.0 * np.pi) for name in names if "omega" in effects[name]}
    if len(lines) < 2:
        return ()
    vibration, resolution = vibration_of(record), 1.0 / float(np.sum(record.step))
    found = []
    for below, above in combinations(sorted(lines, key=lambda name: lines[name]), 2):
        distance = (lines[above] - lines[below]) / 2.0
        if abs(lines[below] + distance - vibration) <= min(resolution, distance):
            found.append(Sidebands(below, above, distance))
    return tuple(found)


def vibration_of(record: Record) -> float:
    """Frequency [Hz] of the strongest line of what is sensed, between bins by the parabola through three logarithms."""
    power = summed_power(record.sense)
    peak = 1 + int(np.argmax(power[1:-1]))
    low, here, high = np.log(power[peak - 1 : peak + 2])
    shift = 0.5 * (low - high) / (low - 2.0 * here + high)
    return float((peak + shift) / np.sum(record.step))
