"""Bias, scale factor, what bends it, what it does over temperature and angle: one fit to a record's stretches.

    rate = b + (1 + s) Ω + a |Ω| − τ Ω̇ + b_T (T − T̄) + s_T Ω (T − T̄) + Σ over k of (b_k + s_k Ω) harmonics of kθ

b bias, s scale factor error, 2a/(1 + s) asymmetry (slope at positive less slope at negative rates), τ delay.
"""

from dataclasses import dataclass

import numpy as np

from estimator.chance import TWO_SIDED
from estimator.characteristics.regression import Estimate, Fitted, Floats, fitted, least_values, wider
from estimator.characteristics.stretches import HARMONICS, Stretches

_LEVELS = 21
_DISTINCT = 400  # rates of a record that is made of steps
_LEAST_K = 2.0
LEAST_TURNS = 0.9
"""Share of half a turn that the pattern has to pass for its harmonics to be told."""
_HARMONIC = {
    f"{figure}_{k}theta": (f"{kind}_cos{k}", f"{kind}_sin{k}")
    for kind, figure in (("bias", "bias"), ("scale", "scale_factor"))
    for k in HARMONICS
}
_COLUMNS = _HARMONIC | {
    "scale_factor_error": ("scale",),
    "scale_factor_asymmetry": ("asymmetry",),
    "delay": ("delay",),
    "bias_temperature": ("bias_temperature",),
    "scale_factor_temperature": ("scale_temperature",),
}
"""Columns of the fit, by the figure that is read from them."""


@dataclass(frozen=True)
class Levels:
    """Rates (k,) that were given, the mean output less bias over the fitted slope (k,), and half its 95 % interval."""

    rate: Floats
    response: Floats
    half: Floats


@dataclass(frozen=True)
class Line:
    """The fit, and what follows from it; levels are None where the reference does not move."""

    fit: Fitted
    turns: bool
    levels: Levels | None
    angles: tuple[str, ...]
    """Harmonics in the fit, of bias and of scale factor."""

    def figures(self) -> dict[str, Estimate]:
        """By the name of the figure."""
        fit, slope = self.fit, 1.0 + self.fit.of("scale")
        found = {
            "bias": fit.estimate("bias"),
            "scale_factor_error": fit.estimate("scale"),
            "scale_factor_asymmetry": fit.estimate("asymmetry", 2.0 / slope),
            "delay": self.delay,
            "bias_temperature": fit.estimate("bias_temperature"),
            "scale_factor_temperature": fit.estimate("scale_temperature", 1.0 / slope),
        }
        found["scale_factor_nonlinearity"] = self._nonlinearity()
        found |= {figure: self._harmonic(*names) for figure, names in _HARMONIC.items()}
        return {name: value for name, value in found.items() if value is not None}

    @property
    def delay(self) -> Estimate | None:
        """Of the output behind the reference; None where the record could not tell it."""
        return self.fit.estimate("delay", 1.0 / (1.0 + self.fit.of("scale")))

    @property
    def confounded(self) -> set[str]:
        """Names of figures that the record does not tell apart from those above them."""
        return {figure for figure, names in _COLUMNS.items() if any(name in self.fit.confounded for name in names)}

    def _nonlinearity(self) -> Estimate | None:
        """The largest distance of a rate's mean from the straight line, over the largest rate; the interval is that of
        the largest of so many (Bonferroni): noise alone leaves one of them far off."""
        if self.levels is None or self.levels.rate.size < 3:
            return None
        from scipy.stats import norm

        of_so_many = float(norm.isf(0.025 / self.levels.rate.size)) / TWO_SIDED
        full = float(np.abs(self.levels.rate).max())
        off = np.abs(self.levels.response - self.levels.rate) / full
        worst = int(np.argmax(off))
        return Estimate.about(float(off[worst]), of_so_many * float(self.levels.half[worst]) / full).size

    def _harmonic(self, *names: str) -> Estimate | None:
        if not all(name in self.fit.names for name in names):
            return None
        first, second = (self.fit.of(name) for name in names)
        return Estimate.of_two(first, second, self.fit.sd(*names), self.fit.freedom)


