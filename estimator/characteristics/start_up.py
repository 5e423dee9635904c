"""Start-up time: from the record's first sample until the output is within its later scatter for as long again.

What comes later, as an answer to a step of the rate, is no start-up."""

import numpy as np

from estimator.characteristics.regression import Estimate, Floats

_SIGMAS = 4.0
FEWEST = 20


def start_up(t_s: Floats, error: Floats) -> Estimate | None:
    """`error` (n,) of the rate at t_s (n,), from the record's begin; None of a record too short."""
    if t_s.size < FEWEST:
        return None
    later = error[t_s.size // 2 :]
    about = float(np.median(later))
    scatter = 1.4826 * float(np.median(np.abs(later - about)))
    beyond = np.flatnonzero(np.abs(error[: t_s.size // 2] - about) > _SIGMAS * scatter)
    # Where the next one comes later than twice the time to this one, this one was the last of the start.
    pauses = np.append(beyond, t_s.size) > np.maximum(2 * np.append(0, beyond + 1), FEWEST)
    beyond = beyond[: int(np.argmax(pauses))]
    step = float(t_s[1] - t_s[0])
    if not beyond.size:
        return Estimate(0.0, 0.0, step, "settled from the first sample on")
    last = int(beyond[-1]) + 1
    at = float(t_s[last] - t_s[0])
    return Estimate(at, max(at - step, 0.0), at + step)
