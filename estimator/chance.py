"""Chi-square and F by the functions they are made of: `scipy.stats` loads for half a second, and every run ends here.

Abramowitz & Stegun, Handbook of Mathematical Functions (1964), 26.4.19 and 26.6.2.
"""

from scipy.special import betaincinv, gammaincc, gammainccinv

TWO_SIDED = 1.959963984540054
"""Standard deviations to either side of a normal distribution's mean that hold 95 %."""


def chi2_sf(statistic: float, freedom: float) -> float:
    """Probability that a chi-square of that freedom is larger."""
    return float(gammaincc(0.5 * freedom, 0.5 * statistic))


def chi2_isf(probability: float, freedom: float) -> float:
    """What a chi-square of that freedom exceeds with that probability."""
    return float(2.0 * gammainccinv(0.5 * freedom, probability))


def f_isf(probability: float, over: float, under: float) -> float:
    """What a ratio of two mean squares of those freedoms exceeds with that probability."""
    share = float(betaincinv(0.5 * under, 0.5 * over, probability))
    return under * (1.0 - share) / (over * share)
