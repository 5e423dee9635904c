"""Start-up time: from the record's first sample until the output is within its later scatter for as long again.

The scatter is about the later median, or about the later line where the output settles to that sooner: a drift that
goes on is no start-up. Nor is what comes later, as an answer to a step of the rate."""

import numpy as np

from estimator.characteristics.regression import Estimate, Floats

_SIGMAS = 4.0
FEWEST = 20


def start_up(t_s: Floats, error: Floats) -> Estimate | None:
    """`error` (n,) of the rate at t_s (n,), from the record's begin; None of a record too short."""
    if t_s.size < FEWEST:
        return None
    half = t_s.size // 2
    line = np.polynomial.Polynomial.fit(t_s[half:], error[half:], 1)(t_s)
    last = min(_settled(error), _settled(error - line))
    step = float(t_s[1] - t_s[0])
    if not last:
        return Estimate(0.0, 0.0, step, "settled from the first sample on")
    at = float(t_s[last] - t_s[0])
    return Estimate(at, max(at - step, 0.0), at + step)


def _settled(error: Floats) -> int:
    """How many of `error` (n,) belong to the start."""
    half = error.size // 2
    about = float(np.median(error[half:]))
    scatter = 1.4826 * float(np.median(np.abs(error[half:] - about)))
    beyond = np.flatnonzero(np.abs(error[:half] - about) > _SIGMAS * scatter)
    # Where the next one comes later than twice the time to this one, this one was the last of the start.
    pauses = np.append(beyond, error.size) > np.maximum(2 * np.append(0, beyond + 1), FEWEST)
    beyond = beyond[: int(np.argmax(pauses))]
    return int(beyond[-1]) + 1 if beyond.size else 0
