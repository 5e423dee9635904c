"""The force domain: what force the measured motion needed, beside the force that was given.

Inverse dynamics of a single axis, as robots are identified (Janot, Gautier & Brunot, Data set and reference models of
EMPS, 2019): position is filtered forwards and backwards and differentiated, then both sides pass one more low-pass and
are resampled, so that only what lies within the motion's own band is compared.  The model is linear in its unknowns:

    u = (1/b) ẍ + (d/b) ẋ + (k/b) x + u0 + Σ cᵢ φᵢ(x, ẋ),   u in the drive's unit, φᵢ from the effects' declarations.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sp
from scipy.signal import butter, filtfilt

from estimator.correlation import effective_samples
from estimator.effects.catalogue import EFFECTS, effect_for
from estimator.effects.declaration import Coefficient, Source
from estimator.errors import ModelError
from estimator.model.gyro import vx, x
from estimator.scaling import Array, Scaling

BASE = ("inertia", "damping", "stiffness", "offset")
_REST = 0.01  # of A ω0: about as slow, friction turns over
_ORDER = 4  # of both Butterworth filters
_CUT = 5  # resampled rows at each end, where the filters have no past or no future
_T95 = 1.959963984540054
_EXCITED = 0.05  # of an effect's signature, what must be left when the base model is taken out
_WORTH = 0.05  # of the held-out error, what an effect must take: the filters bend a kink by about a hundredth
_TRIFLE = 0.02  # of the largest coefficient of an effect, what chance makes of one that is not there
_ALIKE = 0.98  # correlation of signatures above which a record does not tell two effects apart
Signature = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Filters:
    """Cut-off [Hz] of the position before it is differentiated and of both sides after, and every how many rows are
    kept.
    """

    position: float
    force: float
    every: int


@dataclass(frozen=True)
class Motion:
    """A record in the force domain, resampled: position, velocity, acceleration of it, drive; all (n,), SI."""

    position: Array
    velocity: Array
    acceleration: Array
    drive: Array
    rate: float
    filters: Filters


def motion_of(position: Array, drive: Array, rate: float, filters: Filters) -> Motion:
    """Filtered position (n,) m and its derivatives at `rate` Hz, beside the drive (n,) as given.

    Raises ModelError for cut-offs above half the sampling rate and for records shorter than the filters.
    """
    if not 0.0 < filters.force <= filters.position < 0.5 * rate:
        raise ModelError(f"cut-offs {filters.force:g} and {filters.position:g} Hz do not fit a rate of {rate:g} Hz")
    if len(position) < 20 * filters.every or len(position) != len(drive):
        raise ModelError(f"{len(position)} positions and {len(drive)} drives make no record for these filters")
    smooth = filtfilt(*butter(_ORDER, filters.position / (0.5 * rate)), position)
    velocity = np.zeros_like(smooth)
    velocity[1:-1] = (smooth[2:] - smooth[:-2]) * 0.5 * rate
    acceleration = np.zeros_like(smooth)
    acceleration[2:-2] = (velocity[3:-1] - velocity[1:-3]) * 0.5 * rate
    return Motion(smooth, velocity, acceleration, np.asarray(drive, dtype=float), rate, filters)


def resampled(motion: Motion, series: Array) -> Array:
    """A series (n,) behind the common low-pass, every so many rows, without the ends."""
    passed = filtfilt(*butter(_ORDER, motion.filters.force / (0.5 * motion.rate)), series)
    return np.asarray(passed[:: motion.filters.every][_CUT:-_CUT])


def columns(motion: Motion, effects: Sequence[str], scaling: Scaling) -> tuple[tuple[str, ...], Array]:
    """Names and regressors (rows, unknowns) of the base model and the effects' coefficients.

    The unknowns are forces in the drive's unit per SI unit of ẍ, ẋ, x and of each effect's signature per unit mass.
    Raises ModelError for an effect that is no force, or one that is not linear in its coefficients.
    """
    series = [motion.acceleration, motion.velocity, motion.position, np.ones_like(motion.position)]
    names = list(BASE)
    for name in effects:
        for coefficient, signature in _signatures(name):
            scaled = signature(motion.position / scaling.length, motion.velocity / (scaling.length * scaling.omega0))
            unit = scaling.length * scaling.omega0**2 / scaling.coefficient(coefficient)
            series.append(-unit * (scaled + np.zeros_like(motion.position)))
            names.append(coefficient.name)
    return tuple(names), np.column_stack([resampled(motion, one) for one in series])


@cache
def _signatures(name: str) -> tuple[tuple[Coefficient, Signature], ...]:
    """Each coefficient with what one unit of it adds to the force, a function of scaled x, ẋ."""
    _, effect = effect_for(name, 1)
    found = []
    for coefficient in effect.coefficients:
        directions = {s.symbol: sp.tanh(vx / _REST) for s in effect.signals if s.source is Source.DIRECTION}
        signature = sp.diff(effect.force[0], coefficient.symbol).subs(directions)
        strangers = signature.free_symbols - {x, vx}  # the drive stands on the other side of the equation
        if signature == 0 or strangers:
            raise ModelError(f"effect {name!r} is no force linear in {coefficient.name} on a single axis")
        found.append((coefficient, sp.lambdify((x, vx), signature, "numpy")))
    return tuple(found)


def candidates() -> tuple[str, ...]:
    """Names of the effects that the force domain can show."""
    names = []
    for effect in EFFECTS:
        alone = effect.on(1)
        if alone is None or alone.force[0] == 0:
            continue
        try:
            _signatures(alone.name)
        except ModelError:
            continue
        names.append(alone.name)
    return tuple(names)


@dataclass(frozen=True)
class ForceFit:
    """A model in the force domain: its effects, the unknowns with their half-widths (95 %), the residual (rows,) of
    the record it was fitted to, in the drive's unit.
    """

    effects: tuple[str, ...]
    names: tuple[str, ...]
    values: Array
    half_widths: Array
    residual: Array

    @property
    def rms(self) -> float:
        """Rms residual of the fitted record."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def residual_on(self, motion: Motion, scaling: Scaling) -> Array:
        """Residual (rows,) of the same model on another record."""
        return np.asarray(resampled(motion, motion.drive) - columns(motion, self.effects, scaling)[1] @ self.values)


