"""The likelihood of a driven gyro or oscillator: innovations of its filter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from estimator.core.following import Portion
from estimator.core.likelihood import Pass, Samples
from estimator.effects.catalogue import effect_for
from estimator.effects.declaration import Effect
from estimator.scaling import Array, Scaling
from estimator.side_by_side import stop_if_abandoned
from estimator.trace.candidates import candidates
from estimator.trace.examination import Examination, examine
from estimator.trace.likelihood import (
    BLOCKS,
    Beginning,
    Evaluation,
    Layout,
    Likelihood,
    Model,
    Noise,
    ObserverLayout,
    observer_of,
    reach_of,
)
from estimator.trace.noise import MEDIAN_OF_SQUARE
from estimator.trace.problem import Effects, Problem
from estimator.trace.start import begin_moving

FIRST = 2500
"""Samples of the beginning that is fitted first."""
FORCE_DECADES = 8.0
"""Above what is declared that a random force may be: at the top, a filter follows whatever moves."""
RATE_DECADES = 2.0
"""Above the declared random walk of the rate.  Not below: the rate may do later what it did not do yet."""
CLOSE, ROUGH = 0.5, 1.0
"""Decades to which a level is found: the likelihood of any parameter is flat beside that."""
QUIET = 1e-9
"""Of the scaled units: a random force or rate that is none."""
START_CYCLES = 3.0
"""What the start of a filter tells depends on how it was begun: it does not count."""
KEPT = 24
"""Passes over a record that are kept, the last: a search comes back to a model within a round."""
NOTHING: NDArray[np.int64] = np.zeros(0, np.int64)
"""Constants of which no sensitivity is followed."""


@dataclass(frozen=True)
class Filtered(Likelihood):
    """`Likelihood` of a problem whose motion is followed by a filter."""

    problem: Problem
    beginning: Beginning = field(default_factory=Beginning)
    _parts: dict[tuple[int, int], "Filtered"] = field(default_factory=dict, init=False, repr=False, compare=False)
    _passes: dict[tuple[object, bool], Evaluation] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def effects(self) -> Effects:
        return self.problem.effects

    @property
    def axes(self) -> int:
        return self.problem.device.axes

    @property
    def samples(self) -> int:
        return len(self.problem.record)

    @property
    def first(self) -> int:
        return FIRST

    def part(self, rows: slice) -> "Filtered":
        rows = slice(*rows.indices(self.samples))
        if rows == slice(0, self.samples, 1):
            return self
        key = rows.start, rows.stop
        if key not in self._parts:
            self._parts[key] = self._part(rows)
        return self._parts[key]

    def _part(self, rows: slice) -> "Filtered":
        record = self.problem.record
        first = self.beginning.temperature
        if first is None and "temperature" in record.channels:
            first = float(record.channels["temperature"][0])
        seconds = self.beginning.seconds + float(np.sum(record.step[: rows.start or 0]))
        return Filtered(self.problem.part(rows), Beginning(seconds, first))

    def layout(self, effects: Effects) -> Layout:
        return ObserverLayout(self.problem, effects)

    def effect(self, name: str) -> Effect:
        """Declaration of an effect of the catalogue, or of one beside it."""
        return effect_for(name, self.axes, self.problem.device.own)[1]

    def plausible(self, name: str) -> Array:
        """As the effect's declaration has it, of what is driven as hard as this record."""
        return reach_of(self.problem) * np.array([one.plausible for one in self.effect(name).coefficients])

    def begun(self, layout: Layout, theta: Array, name: str, size: Array) -> Array:
        """At the size that the score test tells; a corner that would be negative begins where it was tested."""
        theta = theta.copy()
        for k, told in zip(layout.of(name), size, strict=False):
            theta[k] = max(layout.mean[k] + told, layout.least[k])
            if k in layout.tied and theta[k] <= 0.0:
                theta[k] = layout.tied[k][2] / layout.factor[k]
        return theta

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        """A pass over the record.  Raises ModelError as `Observer` does."""
        key = (repr(model.effects), model.theta.tobytes(), model.noise, repr(tested))
        # A pass with derivatives has all of one without.
        found = self._passes.get((key, True)) or self._passes.get((key, derivatives))
        if found is None:
            found = self._passes[key, derivatives] = self._evaluated(layout, model, derivatives, tested)
            for oldest in list(self._passes)[:-KEPT]:
                self._passes.pop(oldest, None)
        return found

    def _evaluated(self, layout: Layout, model: Model, derivatives: bool, tested: Effects | None) -> Evaluation:
        assert isinstance(layout, ObserverLayout)
        shifts, tested = layout.shifted(model) if derivatives else [], tested or {}
        others = [self._over(layout, moved).white for moved, _ in shifts]
        known = layout.index if derivatives else layout.index[:0]
        seen = self._over(layout, model, known, tested, others, [step for _, step in shifts])
        # In the order of names: the model's own, its searched parameters, what is tested; the innovation is among them.
        c, k = len(known), seen.delta.shape[1]
        column = dict(zip(layout.by_difference, range(k + 1, k + 1 + len(shifts)), strict=False))
        order = [*(column.get(place, place) for place in range(c + len(layout.searched) * derivatives)), *range(c, k)]
        scaling = Scaling.of(self.problem.device)
        volts = np.array([scaling.sense(axis) for axis in range(self.axes)])
        deviation = np.sqrt(np.where(seen.variance > 0.0, seen.variance, np.nan)) * np.abs(volts)
        by = [name for name in tested for _ in self.effect(name).coefficients]
        with np.errstate(over="ignore", invalid="ignore"):
            gram = seen.gram
        return Evaluation(
            (*(layout.names if derivatives else ()), *by),
            # A column is what the innovation gains for one of a parameter: less than the prediction's derivative.
            -gram[:, order, k], gram[:, order][:, :, order], gram[:, k, k], seen.logs, seen.counted.astype(float),
            np.where(np.isfinite(self.problem.record.sense), seen.innovation * volts, np.nan), deviation,
        )  # fmt: skip

    def _over(
        self,
        layout: ObserverLayout,
        model: Model,
        known: NDArray[np.int64] = NOTHING,
        tested: Effects | None = None,
        others: Sequence[Array] = (),
        shifts: Sequence[float] = (),
    ) -> Pass:
        """A filter's pass over the record: with the sensitivities of constants that it knows (indices `known`), of the
        coefficients of effects that it lacks, and of models that are shifted.
        """
        record = self.problem.record
        observer = observer_of(self.problem, layout.effects_of(model), model.noise, tested)
        observer.x[observer.states + layout.index] = model.theta[: len(layout.index)]
        begin_moving(observer, record)
        observer.begin_at(self.beginning.seconds, self.beginning.temperature)
        z, u, h, warmth = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
        observer.allow_steps(float(np.max(h, initial=observer.h)), u.shape[2] - 1)
        skip = int(np.ceil(START_CYCLES * 2.0 * np.pi / observer.h))
        watched = sum(len(effect.coefficients) for _, effect in observer.effects[observer.carried :])
        rows = observer.states + len(observer.active)
        samples = Samples(Portion(z, u, h, warmth), np.linspace(0, len(record), BLOCKS + 1).astype(np.int64), skip)
        found = Pass(samples, rows, known, watched, others, shifts)
        gaps = record.gaps
        added = {} if gaps is None else dict(zip((gaps.last + 1).tolist(), gaps.spread, strict=True))
        for begin, end in pairwise([0, *sorted({*added, len(record)})]):
            stop_if_abandoned()
            found.advance(observer, begin, end)
            if end in added:
                observer.unsettle(added[end])
        return found

    def disturbed(self, layout: Layout, model: Model) -> tuple[Model, Model]:
        return replace(model, noise=replace(model.noise, force=self.declared_noise().force)), model

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        """What the bench's observer, which finds the constants itself, makes of the record with these effects."""
        return examine(self.problem.carrying(effects), split)

    def above_floor(self, held_out: Evaluation, after: Examination | None) -> float:
        """As the bench's own observer has it."""
        return after.held_out.ratio if after is not None else float(np.sqrt(held_out.scale))

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """The whole catalogue beside a model, those with parameters where the record suggests them."""
        return candidates(self.problem, model.effects, evaluation)

    def declared_noise(self) -> Noise:
        """What the bench declares; where it declares no random force or rate, a level that is none."""
        process, none = self.problem.settings.process_noise, self.no_disturbance()
        return replace(none, force=max(process.force, none.force), rate=max(process.rate, none.rate))

    def no_disturbance(self) -> Noise:
        """The declared noise of the sensors, with a random force and a rate that are none."""
        device = self.problem.device
        omega = float(np.sqrt(device.target))
        return Noise((1.0,) * device.axes, QUIET * device.amplitude * omega**1.5, QUIET * omega**1.5)

    def at_first(self, layout: Layout, model: Model) -> Model:
        """The model with the decade of random force that makes the record most probable, of all of them: at a small one
        a filter may lose the motion for what the model lacks, and its likelihood says nothing of a larger.
        """
        least, most = self._decades
        return self.likeliest(layout, [self._of_force(model, float(value)) for value in np.arange(least, most, ROUGH)])

    def quieten(self, layout: Layout, model: Model) -> Model:
        return self._with_force(layout, model, ROUGH)

    def fit_noise(self, layout: Layout, model: Model) -> Model:
        """The model with levels of noise that make the record most probable: sense by axis, random force, rate.

        A model that lacks something has a random force in its place, as large as what it leaves.
        """
        model = self.likeliest(layout, (model, self._balanced(layout, model)))
        model = self._with_force(layout, model, CLOSE)
        if self.axes == 1:
            return model
        declared = float(np.log10(self.declared_noise().rate))

        def with_rate(value: float) -> Model:
            return replace(model, noise=replace(model.noise, rate=float(10.0**value)))

        start = float(np.log10(model.noise.rate))
        return self.at_level(layout, with_rate, start, (declared, declared + RATE_DECADES), ROUGH)

    def _with_force(self, layout: Layout, model: Model, close: float) -> Model:
        """The model with the random force next to its own that makes the record most probable."""
        start = float(np.log10(model.noise.force))
        return self.at_level(layout, partial(self._of_force, model), start, self._decades, close)

    @property
    def _decades(self) -> tuple[float, float]:
        """Between which a random force is looked for."""
        least = float(np.log10(self.declared_noise().force))
        return least, least + FORCE_DECADES + float(np.log10(reach_of(self.problem)))

    def _of_force(self, model: Model, decade: float) -> Model:
        declared = self.declared_noise().force
        force = declared if decade == float(np.log10(declared)) else float(10.0**decade)  # not rounded: another model
        return replace(model, noise=replace(model.noise, force=force))

    def _balanced(self, layout: Layout, model: Model) -> Model:
        """With the sense noise of each axis as its innovations have it beside the others'."""
        seen = self.evaluate(layout, model, derivatives=False)
        with np.errstate(invalid="ignore"):
            power = np.nanmedian((seen.innovation / seen.deviation) ** 2, axis=0) / MEDIAN_OF_SQUARE
        if not np.all(np.isfinite(power)) or not np.all(power > 0.0):
            return model
        share = np.sqrt(power / np.exp(np.mean(np.log(power))))
        return replace(model, noise=replace(model.noise, sense=tuple((np.array(model.noise.sense) * share).tolist())))
