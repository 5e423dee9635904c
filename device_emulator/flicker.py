"""1/f noise: first-order processes a decade apart.

Of density F at 1 Hz, each has the variance F² ln 10; together they are F²/f within 6 % from 1 mHz to a quarter of the
sample rate. Sampling folds what lies above half the rate back; each variance is lowered so that the density below its
corner is that of the unsampled process.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_FLICKER_POLES = 12
_LOWEST_HZ = 1e-3

FLICKER = np.dtype(
    [
        ("poles", "i8"),
        ("rms", "f8", MAX_FLICKER_POLES),  # of each
        ("keep", "f8", MAX_FLICKER_POLES),
        ("add", "f8", MAX_FLICKER_POLES),
    ],
    align=True,
)


def flicker_constants(density_at_1Hz: float, rate_Hz: float) -> NDArray[Any]:
    """The processes as the kernels read them, shape (1,) of dtype `FLICKER`; none of no density."""
    constants = np.zeros(1, FLICKER)
    if density_at_1Hz <= 0.0:
        return constants
    c = constants[0]
    poles = min(MAX_FLICKER_POLES, 1 + math.ceil(math.log10(0.5 * rate_Hz / _LOWEST_HZ)))
    corner = 0.5 * rate_Hz * 10.0 ** -np.arange(poles)
    keep = np.exp(-2.0 * np.pi * corner / rate_Hz)
    fold = rate_Hz / (np.pi * corner) * (1.0 - keep) / (1.0 + keep)
    c["poles"] = poles
    c["rms"][:poles] = density_at_1Hz * np.sqrt(math.log(10.0) * fold)
    c["keep"][:poles] = keep
    c["add"] = c["rms"] * np.sqrt(1.0 - c["keep"] ** 2)
    return constants