def fit_forces(motion: Motion, effects: Sequence[str], scaling: Scaling) -> ForceFit:
    """Least squares of the base model with these effects; the intervals allow for a residual that is not white."""
    names, matrix = columns(motion, effects, scaling)
    force = resampled(motion, motion.drive)
    sizes = np.linalg.norm(matrix, axis=0)
    scaled = matrix / np.where(sizes > 0.0, sizes, 1.0)
    values = np.linalg.lstsq(scaled, force, rcond=None)[0]
    residual = force - scaled @ values
    variance = float(residual @ residual) / max(effective_samples(residual) - len(values), 1.0)
    deviations = np.sqrt(np.diagonal(np.linalg.pinv(scaled.T @ scaled)) * variance)
    return ForceFit(tuple(effects), names, values / sizes, _T95 * deviations / sizes, residual)


@dataclass(frozen=True)
class ForceTrace:
    """What the force domain says: the base model, the model with what was found, and why the rest was left.

    evidence: twice the gain of log-likelihood of each effect found; alike: pairs (found, not found) whose signatures
    this record does not tell apart, with their correlation.
    """

    before: ForceFit
    after: ForceFit
    evidence: dict[str, float]
    rejected: dict[str, str]
    alike: tuple[tuple[str, str, float], ...]


def trace_forces(fitting: Motion, held_out: Motion, scaling: Scaling) -> ForceTrace:
    """Add effects one after another as long as the fitting record asks for them and the held-out one agrees.

    Of each round the effect with the largest gain less its price is added.  A gain is that of twice the log-likelihood,
    counted in the independent samples that the closest model leaves.
    """
    before = fit_forces(fitting, (), scaling)
    names = candidates()
    rejected = {name: "not excited by this record" for name in names if not _excited(fitting, name, scaling)}
    after, evidence = before, dict[str, float]()
    while left := [name for name in names if name not in after.effects and name not in rejected]:
        fits = {name: fit_forces(fitting, (*after.effects, name), scaling) for name in left}
        rejected |= {name: f"fits only with a negative {wrong}" for name in left if (wrong := _negative(fits[name]))}
        valid = {name: fit for name, fit in fits.items() if name not in rejected}
        if not valid:
            break
        samples = effective_samples(min(valid.values(), key=lambda fit: fit.rms).residual)
        gains, worth = {}, {}
        for name, fit in valid.items():
            gains[name] = max(samples - len(fit.values), 1.0) * 2.0 * math.log(after.rms / fit.rms)
            worth[name] = gains[name] - price(len(fit.values) - len(after.values), samples, len(names))
        best = max(worth, key=lambda name: worth[name])
        if not worth[best] > 0.0:
            rejected |= {
                name: f"evidence {gain:.1f} does not outweigh its coefficients" for name, gain in gains.items()
            }
            break
        was, now = (_rms(fit.residual_on(held_out, scaling)) for fit in (after, valid[best]))
        if now > (1.0 - _WORTH) * was:
            rejected[best] = "fits the fitting record better and the held-out record no better, or worse"
        else:
            after, evidence[best] = valid[best], gains[best]
    return ForceTrace(before, after, evidence, rejected, _alike(fitting, after, rejected, scaling))


