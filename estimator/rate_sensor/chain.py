"""What a rate sensor is predicted to read: the chain from rate to volts with the effects that it has."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estimator.diagnosis import Interval
from estimator.effects.labels import kind
from estimator.rate_sensor.agreement import Line, against
from estimator.rate_sensor.catalogue import EFFECTS, effect_for
from estimator.rate_sensor.declaration import Effect, Range, Stage
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import Check, Evaluation, Model
from estimator.trace.output_error import OutputError, OutputLayout, Predicted, Rows
from estimator.trace.problem import Effects
from estimator.trace.search import FORBIDDEN

ONE_OF = ({"saturation", "soft_saturation", "fold_back"}, {"lag", "second_order"})
"""Kinds of which a sensor has one: its limit, its low-pass."""
WIDE = 1e3
"""Of what full rate gives, prior deviation of the line: the record tells it."""
BEND = 8.0
"""A rate that is straight between its samples misses at most an eighth of its second difference."""


EDGE = 0.05
"""Of the largest rate that was fitted: rates held out so much beyond it were not to be learnt."""
SAME, RESTS, LINE = 0.02, 0.01, 3
"""Of the declared range, rates that are one steady rate; of the samples, fewer of which only pass through it; and how
many steady rates show no curve.
"""


def volts_of(given: Sequence[tuple[Effect, Array]], line: Array, record: SensorRecord, declared: Range) -> Array:
    """Output (n,) of the whole record: V = V0 + S Ω, line being (V0, S), with effects and their coefficients."""
    rate = record.rate
    for effect, c in sorted(given, key=lambda pair: pair[0].stage):
        if effect.stage in (Stage.REFERENCE, Stage.RATE):
            rate = effect.act(rate, c, record, declared)

    def added(stage: Stage) -> Array:
        acting = [effect.act(rate, c, record, declared) for effect, c in given if effect.stage is stage]
        return np.asarray(sum(acting, np.zeros(len(record))))

    volts = line[0] + line[1] * (rate + added(Stage.CHARACTERISTIC)) + added(Stage.SURROUNDINGS)
    for effect, c in given:
        if effect.stage is Stage.LIMIT:
            volts = effect.act(volts, c, record, declared)
    return np.asarray(volts)


@dataclass(frozen=True)
class RateSensor(OutputError):
    """`Likelihood` of a record; line: that of the data sheet."""

    record: SensorRecord
    declared: Range
    line: Line | None = None
    base = "V0", "S"

    @property
    def reading(self) -> Array:
        """Output (n,) V."""
        return self.record.voltage

    @cached_property
    def along(self) -> Array:
        """Time (n,) s; of a table, the rate, of which its output may be any curve."""
        return self.record.rate if self.record.step is None else self.record.time

    def upto(self, samples: int) -> "RateSensor":
        return replace(self, record=self.record.upto(samples))

    @cached_property
    def seen(self) -> SensorRecord:
        """The record as a search may look at it: no reading beyond those that are fitted."""
        low, high = np.min(self.reading[self.told]), np.max(self.reading[self.told])
        return replace(self.record, voltage=np.clip(self.reading, low, high))

    def effect(self, name: str) -> Effect:
        return effect_for(kind(name))

    def layout(self, effects: Effects) -> OutputLayout:
        """V0 and S, then the coefficients of each effect in turn."""
        base = [self.declared.volts, self.declared.volts / self.declared.rate]
        rows = [row for name, given in effects.items() for row in self._places(name, given)]
        owner, names, start, least, most, size = zip(*rows, strict=True) if rows else ((),) * 6
        factor = np.array([*base, *size])
        span = np.array([*(WIDE * one for one in base), *(0.5 * (b - a) for a, b in zip(least, most, strict=True))])
        return OutputLayout(
            names=("V0", "S", *names), owner=("", "", *owner),
            mean=np.array([0.0, 0.0, *start]) / factor, deviation=span / factor,
            least=np.array([-np.inf, -np.inf, *least]) / factor, most=np.array([np.inf, np.inf, *most]) / factor,
            factor=factor, effects=effects,
        )  # fmt: skip

    def _places(self, name: str, given: Mapping[str, float]) -> Iterator[tuple[str, str, float, float, float, float]]:
        """Of an effect's coefficients: owner, name, start, bounds, size."""
        effect = self.effect(name)
        for one, (low, high) in zip(effect.coefficients, effect.bounds(self.seen, self.declared), strict=True):
            start = given.get(one.name, 0.0)
            size = start if one.positive and start > 0.0 else 0.5 * (high - low)
            yield name, one.name, start, low, high, size

    def given(self, layout: OutputLayout, theta: Array) -> list[tuple[Effect, Array]]:
        """Effects with their coefficients, SI."""
        values = theta * layout.factor
        return [(self.effect(name), values[layout.of(name)]) for name in layout.effects]

    def predicted(self, layout: OutputLayout, theta: Array) -> Predicted:
        """Volts; what a start that was not at rest adds; which of them the record tells all of."""
        given, record = self.given(layout, theta), self.record
        values = volts_of(given, theta[:2] * layout.factor[:2], record, self.declared)
        free = [effect.transient(c, record) for effect, c in given if effect.transient]
        reach = sum(effect.reaches(c) for effect, c in given if effect.reaches)
        known = np.ones(len(record), dtype=bool)
        if reach > 0.0:
            for stretch in record.stretches:
                known[stretch] = record.time[stretch] - record.time[stretch][0] >= reach
        return Predicted(values, np.concatenate([np.zeros((len(record), 0)), *free], axis=1), known)

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """Every effect that the record has what it needs for, from each of its starts."""
        taken = {kind(name) for name in model.effects}
        taken |= set().union(*(alternatives for alternatives in ONE_OF if taken & alternatives))
        found: dict[str, Mapping[str, float]] = {}
        for effect in EFFECTS:
            if effect.name in taken or not effect.applies_to(self.record) or (effect.is_curve and not self.shows_curve):
                continue
            if effect.is_linear:
                found[effect.name] = {}
                continue
            names = [one.name for one in effect.coefficients]
            for number, start in enumerate(effect.starts(self.seen, self.declared), start=1):
                found[f"{effect.name}:{number}"] = dict(zip(names, start, strict=True))
        return found

    @cached_property
    def shows_curve(self) -> bool:
        """Whether the record rests at more than three rates: a curve through three is a line and one number."""
        classes = np.round(self.record.rate[self.told] / (SAME * self.declared.rate))
        _, counts = np.unique(classes, return_counts=True)
        return int(np.sum(counts >= RESTS * len(self.told))) > LINE

    def balanced(self, layout: OutputLayout, theta: Array) -> Array:
        """With the line as it fits beside the effects; beside a limit, at rates within the declared range: one through
        samples at a limit is far from it.
        """
        given = [(effect, c) for effect, c in self.given(layout, theta) if effect.stage is not Stage.LIMIT]
        rows = self.told if len(given) == len(layout.effects) else self.within
        none, one = (volts_of(given, np.array([0.0, s]), self.record, self.declared)[rows] for s in (0.0, 1.0))
        matrix = np.column_stack([np.ones(len(rows)), one - none])
        line = np.linalg.lstsq(matrix, self.record.voltage[rows] - none, rcond=None)[0]
        return np.concatenate([line / layout.factor[:2], theta[2:]])

    @property
    def within(self) -> Rows:
        """Which of the fitted readings are at rates within the declared range; all, where those tell no line."""
        rate = self.record.rate[self.told]
        within = np.abs(rate) <= self.declared.rate * (1.0 + 1e-9)
        return self.told[within] if within.any() and np.ptp(rate[within]) > 0.0 else self.told

    def interval(self, model: FittedModel, k: int) -> Interval:
        """SI, but for the output's own unit."""
        owner, units = model.layout.owner[k], {"V0": "V", "S": "V·s/rad"}
        if owner:
            units = {one.name: one.unit for one in self.effect(owner).coefficients}
        return model.interval(k, units[model.layout.names[k]].replace("V", self.declared.unit))

    def checks(self, model: FittedModel) -> list[Check]:
        """The declared line, the limits, and whether the rate is known between its samples."""
        base = {name: self.interval(model, k) for k, name in enumerate(self.base)}
        off = () if self.line is None else against(base, self.line)
        checks = [Check("declared line", passed=False, sentence=one) for one in off]
        effects = {name: self.effect(name) for name in model.model.effects}
        checks += [self._limit(name, model) for name, effect in effects.items() if effect.stage is Stage.LIMIT]
        timed = any(effect.needs == "time" and effect.stage <= Stage.RATE for effect in effects.values())
        return [*checks, *(self._between_samples(abs(base["S"].value)) if timed else ())]

    def _limit(self, name: str, model: FittedModel) -> Check:
        """No reading of the part held out lies beyond a limit of the output."""
        low, high = (self.interval(model, k) for k in model.layout.of(name)[:2])
        margin, unit = FORBIDDEN * self.floor[0], self.declared.unit
        readings = self.record.voltage[self.counted]
        lowest, highest = float(np.min(readings)), float(np.max(readings))
        end, read = (high.high, highest) if highest > high.high + margin else (low.low, lowest)
        return Check(
            "limit", bool(lowest >= low.low - margin and highest <= high.high + margin),
            f"{kind(name).replace('_', ' ')} ends at {end:.4g} {unit}, and the part held out reads {read:.4g} {unit}",
            name,
        )  # fmt: skip

    def _between_samples(self, scale: float) -> Iterator[Check]:
        """The model of a response takes the rate as straight between its samples."""
        bends = [np.diff(self.record.rate[stretch], 2) for stretch in self.record.stretches]
        bent = scale * float(np.median(np.abs(np.concatenate(bends)))) / BEND
        yield Check(
            "between samples",
            bent <= self.floor[0],
            f"the rate bends by {bent:.3g} between its samples, more than the noise of {self.floor[0]:.3g}, and the "
            "model of a response takes it as straight: sample faster, or turn more slowly",
        )

    def remarks(self) -> tuple[str, ...]:
        fitted, later = (float(np.max(np.abs(self.record.rate[rows]))) for rows in (self.told, self.counted))
        if later <= (1.0 + EDGE) * fitted:
            return ()
        return ("the rates held out lie beyond those of the fitting part, which cannot tell what happens there",)


def noise_floor(record: SensorRecord, rows: Rows, noise: float) -> tuple[float, float, str]:
    """Rms scatter of repeated rates where steady states repeat any, else the declared noise, V; of how many independent
    differences it is; how it was found.
    """
    if record.step is None:
        rates, group = np.unique(np.round(record.rate[rows], 9), return_inverse=True)
        volts = record.voltage[rows]
        means = np.bincount(group, volts) / np.bincount(group)
        scatter, freedom = float(np.sum((volts - means[group]) ** 2)), len(volts) - len(rates)
        if freedom > 0 and scatter > 0.0:
            return math.sqrt(scatter / freedom), float(freedom), "the scatter of repeated rates"
    return noise, math.inf, "the declared noise"
