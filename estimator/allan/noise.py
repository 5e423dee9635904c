"""What an Allan deviation says of a rate sensor's noise, read off as IEEE Std 952-1997, Annex C, has it.

    σ²(τ) = 3 Q²/τ² + N²/τ + (2 ln 2/π) B² + K² τ/3 + R² τ²/2

Q quantisation noise, N angle random walk (white noise of the rate), B bias instability (flicker), K rate random walk,
R rate ramp. The sum is fitted with no term negative. It starts at the shortest cluster from which on it is borne out:
a low-pass filter in the sensor keeps the shortest ones smaller than white noise would be. Noise of an angle that is
read directly, as a whole-angle gyro's, falls as quantisation noise does, also behind such a filter.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from estimator.allan.deviation import AllanDeviation, Floats
from estimator.chance import TWO_SIDED

Term = Literal["quantisation", "white", "flicker", "rate random walk", "ramp"]

TERMS: dict[Term, tuple[int, float]] = {
    "quantisation": (-2, 3.0),
    "white": (-1, 1.0),
    "flicker": (0, 2.0 * np.log(2.0) / np.pi),
    "rate random walk": (1, 1.0 / 3.0),
    "ramp": (2, 0.5),
}
"""Power of τ in σ², and factor of the squared coefficient."""

FLOOR = float(np.sqrt(TERMS["flicker"][1]))
"""Deviation of a flat stretch over the bias instability, 0.664."""

TOLD_CLUSTERS = 10.0
"""Nothing is read off with fewer: a deviation from ten is sure to a quarter."""

LEAST_POINTS, LEAST_SAMPLES = 5, 18
"""Fewer cannot bear out a sum of terms; the shortest record that has so many cluster lengths."""

_MISFIT = 0.01  # share of the deviation by which the sum of terms may miss it: nothing is that pure a sum
_SURE = 0.9999  # and the interval it may miss it by
_CLEAR = 8.0  # where a filter was seen, the fit begins so much later: what it takes away fades as one over the length
_SHOWN = 2.0  # standard deviations that a term adds somewhere, or it is left out
_LEAST_SPAN = 10.0  # longest cluster over the shortest one fitted, where a filter is left out


class Reading(NamedTuple):
    """A coefficient with its 95 % interval, and the cluster length it is read at."""

    value: float
    low: float
    high: float
    tau_s: float


@dataclass(frozen=True)
class Fit:
    """Coefficients of the terms (rad, rad/√s, rad/s, rad/s^1.5, rad/s²), where the fit begins, which may be there."""

    coefficients: dict[Term, float]
    from_s: float
    terms: tuple[Term, ...] = tuple(TERMS)

    def part(self, term: Term, tau_s: Floats) -> Floats:
        """A term's share of σ² (k,), in its unit."""
        power, factor = TERMS[term]
        return np.asarray(factor * self.coefficients[term] ** 2 * tau_s**power)

    def deviation(self, tau_s: Floats) -> Floats:
        """σ (k,) of all terms."""
        return np.asarray(np.sqrt(sum(self.part(term, tau_s) for term in TERMS)))


@dataclass(frozen=True)
class Noise:
    """What the curve tells.

    fit: None where the curve is not that of noise alone, or too short for a fit.
    readings: terms that make at least half of σ² somewhere.
    bias_bound_rad_s: what it lies below (95 %) by the lowest place of the curve, where that may be of other terms.
    told_s: the longest cluster of which there are ten, None where there is not one.
    lowest_s: where the bound is read; at told_s the curve still falls, and a longer record lowers the bound.
    """

    curve: AllanDeviation
    fit: Fit | None
    readings: dict[Term, Reading]
    bias_bound_rad_s: float | None
    told_s: float | None
    lowest_s: float | None = None

    @property
    def bias_instability(self) -> Reading | None:
        """The flicker, None where it makes less than half of σ² everywhere, or there is no fit."""
        return self.readings.get("flicker")


def read_noise(curve: AllanDeviation) -> Noise:
    """Read the noise off a curve. A record of a quantity that stands still gives nothing."""
    told = np.flatnonzero(curve.clusters >= TOLD_CLUSTERS)
    told_s = float(curve.tau_s[told[-1]]) if told.size else None
    fit = find_fit(curve)
    if fit is None or not told.size:
        return Noise(curve, fit, {}, None, told_s)
    readings = {term: read for term in TERMS if (read := _read(curve, fit, term)) is not None}
    bound = lowest_s = None
    inside = told[curve.tau_s[told] >= fit.from_s]
    if "flicker" not in readings and inside.size:
        lowest = inside[np.argmin(fit.deviation(curve.tau_s[inside]))]
        bound, lowest_s = float(curve.interval(0.95)[1][lowest]) / FLOOR, float(curve.tau_s[lowest])
    return Noise(curve, fit, readings, bound, told_s, lowest_s)