def price(numbers: int, samples: float, candidates: int) -> float:
    """What so many numbers must gain, one of so many candidates chosen (Chen & Chen, Biometrika 95(3), 2008)."""
    return numbers * math.log(samples) + 2.0 * math.log(max(candidates, 1))


def _negative(fit: ForceFit) -> str | None:
    """A coefficient that is negative beyond doubt though it is declared positive, and no trifle beside the largest of
    its effect that is there beyond doubt: where one has an effect and another none, chance makes one of those.
    """
    ends = dict(zip(fit.names, zip(fit.values, fit.half_widths, strict=True), strict=True))
    for effect in fit.effects:
        own = {c.name: ends[c.name] for c in effect_for(effect, 1)[1].coefficients if c.positive}
        largest = max((value for value, half in own.values() if value > half), default=0.0)
        for name, (value, half) in own.items():
            if value + half < 0.0 and -value > _TRIFLE * largest:
                return name
    return None


def _rms(series: Array) -> float:
    return float(np.sqrt(np.mean(series**2)))


def _projected(motion: Motion, carried: Sequence[str], name: str, scaling: Scaling) -> tuple[Array, float]:
    """What an effect adds beside the base model and the carried effects (rows, coefficients), and its share of all."""
    basis = np.linalg.qr(columns(motion, carried, scaling)[1])[0]
    own = columns(motion, (name,), scaling)[1][:, len(BASE) :]
    rest = own - basis @ (basis.T @ own)
    size = float(np.linalg.norm(own))
    return rest, float(np.linalg.norm(rest)) / size if size > 0.0 else 0.0


def _excited(motion: Motion, name: str, scaling: Scaling) -> bool:
    return _projected(motion, (), name, scaling)[1] > _EXCITED


def _alike(
    motion: Motion, fitted: ForceFit, rejected: dict[str, str], scaling: Scaling
) -> tuple[tuple[str, str, float], ...]:
    pairs = []
    for name in fitted.effects:
        others = [effect for effect in fitted.effects if effect != name]
        own = _projected(motion, others, name, scaling)[0][:, 0]
        for candidate in rejected:
            rest, share = _projected(motion, others, candidate, scaling)
            size = float(np.linalg.norm(own) * np.linalg.norm(rest[:, 0]))
            correlation = abs(float(own @ rest[:, 0])) / size if share > _EXCITED and size > 0.0 else 0.0
            if correlation > _ALIKE:
                pairs.append((name, candidate, correlation))
    return tuple(pairs)