def line(record: Stretches, harmonics: tuple[int, ...] = HARMONICS) -> Line | None:
    """The fit; None of a record too short for it. Without a reference the rate is taken as 0: a device at rest."""
    reference, columns = _columns(record)
    angles = _angles(record, harmonics)
    fit = fitted(columns | angles, record.rate - reference)
    if fit is None and angles:  # too short for so many
        angles = {}
        fit = fitted(columns, record.rate - reference)
    if fit is None:
        return None
    told = tuple(name for name in angles if name in fit.names)
    return Line(fit, record.moves, _levels(record, columns | angles, fit), told)


def fewest(record: Stretches) -> int:
    """How many stretches a fit without the pattern's harmonics needs."""
    return least_values(len(_columns(record)[1]))


def passed(record: Stretches) -> float:
    """Share of half a turn that the pattern passed, in sixteenths."""
    if record.pattern is None or not len(record):
        return 0.0
    twice = np.arctan2(record.pattern[:, 3], record.pattern[:, 2])  # 2θ, as the pattern after half a turn is the same
    return np.unique(np.floor(8 * (twice / np.pi + 1.0)).astype(int) % 16).size / 16


def _columns(record: Stretches) -> tuple[Floats, dict[str, Floats]]:
    """The rate that is expected (n,), and what is fitted to the rest by name, but for the harmonics."""
    reference = np.zeros(len(record)) if record.reference is None else record.reference
    columns: dict[str, Floats] = {"bias": np.ones(len(record))}
    if record.moves:
        columns["scale"] = reference
    if record.moves and reference.min() < 0.0 < reference.max():
        columns["asymmetry"] = np.abs(reference)
    if record.moves and record.slope is not None and np.ptp(record.slope) > 0.0:
        columns["delay"] = -record.slope
    if record.temperature is not None and np.ptp(record.temperature) >= _LEAST_K:
        warmer = record.temperature - record.temperature.mean()
        columns["bias_temperature"] = warmer
        if record.moves:
            columns["scale_temperature"] = reference * warmer
    return reference, columns


def _angles(record: Stretches, harmonics: tuple[int, ...]) -> dict[str, Floats]:
    """Columns of the pattern's harmonics, where the pattern passed all angles."""
    if record.pattern is None or len(record) < 2 or passed(record) < LEAST_TURNS:
        return {}
    found = {}
    for kind, first in (("bias", 0), ("scale", 2 * len(HARMONICS))):
        if kind == "scale" and not record.moves:
            continue
        for k in harmonics:
            at = first + 2 * HARMONICS.index(k)
            found[f"{kind}_cos{k}"], found[f"{kind}_sin{k}"] = record.pattern[:, at], record.pattern[:, at + 1]
    return found


def _levels(record: Stretches, columns: dict[str, Floats], fit: Fitted) -> Levels | None:
    """Means of the output at each rate that was given, or in equal parts of the range."""
    if not record.moves or record.reference is None:
        return None
    reference = record.reference
    straight = fitted({name: columns[name] for name in columns if name != "asymmetry"}, record.rate - reference)
    if straight is None:
        return None
    steps = np.round(reference / (1e-4 * np.abs(reference).max())) if np.ptp(reference) else reference
    values, number = np.unique(steps, return_inverse=True)
    if values.size > _DISTINCT or values.size > len(record) / 3:
        edges = np.linspace(reference.min(), reference.max(), _LEVELS + 1)
        number = np.clip(np.digitize(reference, edges) - 1, 0, _LEVELS - 1)
    count = np.bincount(number)
    there = count >= 3
    rate = (np.bincount(number, reference) / np.maximum(count, 1))[there]
    off = (np.bincount(number, straight.residual) / np.maximum(count, 1))[there]
    slope = 1.0 + fit.of("scale")
    about = straight.residual - (np.bincount(number, straight.residual) / np.maximum(count, 1))[number]
    spread = np.sqrt(wider(about) * float(np.mean(about**2)) / count[there])
    return Levels(rate, rate + off / slope, straight.factor * spread / abs(slope))
