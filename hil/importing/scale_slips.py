"""A scale that is wrong by a known slip between two sensors of one rate, such as a half or degrees for radians."""

import math
from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
import numpy.typing as npt

_SLIPS = {
    0.5: "half: one bit of the step, or two samples for one",
    2.0: "double: one bit of the step, or a rate for a step of half a second",
    0.25: "a quarter: two bits of the step",
    4.0: "four times: two bits of the step",
    math.pi / 180.0: "π/180: rad/s that are called deg/s",
    180.0 / math.pi: "180/π: deg/s that are called rad/s",
    -1.0: "the sign: an axis the other way about",
}
_NEAR, _ALIKE = 0.04, 0.9
"""How near a ratio is, and from which correlation on two channels are taken for one rate."""
_STILL = 1e-12
"""Of a rate: what it varies by less is rounding."""


def slips(rates: Mapping[str, npt.NDArray[np.float64]], reference: str | None) -> Iterator[str]:
    """A line for each pair of rates (n,) in rad/s on one time that differ by a known factor; against the reference
    alone, where there is one.
    """
    pairs = combinations(rates, 2) if reference is None else ((reference, name) for name in rates if name != reference)
    for first, second in pairs:
        a, b = rates[first] - rates[first].mean(), rates[second] - rates[second].mean()
        size_a, size_b = float(np.std(a)), float(np.std(b))
        still = any(size <= _STILL * np.abs(rates[name]).max() for name, size in ((first, size_a), (second, size_b)))
        if still or abs(likeness := float(np.mean(a * b)) / (size_a * size_b)) < _ALIKE:
            continue
        ratio = math.copysign(size_b / size_a, likeness)
        for factor, words in _SLIPS.items():
            if abs(ratio / factor - 1.0) <= _NEAR:
                whose = "the reference" if reference is not None else "one of the two scales is off"
                yield f"{second} is {ratio:.4g} times {first}: {words} ({whose})"
