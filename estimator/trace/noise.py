"""How large a noise is."""

from collections.abc import Callable

MEDIAN_OF_SQUARE = 0.455
"""Of a standard normal number."""


def level(likelihood: Callable[[float], float], start: float, between: tuple[float, float], close: float) -> float:
    """The decade with the largest likelihood next to `start`, to within `close`: steps down first, then up, each that
    rises twice as long as the one before.
    """
    lowest, highest = between
    known = {start: likelihood(start)}
    best, step, failed = start, -close, 0
    while failed < 2:
        tried = min(max(best + step, lowest), highest)
        if tried not in known:
            known[tried] = likelihood(tried)
        if known[tried] > known[best]:
            best, step, failed = tried, 2.0 * step, 0
        elif abs(step) > close:
            step = close if step > 0.0 else -close
        else:
            step, failed = -step, failed + 1
    return best
