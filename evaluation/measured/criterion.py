"""What a number that a model has more must gain, and what chance gains: all in twice the log-likelihood."""

import math

import numpy as np

_CHANCE = 1e-4  # of naming anything on a record to which nothing is to be added
_ODDS = 20.0  # of two accounts of a record: what is less sure is not told apart

TIE = 2.0 * math.log(_ODDS)
"""The same as a difference of twice the log-likelihood."""


def threshold(candidates: int) -> float:
    """Significance (log10 of a probability) that chance reaches for none of so many candidates."""
    return float(-np.log10(_CHANCE / max(candidates, 1)))


def schwarz(numbers: int, samples: float) -> float:
    """Price of so many numbers that are fitted (Schwarz, Annals of Statistics 6(2), 1978)."""
    return numbers * math.log(samples)


def extended(numbers: int, samples: float, candidates: int) -> float:
    """The same where one of so many candidates is chosen (Chen & Chen, Biometrika 95(3), 2008)."""
    return schwarz(numbers, samples) + 2.0 * math.log(max(candidates, 1))
