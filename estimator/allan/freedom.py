"""How many degrees of freedom an overlapping Allan variance has, and which noise it is of.

Equivalent degrees of freedom: Greenhall & Riley, "Uncertainty of stability variances based on finite differences",
PTTI 2003. Noise type: Riley & Greenhall, "Power law noise identification using the lag 1 autocorrelation", EFTF 2004.
Both number a noise by α, the power of frequency in the density of the rate.
"""

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

LEAST_POINTS = 128
"""Points of the angle from which a noise is told: of white noise fewer than one in a hundred is mistaken."""

_D = 2  # differences in an Allan variance
_BINOMIAL = (6.0, -4.0, 1.0)
_MOST_TERMS = 100  # of the sum; beyond, the asymptote of the paper
_TABLE_2 = {1: (790.0, 410.0), 0: (2.0 / 3.0, 1.0 / 3.0), -1: (0.852, 0.375), -2: (1.079, 0.368)}
_TABLE_3 = (15.23, 12.0)


def degrees_of_freedom(alpha: int, m: int, points: int) -> float:
    """Of the Allan variance at m points of the angle per cluster, at every place of `points` points; of the paper's
    variances the unmodified ones with d = 2 and stride 1.
    """
    places = points - 2 * m
    r = places / m
    if alpha == 2:
        seen = min(_D, math.ceil(r) - 1)
        ratios = ((_BINOMIAL[k] / _BINOMIAL[0]) ** 2 * (1.0 - k / r) for k in range(1, seen + 1))
        return places / (1.0 + 2.0 * sum(ratios))
    terms = min(places, (_D + 1) * m)
    if terms <= _MOST_TERMS:
        wide = float(m) if alpha == 1 or m * (_D + 1) <= _MOST_TERMS else math.inf
        return 1.0 / _sum(terms, places, m, wide, alpha)
    if r > _D + 1:
        a0, a1 = _TABLE_2[alpha]
        scale = (_TABLE_3[0] + _TABLE_3[1] * math.log(m)) ** 2 if alpha == 1 else 1.0
        return scale * r / (a0 - a1 / r)
    stride = _MOST_TERMS / r
    if alpha == 1:
        plain = _sum(_MOST_TERMS, _MOST_TERMS, stride, stride, 1) * float(_z(np.zeros(1), stride, 1)[0]) ** 2
        return float((_TABLE_3[0] + _TABLE_3[1] * math.log(m)) ** 2 / plain)
    return 1.0 / _sum(_MOST_TERMS, _MOST_TERMS, stride, math.inf, alpha)


def _sum(terms: int, places: float, stride: float, wide: float, alpha: int) -> float:
    """One over the degrees of freedom, as the paper's equation (10) has it."""
    lag = np.arange(terms + 1)
    weight = 2.0 * (1.0 - lag / places)
    weight[0], weight[-1] = 1.0, 0.5 * weight[-1]
    z = _z(lag / stride, wide, alpha)
    return float(np.sum(weight * z**2) / (z[0] ** 2 * places))


def _z(t: Floats, wide: float, alpha: int) -> Floats:
    """Generalised autocovariance of the second differences at lag t, equation (9)."""
    at = [c * (_x(t - k, wide, alpha) + (_x(t + k, wide, alpha) if k else 0.0)) for k, c in enumerate(_BINOMIAL)]
    return np.asarray(sum(at))


def _x(t: Floats, wide: float, alpha: int) -> Floats:
    """Equation (8): of a filter `wide` points wide, of its limit where that is infinite."""
    if math.isinf(wide):
        return _w(t, alpha + 2)
    return np.asarray(wide**2 * (2.0 * _w(t, alpha) - _w(t - 1.0 / wide, alpha) - _w(t + 1.0 / wide, alpha)))


def _w(t: Floats, alpha: int) -> Floats:
    """Equation (7)."""
    size = np.abs(t)
    power = 3 - alpha
    if alpha % 2 == 0:
        return np.asarray(size**power * (-1.0 if alpha == 2 else 1.0))
    return np.asarray(np.where(size == 0.0, 0.0, size**power * np.log(np.where(size == 0.0, 1.0, size))))


def noise_type(angle: Floats) -> int:
    """α of the noise that an angle (n,) shows from point to point, n ≥ `LEAST_POINTS`: its parabola is taken off, then
    it is differenced until its autocorrelation at lag 1 tells the power.
    """
    left = angle - np.polynomial.Polynomial.fit(np.arange(len(angle)), angle, 2)(np.arange(len(angle)))
    for differenced in range(_D + 1):
        about = left - left.mean()
        square = float(about @ about)
        lag_1 = float(about[:-1] @ about[1:]) / square if square else 0.0
        rho = lag_1 / (1.0 + lag_1)
        if rho < 0.25 or differenced == _D:
            break
        left = np.diff(left)
    found = 2 - round(2.0 * rho) - 2 * differenced
    return min(max(found, -2), 2)