def find_fit(curve: AllanDeviation) -> Fit | None:
    """The sum of terms that the curve bears out from the shortest possible cluster on; None if there is none."""
    if not (curve.deviation > 0).all():
        return None
    low, high = curve.interval(_SURE)
    for start in range(len(curve) - LEAST_POINTS + 1):
        if start and curve.tau_s[start] * _LEAST_SPAN > curve.tau_s[-1]:
            return None
        terms = list(TERMS)
        fit = _fit_from(curve, start, terms)
        at = curve.tau_s[start : start + 1]
        if start and fit.part("quantisation", at)[0] < 0.5 * fit.deviation(at)[0] ** 2:
            terms.remove("quantisation")  # of the rate's own noise: a filter hides what would tell it
            fit = _fit_from(curve, start, terms)
        expected = fit.deviation(curve.tau_s[start:])
        within = (low[start:] <= (1.0 + _MISFIT) * expected) & (high[start:] >= (1.0 - _MISFIT) * expected)
        if within.all():
            return fit if not start else _fit_from(curve, _clear_of_the_filter(curve, start), terms)
    return None


def _clear_of_the_filter(curve: AllanDeviation, start: int) -> int:
    """Where the fit begins when the shortest clusters had to be left out."""
    tau = curve.tau_s
    fits = (tau <= _CLEAR * tau[start]) & (tau * _LEAST_SPAN <= tau[-1]) & (np.arange(len(curve)) >= start)
    return int(min(np.flatnonzero(fits)[-1], len(curve) - LEAST_POINTS))


def _fit_from(curve: AllanDeviation, start: int, terms: list[Term]) -> Fit:
    tau, deviation, relative_sd = (part[start:] for part in (curve.tau_s, curve.deviation, curve.relative_sd))
    return Fit(_fitted(terms, tau, deviation, relative_sd), float(tau[0]), tuple(terms))


def _fitted(terms: list[Term], tau_s: Floats, deviation: Floats, relative_sd: Floats) -> dict[Term, float]:
    """Coefficients by least squares on σ², no term negative; of the terms only those that show above the scatter."""
    kept = list(terms)
    while True:
        squares = _solved(kept, tau_s, deviation, relative_sd)
        parts = {term: factor * squares[term] * tau_s**power for term in kept for power, factor in [TERMS[term]]}
        total = np.maximum(sum(parts.values()), np.finfo(float).tiny)
        shown = {term: float(np.max(part / total / (2.0 * relative_sd))) for term, part in parts.items()}
        least = min(kept, key=lambda term: shown[term])
        if len(kept) == 1 or shown[least] > _SHOWN:
            return {term: float(np.sqrt(squares.get(term, 0.0))) for term in TERMS}
        kept.remove(least)


def _solved(terms: list[Term], tau_s: Floats, deviation: Floats, relative_sd: Floats) -> dict[Term, float]:
    """Squared coefficients; points are weighted by what σ² should be there, found in rounds."""
    from scipy.optimize import nnls

    columns = np.stack([factor * tau_s**power for power, factor in (TERMS[term] for term in terms)], 1)
    share = 2.0 * np.hypot(relative_sd, _MISFIT)
    scale = columns.max(0)
    expected = deviation**2
    squares = np.zeros(len(terms))
    for _ in range(4):
        weight = 1.0 / (share * expected)
        squares = nnls(columns / scale * weight[:, None], deviation**2 * weight)[0] / scale
        expected = np.maximum(columns @ squares, 1e-3 * deviation**2)
    return dict(zip(terms, squares.tolist(), strict=True))


def _apart(curve: AllanDeviation, fit: Fit, term: Term) -> tuple[float, float]:
    """95 % interval of a coefficient with each of the terms there: one that was left out may hide in it. Points closer
    than an octave repeat one another."""
    inside = curve.tau_s >= fit.from_s
    tau, share = curve.tau_s[inside], 2.0 * np.hypot(curve.relative_sd[inside], _MISFIT)
    weight = 1.0 / (share * fit.deviation(tau) ** 2)
    columns = (
        np.stack([factor * tau**power for power, factor in map(TERMS.__getitem__, fit.terms)], 1) * weight[:, None]
    )
    scale = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / scale)
    repeated = max((tau.size - 1) / float(np.log2(tau[-1] / tau[0])), 1.0)
    at = fit.terms.index(term)
    row = inverse[at] / scale[at]
    square = float(row @ (curve.deviation[inside] ** 2 * weight))
    half = TWO_SIDED * float(np.sqrt(repeated * row @ row))
    return float(np.sqrt(max(square - half, 0.0))), float(np.sqrt(max(square + half, 0.0)))


def _read(curve: AllanDeviation, fit: Fit, term: Term) -> Reading | None:
    """The coefficient, as sure as the best point at which the term is at least half of σ², and as it is told apart from
    the others; None without such a point."""
    share = fit.part(term, curve.tau_s) / fit.deviation(curve.tau_s) ** 2
    usable = (share >= 0.5) & (curve.clusters >= TOLD_CLUSTERS) & (curve.tau_s >= fit.from_s)
    if not usable.any():
        return None
    best = int(np.argmin(np.where(usable, curve.relative_sd / np.maximum(share, 0.5), np.inf)))
    value, apart = fit.coefficients[term], _apart(curve, fit, term)
    low, high = (
        float(np.hypot(end[best] / curve.deviation[best] - 1.0, 2.0 * _MISFIT) / share[best])
        for end in curve.interval(0.95)
    )
    low, high = min(value * max(1.0 - low, 0.0), apart[0]), max(value * (1.0 + high), apart[1])
    return Reading(value, low, high, float(curve.tau_s[best]))
