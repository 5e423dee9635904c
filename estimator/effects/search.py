"""How a trace looks for an effect, as its declaration says it."""

from enum import Enum


class Search(Enum):
    """Where a trace takes the values at which it watches an effect that has parameters; how many of them, and which
    shares, its thresholds say (`estimator.thresholds`).
    """

    CORNERS = "from one over the record's length to the resonance, the same in every parameter"
    LAGS = "from a sample to a cycle: at half a lag, the derivative by it tells what the whole of it does"
    SPEEDS = "shares of the largest velocity at the declared amplitude"
    LINES = "the strongest lines of the residual"
    LIMITS = "shares of the largest drive"
    BANDS = "shares of the rms drive"
    LEVELS = "shares of the largest displacement that is sensed"
    RINGS = "the lines that a free run leaves: the first two coefficients, a frequency and how fast it dies away"
    MODES = "where the residual follows the drive: a frequency, and the damping ratio seen there"
