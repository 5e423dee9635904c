"""How unlikely by chance, in standard deviations, from logarithms of probabilities that no float could hold."""

import math

import numpy as np
from scipy.special import log1p, ndtri_exp


def deviations(log_p: float) -> float:
    """Standard deviations of a normal variable beyond which probability exp(log_p) is left; at least 0."""
    return max(0.0, -float(ndtri_exp(log_p)))


def of_many(log_p: float, tries: int) -> float:
    """Logarithm of the probability that the best of so many independent tries is that good by chance (Šidák)."""
    if log_p < -30.0:  # there 1 − (1 − p)ⁿ is n p to all digits
        return min(0.0, log_p + math.log(tries))
    return float(np.log(-np.expm1(tries * log1p(-min(math.exp(log_p), 1.0)))))
