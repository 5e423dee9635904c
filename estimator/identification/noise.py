"""The level of a noise that makes a record most probable."""

from collections.abc import Callable

STEP = 2.0
"""Decades between the values first tried: the likelihood has one top, a few decades wide."""


def level(likelihood: Callable[[float], float], start: float, between: tuple[float, float], close: float) -> float:
    """The decade with the largest likelihood next to `start`, to within `close`: a search by halves."""
    known = {start: likelihood(start)}
    at, step = start, STEP
    while step >= close:
        for tried in (max(at - step, between[0]), min(at + step, between[1])):
            if tried not in known:
                known[tried] = likelihood(tried)
        best = max(known, key=lambda value: known[value])
        if best == at:
            step /= 2.0
        at = best
    return at
