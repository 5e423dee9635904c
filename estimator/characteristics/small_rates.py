"""Threshold and dead zone: what the smallest rates that were given brought (IEEE Std 528: threshold, dead band).

Threshold: the least rate from which on the output is half of what it should be or more. Dead zone: the largest rate at
which it is less than a tenth.
"""

import numpy as np

from estimator.characteristics.rate_error import Levels
from estimator.characteristics.regression import Estimate

HALF, DEAD = 0.5, 0.1
_SURE = 0.25  # of what a rate should bring, to which its response has to be known
_SMALL = 0.05  # of the largest rate; larger ones say nothing of a threshold


def small_rates(levels: Levels | None) -> dict[str, Estimate]:
    """Both, as far as the record tells; nothing where no small rate was given long enough to be seen in the noise."""
    if levels is None:
        return {}
    size = np.abs(levels.rate)
    told = (size > 0.0) & (levels.half < _SURE * size)
    if not (told & (size <= _SMALL * size.max())).any():
        return {}
    order = np.argsort(size[told])
    rate, share = size[told][order], (levels.response[told] / levels.rate[told])[order]
    missed, dead = np.flatnonzero(share < HALF), np.flatnonzero(share < DEAD)
    first = int(missed[-1]) + 1 if missed.size else 0
    if first == rate.size:
        return {}
    below = float(rate[first - 1]) if first else 0.0
    found = {
        "threshold": Estimate(float(rate[first]), below, float(rate[first]), "" if first else "the least rate given")
    }
    if dead.size:
        last = int(dead[-1])
        found["dead_zone"] = Estimate(float(rate[last]), float(rate[last]), float(rate[min(last + 1, rate.size - 1)]))
    else:
        found["dead_zone"] = Estimate(0.0, 0.0, float(rate[0]), "none seen down to the least rate given")
    return found
