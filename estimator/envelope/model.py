"""A law of damping fitted to the amplitude of a ring-down, and what of the reading is no motion.

Unknowns are ln a at the first sample, the linear damping, a coefficient for each law, and, where it is carried, the
power of the noise that the sensor takes for amplitude: what is shown is √(a² + n²).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.envelope.course import Power, course
from estimator.envelope.laws import LINEAR, Law
from estimator.envelope.record import DECIBEL, Envelope, Resonator
from estimator.errors import ModelError
from estimator.refinement import covariance_of, least_squares_beside, worth_of
from estimator.residual.effective import effective_samples
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace.axes import equations_on
from estimator.trace.certainty import TWO_SIDED
from estimator.trace.criterion import extended, schwarz
from estimator.trace.engine import Estimate, Score, Trial

Rows = NDArray[np.bool_]

FLOOR = "noise_floor"
"""Name of what the reading has beside the motion."""

_SET = THRESHOLDS.envelope
_OUTSIDE = 1e6  # standard deviations: what a search is told where there is no ring-down
_TOLERANCE = 1e-10
_RUNS = 200


@dataclass(frozen=True)
class Term:
    """One thing that an envelope may show beside linear damping: a law, or, with none, the noise floor.

    factor: SI of one scaled unit of the coefficient; power: of the resonance's frequency in that, record given.
    """

    name: str
    title: str
    equation: tuple[str, ...]
    symbol: str
    unit: str
    factor: float
    power: int
    positive: bool
    undone: str
    look_alikes: Mapping[str, str]
    law: Law | None = None


def terms(laws: Mapping[str, Law], resonator: Resonator) -> tuple[Term, ...]:
    """The laws, and the noise floor."""
    made = [
        Term(
            name=name,
            title=law.effect.title,
            equation=(*equations_on(law.effect, 1), law.equation),
            symbol=law.coefficient.name,
            unit=law.coefficient.unit,
            factor=resonator.scaling.coefficient(law.coefficient),
            power=1 + law.coefficient.time,
            positive=law.coefficient.positive,
            undone=law.effect.undone.value,
            look_alikes=law.effect.look_alikes,
            law=law,
        )
        for name, law in laws.items()
    ]
    made.append(
        Term(
            name=FLOOR,
            title="Noise that the sensor takes for amplitude",
            equation=("shown a = sqrt(a**2 + n**2)",),
            symbol="n",
            unit="m",
            factor=resonator.scaling.length,
            power=0,
            positive=True,
            undone="nothing to undo in the device",
            look_alikes={},
        )
    )
    return tuple(made)


@dataclass(frozen=True)
class EnvelopeFit:
    """A model with these terms, fitted.

    unknowns (k,) scaled: ln a at the first sample, damping, then one for each term, of the noise floor its power;
    covariance (k, k) of them; residual (n,) of the whole record, in the unit of what is shown; derivative (n, k) of
    what is shown.
    """

    terms: tuple[Term, ...]
    unknowns: Array
    covariance: Array
    residual: Array
    derivative: Array

    def rms(self, rows: Rows) -> float:
        """Rms residual of the rows."""
        return float(np.sqrt(np.mean(self.residual[rows] ** 2)))

    def estimates(self, resonator: Resonator) -> dict[str, dict[str, Estimate]]:
        """By term, SI; the interval allows for what the resonance is known to."""
        found = {}
        for place, term in enumerate(self.terms, start=2):
            value, deviation = float(self.unknowns[place]), float(np.sqrt(self.covariance[place, place]))
            if term.law is None:  # n from its power
                root = math.sqrt(abs(value))
                value, deviation = math.copysign(root, value), deviation / (2.0 * root) if root else math.inf
            half = TWO_SIDED * math.hypot(deviation, term.power * resonator.frequency_sd * value)
            size = term.factor
            estimate = Estimate(size * value, size * (value - half), size * (value + half), term.positive)
            found[term.name] = {term.symbol: estimate}
        return found

    def damping(self, resonator: Resonator) -> Estimate:
        """dxx, 1/s."""
        omega0 = resonator.scaling.omega0
        value, half = float(self.unknowns[1]), TWO_SIDED * float(np.sqrt(self.covariance[1, 1]))
        return Estimate(omega0 * value, omega0 * (value - half), omega0 * (value + half), positive=True)


def shown(envelope: Envelope, resonator: Resonator, carried: Sequence[Term], unknowns: Array) -> tuple[Array, Array]:
    """What the sensor shows (n,) and its derivative by the unknowns (n, k).

    Raises ModelError for a motion that is no ring-down.
    """
    omega0, unit = resonator.scaling.omega0, resonator.unit
    powers = [Power(LINEAR, 1.0)] + [Power(t.law.size, t.law.degree) for t in carried if t.law is not None]
    places = [1] + [place for place, term in enumerate(carried, start=2) if term.law is not None]
    time = (envelope.time - envelope.time[0]) * omega0
    lowest = float(np.min(envelope.level_over(unit))) - _SET.followed
    flow = course(time, float(unknowns[0]), unknowns[places], powers, min(lowest, float(unknowns[0]) - 1.0))
    derivative = np.zeros((len(envelope), len(unknowns)))
    derivative[:, 0], derivative[:, places] = flow.by_start, flow.by_coefficients
    level = flow.level
    floor = next((place for place, term in enumerate(carried, start=2) if term.law is None), None)
    if floor is not None:
        motion = np.exp(2.0 * flow.level)
        power = np.maximum(motion + unknowns[floor], np.finfo(float).tiny)
        level = 0.5 * np.log(power)
        derivative *= (motion / power)[:, None]
        derivative[:, floor] = 0.5 / power
    amplitude = unit * np.exp(level)
    with np.errstate(over="ignore", invalid="ignore"):
        derivative = (DECIBEL if envelope.logarithmic else amplitude[:, None]) * derivative
    if not np.all(np.isfinite(derivative)):
        raise ModelError("the amplitude leaves all bounds")
    return DECIBEL * (level + math.log(unit)) if envelope.logarithmic else amplitude, derivative


def fitted(
    envelope: Envelope, resonator: Resonator, carried: tuple[Term, ...], rows: Rows, start: EnvelopeFit | None = None
) -> EnvelopeFit:
    """Least squares over the rows, from what `start` found, whose terms come first, on; linear damping counts as
    declared beside them.

    Raises ModelError where there is no ring-down to begin with.
    """
    begin = _beginning(envelope, resonator, rows) if start is None else start.unknowns
    begin = np.concatenate([begin, np.zeros(2 + len(carried) - len(begin))])
    omega0 = resonator.scaling.omega0
    known, sure = (np.array([value / omega0]) for value in resonator.damping)
    shown(envelope, resonator, carried, begin)

    def weighted(unknowns: Array) -> tuple[Array, Array]:
        try:
            values, derivative = shown(envelope, resonator, carried, unknowns)
        except ModelError:  # the search is told to come back
            return np.full(int(np.sum(rows)), _OUTSIDE), np.zeros((int(np.sum(rows)), len(unknowns)))
        return (values - envelope.shown)[rows] / resonator.noise, derivative[rows] / resonator.noise

    place = np.array([1], dtype=np.int64)
    solution, worth = begin, 1.0
    for _ in range(2):  # the second time with the declaration worth as much as a sample is
        solution = least_squares_beside(
            weighted, solution, place, known, sure / worth, tolerance=_TOLERANCE, runs=_RUNS
        )
        residual, jacobian = weighted(solution)
        if (found := worth_of(residual)) <= worth:
            break
        worth = found
    told = np.zeros(len(solution))
    told[1] = (worth / sure[0]) ** 2
    size = np.maximum(np.linalg.norm(jacobian, axis=0), np.finfo(float).tiny)
    covariance = _no_surer_than_white(jacobian / size, residual, told / size**2, worth) / np.outer(size, size)
    values, derivative = shown(envelope, resonator, carried, solution)
    return EnvelopeFit(carried, solution, covariance, envelope.shown - values, derivative)


def _no_surer_than_white(jacobian: Array, residual: Array, told: Array, worth: float) -> Array:
    """Covariance that allows for a residual that is not white, and for no less than a white one of its size.

    A law is as slow as the record is long: what is left of a short record has nothing of so low frequencies any more,
    and its spectrum there says too little.
    """
    coloured = covariance_of(jacobian, residual, told, worth)
    variance = float(residual @ residual) / max(len(residual) - jacobian.shape[1], 1)
    white = np.linalg.pinv(jacobian.T @ jacobian / variance + np.diag(told) / worth**2, hermitian=True)
    wider = np.sqrt(np.maximum(np.diagonal(white) / np.diagonal(coloured), 1.0))
    return np.asarray(coloured * np.outer(wider, wider))


def _beginning(envelope: Envelope, resonator: Resonator, rows: Rows) -> Array:
    """Amplitude and damping of the straight line through the logarithm."""
    time = (envelope.time - envelope.time[0]) * resonator.scaling.omega0
    slope, level = np.polyfit(time[rows], envelope.level_over(resonator.unit)[rows], 1)
    if not slope < 0.0:
        raise ModelError("the amplitude does not fall; an envelope is traced as it rings down")
    return np.array([level, -slope / LINEAR])


@dataclass(frozen=True)
class EnvelopeModel:
    """`estimator.trace.engine.Model` of envelopes, fitted to `choice`, while `later` must agree."""

    envelope: Envelope
    resonator: Resonator
    choice: Rows
    later: Rows
    candidates: tuple[Term, ...]

    def promise(self, current: EnvelopeFit, barred: Collection[str]) -> tuple[str, ...]:
        """Who may still be added: a fit is so cheap that nothing is said beforehand of what it explains.  Of the laws
        of one degree, which an envelope does not tell apart, the first is.
        """
        taken = {term.law.degree for term in current.terms if term.law is not None}
        found = []
        for term in self.candidates:
            if term.name in barred or term in current.terms:
                continue
            if term.law is not None:
                if term.law.degree in taken:
                    continue
                taken.add(term.law.degree)
            found.append(term.name)
        return tuple(found)

    def hopeful(
        self, look: tuple[str, ...], tried: Mapping[str, Trial[EnvelopeFit]], refused: Collection[str], number: int
    ) -> Sequence[str]:
        """All of them."""
        return look

    def fit(
        self, current: EnvelopeFit, look: tuple[str, ...], names: Sequence[str], tried: Mapping[str, Trial[EnvelopeFit]]
    ) -> Mapping[str, EnvelopeFit | str]:
        """Least squares, begun at what `current` found."""
        every = {term.name: term for term in self.candidates}
        found: dict[str, EnvelopeFit | str] = {}
        for name in names:
            try:
                found[name] = fitted(self.envelope, self.resonator, (*current.terms, every[name]), self.choice, current)
            except ModelError:
                found[name] = "no ring-down with it"
        return found

    def score(
        self, current: EnvelopeFit, look: tuple[str, ...], fits: Mapping[str, EnvelopeFit]
    ) -> Mapping[str, Score]:
        """Gains counted in the independent samples that the closest of them leaves."""
        closest = min(fits.values(), key=lambda trial: trial.rms(self.choice))
        effective = effective_samples(closest.residual[self.choice])
        price = schwarz(1, effective)
        bar = extended(1, effective, len(self.candidates))
        gains = {
            name: 2.0 * effective * math.log(current.rms(self.choice) / trial.rms(self.choice))
            for name, trial in fits.items()
        }
        return {name: Score(gain, gain, price, bar) for name, gain in gains.items()}

    def coefficients(self, fit: EnvelopeFit) -> Mapping[str, Mapping[str, Estimate]]:
        """With intervals that allow for a residual that is not white."""
        return fit.estimates(self.resonator)

    def objection(self, current: EnvelopeFit, name: str, trial: Trial[EnvelopeFit]) -> str | None:
        """The part without a vote must be predicted better as well."""
        del name
        if trial.fit.rms(self.later) >= current.rms(self.later):
            return "fits two thirds of the record better and the other third worse"
        return None
