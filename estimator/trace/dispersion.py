"""How sure a difference of two likelihoods is."""

import numpy as np

from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS


def dispersed(normalised: Array, other: Array) -> float:
    """By how much a difference of the likelihoods of two models is less sure than white innovations would make it;
    innovations (n, axes) of the better one and of the other, over their predicted deviations.

    With e = ν'/σ' − ν/σ, what the other predicts otherwise, the difference of twice the log-likelihood is Σ e² + 2 Σ e
    ν/σ.  The second sum is what noise makes; a quarter of its variance is Σ e² with white innovations, and by parts of
    the record, whatever they are, the sum of the squares of the parts (White, Econometrica 50(1), 1982).
    """
    one = np.nan_to_num(normalised)
    apart = np.nan_to_num(other) - one
    size = float(np.sum(apart**2))
    if not 0.0 < size < np.inf:
        return 1.0
    noise = np.sum(apart * one, axis=1)
    return float(sum(np.sum(part) ** 2 for part in np.array_split(noise, THRESHOLDS.scan.parts))) / size
