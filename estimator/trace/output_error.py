"""The likelihood of readings that hang on what is known and on constants alone (Ljung, ch. 4: an output-error model).

A reading is a prediction from θ, a random walk, and white noise.  The walk goes along time, where it is an offset that
wanders; or, in a table of steady states, along its input, where it is a curve that no constant describes.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded

from estimator.chance import f_isf
from estimator.correlation import effective_samples
from estimator.diagnosis import Interval
from estimator.errors import ModelError
from estimator.scaling import Array
from estimator.side_by_side import stop_if_abandoned
from estimator.trace.examination import Examination
from estimator.trace.filtered import CLOSE
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import (
    AT_FLOOR,
    BLOCKS,
    RARE,
    SHIFT,
    Check,
    Evaluation,
    Layout,
    Likelihood,
    Model,
    Noise,
    Size,
)
from estimator.trace.problem import Effects

NO_WALK, ALL_WALK = 1e-3, 1e1
"""Of the white noise: what a walk comes to over the record at least, and from one sample to the next at most."""

Rows = NDArray[np.int64]


@dataclass(frozen=True)
class OutputLayout(Layout):
    """A layout whose parameters have deviations of about one; effects: by name, where the coefficients of each begin,
    SI, nothing where at zero.
    """

    names: tuple[str, ...]
    owner: tuple[str, ...]
    mean: Array
    deviation: Array
    least: Array
    most: Array
    factor: Array
    effects: Effects

    def effects_of(self, model: Model) -> Effects:
        """The effects of a model; those that do not begin at zero, with their coefficients as they are."""
        now = model.theta * self.factor
        return {
            name: {self.names[k]: float(now[k]) for k in self.of(name)} if given else {}
            for name, given in self.effects.items()
        }


@dataclass(frozen=True, kw_only=True)
class Term:
    """An effect as search, checks and report know it: signals as of `Described`; look_alikes: by effect what tells it
    apart; generalises: effects that it is at a bound of its coefficients.
    """

    title: str
    equations: tuple[str, ...]
    coefficients: tuple[Size, ...]
    compensation: str
    signals: tuple[()] = ()
    look_alikes: Mapping[str, str] = field(default_factory=dict)
    generalises: tuple[str, ...] = ()


@dataclass(frozen=True)
class Predicted:
    """values (n,) of the readings; free (n, m): what may be added to them in any size, as of a start that was not at
    rest; known (n,): whether a reading hangs on nothing from before the record.
    """

    values: Array
    free: Array
    known: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class OutputError(Likelihood):
    """`Likelihood` of readings, of which a kind of record supplies the prediction.

    told: those that tell the size of what is free; counted: those of which it is the likelihood; noise: declared
    deviation of a reading; floor: that by which the record is judged, how many independent differences tell it
    (infinite: it is declared), and how it was found, in words.  Noise is white, and nothing is followed; what wanders
    is asked of what was found (`walking`).
    """

    told: Rows
    counted: Rows
    noise: float
    floor: tuple[float, float, str]
    effects: ClassVar[Effects] = MappingProxyType({})
    axes: ClassVar[int] = 1
    base: ClassVar[tuple[str, ...]] = ()
    """Constants of the base model that are told."""

    @property
    @abstractmethod
    def reading(self) -> Array:
        """The readings (n,)."""

    @property
    @abstractmethod
    def along(self) -> Array:
        """Along what they wander (n,)."""

    @abstractmethod
    def upto(self, samples: int) -> Self:
        """The same of a record of the first samples only."""

    @abstractmethod
    def layout(self, effects: Effects) -> OutputLayout:
        """The parameters of the model with these effects; those of the last effect stand last."""

    @abstractmethod
    def predicted(self, layout: OutputLayout, theta: Array) -> Predicted:
        """The readings.  Raises ModelError for parameters with which there are none."""

    @abstractmethod
    def effect(self, name: str) -> Term:
        """Declaration of an effect, by its name with a label."""

    @abstractmethod
    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """Effects that are not in a model, each with where its coefficients begin, SI; with nothing, where at zero."""

    def balanced(self, layout: OutputLayout, theta: Array) -> Array:
        """`theta` (k,) with the last effect where it begins."""
        return theta

    @abstractmethod
    def interval(self, model: FittedModel, k: int) -> Interval:
        """Of a parameter, SI."""

    def same(self, name: str, found: Mapping[str, Interval]) -> Mapping[str, tuple[str, str]]:
        """Effects that do the same to any such record as one that was found, each with what would tell it apart, and
        with the coefficient that it then has, in words.
        """
        return {}

    def checks(self, model: FittedModel) -> list[Check]:
        """What this kind of record asks of a model, beside what all do."""
        return []

    def said(self, model: FittedModel) -> tuple[str, ...]:
        """Of the base model, a sentence each."""
        return ()

    def remarks(self) -> tuple[str, ...]:
        """Why what is left of these readings may be left, a sentence each."""
        return ()

    @property
    def samples(self) -> int:
        return len(self.counted)

    def part(self, rows: slice) -> Self:
        counted = self.counted[rows]
        if len(counted) == self.samples:
            return self
        samples = int(counted[-1]) + 1
        return replace(self.upto(samples), told=self.told[self.told < samples], counted=counted)

    def plausible(self, name: str) -> Array:
        """One: of a coefficient, scaled, or of all that an effect does where it begins."""
        return np.ones(1)

    def begun(self, layout: Layout, theta: Array, name: str, size: Array) -> Array:
        """At the size that the score test tells, or where the effect begins."""
        assert isinstance(layout, OutputLayout)
        if layout.effects[name]:
            return self.balanced(layout, theta)
        theta = theta.copy()
        theta[layout.of(name)] = np.clip(size, layout.least[layout.of(name)], layout.most[layout.of(name)])
        return theta

    def declared_noise(self) -> Noise:
        """White: nothing wanders."""
        return Noise((1.0,), float(10.0 ** self._decades()[0]), 0.0)

    def _decades(self) -> tuple[float, float]:
        """Between which a walk is looked for, in the reading's unit by the root of what it goes along."""
        span = float(np.ptp(self.along[self.counted]))
        least = NO_WALK * self.noise / np.sqrt(span)
        most = ALL_WALK * self.noise / np.sqrt(span / self.samples)
        return float(np.log10(least)), float(np.log10(most))

    def walking(self, layout: Layout, model: Model) -> Model:
        """The model with the walk that the record asks for."""

        def with_force(value: float) -> Model:
            return replace(model, noise=replace(model.noise, force=float(10.0**value)))

        least, most = self._decades()
        # Two tops: none at all, and one that follows what is left.
        begun = self.likeliest(layout, [with_force(value) for value in np.arange(least, most, 1.0).tolist()])
        start = float(np.log10(begun.noise.force))
        return self.at_level(layout, with_force, start, (least, most), CLOSE)

    def disturbed(self, layout: Layout, model: Model) -> tuple[Model, Model]:
        """The model without a walk, and with the one that the record asks for: none, where what is left is no more
        than the noise floor.
        """
        quiet = replace(model, noise=self.declared_noise())
        seen = self.evaluate(layout, quiet, derivatives=False)
        return quiet, quiet if self.above_floor(seen, None) < AT_FLOOR else self.walking(layout, model)

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        """Raises ModelError always."""
        raise ModelError("an observer follows a motion, and this record shows none")

    def above_floor(self, held_out: Evaluation, after: Examination | None) -> float:
        """What the readings are off, over the noise floor, rms."""
        return float(np.sqrt(np.nanmean(held_out.innovation**2))) / self.floor[0]

    def chance(self, held_out: Evaluation) -> float:
        """Of few independent readings, and of a floor that few differences tell."""
        left = held_out.innovation[:, 0]
        worth = effective_samples(left[np.isfinite(left)])
        return float(np.sqrt(f_isf(RARE, worth, min(self.floor[1], 1e9))))

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        """The readings beside their prediction; an innovation is what one is off."""
        stop_if_abandoned()
        names = (*(layout.names if derivatives else ()), *(tested or {}))
        try:
            both = self._beside(layout, model, derivatives=derivatives, tested=tested or {})
            rows, left = self._whitened(layout, model, *both)
        except ModelError:
            rows, left = np.full((BLOCKS, len(names) + 2), np.inf), np.full(self.samples, np.inf)
        # A reading that hangs on what came before the record counts as one of the others does.
        return Evaluation.of_rows(
            names, rows[:, None], left[:, None], np.full((self.samples, 1), self.noise),
            weight=self.samples / len(rows),
        )  # fmt: skip

    def _beside(
        self, layout: Layout, model: Model, *, derivatives: bool = False, tested: Effects | None = None
    ) -> tuple[Array, Predicted]:
        """What one of a parameter, and one of what is tested, take off the error, and the error (n, k + 1)."""
        assert isinstance(layout, OutputLayout)
        now = self.predicted(layout, model.theta)
        columns = [self._slope(layout, model.theta, k) for k in range(len(layout.names) if derivatives else 0)]
        columns += [self._shown(layout, model, name, given, now) for name, given in (tested or {}).items()]
        return np.column_stack([*(-one for one in columns), self.reading - now.values]), now

    def _slope(self, layout: OutputLayout, theta: Array, k: int) -> Array:
        """Derivative (n,) of the prediction by a parameter."""
        step = np.zeros(len(theta))
        step[k] = SHIFT
        ahead, behind = (self.predicted(layout, theta + sign * step).values for sign in (1.0, -1.0))
        return np.asarray((ahead - behind) / (2.0 * SHIFT))

    def _shown(
        self, layout: OutputLayout, model: Model, name: str, given: Mapping[str, float], now: Predicted
    ) -> Array:
        """What an effect adds to the prediction (n,): where it begins, or by one of its coefficient."""
        joint = self.layout({**layout.effects_of(model), name: given})
        theta = np.concatenate([model.theta, joint.mean[len(model.theta) :]])
        try:
            if not given:
                return self._slope(joint, theta, len(theta) - 1)
            begun = self.predicted(joint, self.balanced(joint, theta))
        except ModelError:
            return np.zeros(len(now.values))
        return np.asarray(begun.values - now.values)

    def _whitened(self, layout: Layout, model: Model, both: Array, now: Predicted) -> tuple[Array, Array]:
        """Rows (m, k + 2) of the readings that count, in the order of what they wander along: derivatives, error, the
        logarithm of its deviation; and the error (n,) of all that count, NaN where a reading is not known.
        """
        walk = (model.noise.force / self.noise) ** 2
        free = now.free[:, np.any(now.free != 0.0, axis=0)]
        if free.shape[1]:
            told = self.told[now.known[self.told]]
            shares, _ = whitened(np.column_stack([free, both])[told], self.along[told], walk)
            m = free.shape[1]
            both = both - free @ np.linalg.lstsq(shares[:, :m], shares[:, m:], rcond=None)[0]
        counted = self.counted[now.known[self.counted]]
        rows, deviation = whitened(both[counted] / self.noise, self.along[counted], walk)
        if free.shape[1] and len(self.told) == len(self.counted):  # what was fitted is less than what it was
            rows *= np.sqrt(len(rows) / max(len(rows) - free.shape[1], 1))
        left = np.where(now.known, both[:, -1], np.nan)[self.counted]
        return np.column_stack([rows, np.log(self.noise * deviation)]), left


def whitened(series: Array, along: Array, walk: float) -> tuple[Array, Array]:
    """Innovations (n, k), over their deviations (n,), of series that are white noise of deviation one and a random walk
    of variance `walk` by one of `along`, in the order of that.

    The walk begins at zero with the first: a constant in the series is its start.  Differences from one to the next
    have a covariance with one line beside the diagonal, whose Cholesky factor is that of the Kalman filter.
    """
    order = np.argsort(along, kind="stable")
    steps = np.diff(series[order], axis=0, prepend=0.0)
    covariance = np.full((2, len(order)), -1.0)
    covariance[0] = np.concatenate([[1.0], 2.0 + walk * np.diff(along[order])])
    factor = cholesky_banded(covariance, lower=True)
    return np.asarray(solve_banded((1, 0), factor, steps)), np.asarray(factor[0])
