"""The likelihood of several records: the sum of theirs, with what they share in common."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import accumulate
from typing import Self

import numpy as np

from estimator.diagnosis import Fit
from estimator.effects.catalogue import EFFECTS
from estimator.effects.search import Search
from estimator.scaling import Array
from estimator.side_by_side import side_by_side
from estimator.trace.examination import Examination
from estimator.trace.filtered import Filtered
from estimator.trace.free_run import TELLING, FreeRun
from estimator.trace.likelihood import (
    Beginning,
    Described,
    Evaluation,
    Layout,
    Model,
    Size,
    observer_of,
    reach_of,
)
from estimator.trace.pool import Level, Member, Pool
from estimator.trace.pooled_layout import (
    Dependence,
    Part,
    PooledLayout,
    constant_of,
    dependence,
    of_records,
    own_name,
)
from estimator.trace.problem import Effects

BEGINNING = 4
"""Share, one to so many, of a record held out that tells where its free run begins."""
REACHED = (Search.LIMITS, Search.BANDS, Search.LEVELS)
"""Searches whose thresholds hang on how far drive and motion go."""


@dataclass(frozen=True)
class Pooled(Filtered):
    """`Likelihood` of several records that a filter follows; judges: those that are held out, behind the others.

    problem: that of the record that is driven hardest, whose device and settings are those of all.  A part of a pool is
    the beginning of each record.
    """

    parts: tuple[Part, ...] = ()
    judges: tuple[Part, ...] = ()
    level: Level = field(default_factory=Level)

    @property
    def samples(self) -> int:
        return sum(part.of.samples for part in (*self.parts, *self.judges))

    @property
    def fitted_samples(self) -> int:
        """Of the records that are fitted."""
        return sum(part.of.samples for part in self.parts)

    @property
    def first(self) -> int:
        return sum(min(part.of.first, part.of.samples) for part in self.parts)

    def part(self, rows: slice) -> Self:
        """Of the records that are fitted the beginnings, so many samples in all; of those held out where the part
        begins behind the others.
        """
        begin, most = rows.start or 0, self.fitted_samples
        parts = self.judges if begin >= most else self.parts
        samples = (self.samples if rows.stop is None else rows.stop) - begin
        return replace(self, parts=tuple(_beginnings(parts, samples)), judges=())

    def layout(self, effects: Effects) -> PooledLayout:
        return PooledLayout(self.parts, self.level, effects)

    def effect(self, name: str) -> Described:  # type: ignore[override]
        """Declaration of an effect, each record's own coefficients by themselves; of a slope, its constant's unit."""
        constant = constant_of(name)
        if constant is not None:
            return Dependence((Size(constant, self._goes(constant)[1]),))
        effect = super().effect(name)
        if not any(c.own for c in effect.coefficients):
            return effect
        return effect.of_several([partial(own_name, record=part.name) for part in self.parts])

    def plausible(self, name: str) -> Array:
        """As each record has it; a slope is as large as its constant is uncertain."""
        constant = constant_of(name)
        if constant is None:
            alone = np.max([part.of.plausible(name) for part in self.parts], axis=0)
            own = [c.own for c in super().effect(name).coefficients]
            return np.repeat(alone, [len(self.parts) if each else 1 for each in own])
        return np.array([self._goes(constant)[0]])

    def _goes(self, constant: str) -> tuple[float, str]:
        """Of a constant or a coefficient how far it may be off, scaled, and its unit."""
        device, alone = self.problem.device, self.parts[0].of.layout(self.effects)
        for item in observer_of(self.problem, {}, None).model.constants:
            if item.name == constant:
                return float(alone.deviation[alone.names.index(constant)]), item.quantity.value
        coefficients = (c for effect in (*EFFECTS, *device.own) for c in effect.coefficients)
        found = next(c for c in coefficients if c.name == constant)
        return reach_of(self.problem) * found.plausible, found.unit

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        assert isinstance(layout, PooledLayout)
        asked = partial(self._of_record, layout, model, derivatives, tested or {})
        each = side_by_side([partial(asked, number) for number in range(len(self.parts))])
        return Evaluation.of_parts(each, tuple(part.name for part in self.parts))

    def _of_record(
        self, layout: PooledLayout, model: Model, derivatives: bool, tested: Effects, number: int
    ) -> Evaluation:
        """The pass over one record, by the parameters of all."""
        part, slopes = self.parts[number], [name for name in tested if constant_of(name) is not None]
        alone, chart = layout.of_record(part)
        by_constants = derivatives or bool(slopes)
        seen = part.of.evaluate(
            alone, Model(of_records(model.effects), chart @ model.theta, model.noise),
            derivatives=by_constants, tested=of_records(tested),
        )  # fmt: skip
        # A pass that was made already may have the derivatives that nobody asks for.
        rows, own = len(seen.names), len(alone.names) if seen.names[: len(alone.names)] == alone.names else 0
        names: list[str] = []
        columns: list[Array] = []
        if derivatives:
            names += layout.names
            columns += [np.concatenate([column, np.zeros(rows - own)]) for column in chart.T]
        counted: dict[str, int] = {}
        for k, name in enumerate(seen.names[own:], start=own):
            coefficient = part.of.effect(name).coefficients[counted.get(name, 0)]
            counted[name] = counted.get(name, 0) + 1
            unit = np.eye(rows)[k]
            for other in range(len(self.parts)) if coefficient.own else (number,):
                names.append(name)
                columns.append(unit if other == number else np.zeros(rows))
        for name in slopes:
            constant = constant_of(name)
            names.append(name)
            columns.append(part.z * np.eye(rows)[alone.names.index(str(constant))])
        by = np.array(columns).reshape(len(columns), rows).T
        return replace(seen, names=tuple(names), score=seen.score @ by, information=by.T @ seen.information @ by)

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """Thresholds as the record suggests them that reaches farthest, all else as the one does that the model leaves
        the most of; and what may go with the covariate.
        """
        layout = self.layout(model.effects)
        ends = list(accumulate(part.of.samples for part in self.parts))
        with np.errstate(invalid="ignore"):
            left = [
                float(np.nanmean((evaluation.innovation[a:b] / evaluation.deviation[a:b]) ** 2))
                for a, b in zip([0, *ends], ends, strict=False)
            ]
        reach = [float(np.nanmax(np.abs(part.of.problem.record.sense))) for part in self.parts]
        found: dict[str, Mapping[str, float]] = {}
        for number, reached in ((int(np.argmax(left)), False), (int(np.argmax(reach)), True)):
            part = self.parts[number]
            _, chart = layout.of_record(part)
            alone = Model(of_records(model.effects), chart @ model.theta, model.noise)
            seen = evaluation.shown(slice(ends[number] - part.of.samples, ends[number]))
            proposed = part.of.candidates(alone, seen)
            found |= {name: given for name, given in proposed.items() if (self._search(name) in REACHED) is reached}
        if self.level.covariate is not None:
            goes = [dependence(name, self.level.covariate) for name in layout.linear]
            found |= {name: {} for name in goes if name not in model.effects}
        return found

    def _search(self, name: str) -> Search | None:
        return super().effect(name).search

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        pieces = [partial(self._examined, part, constants, effects) for part in (*self.parts, *self.judges)]
        each, fitted = side_by_side(pieces), len(self.parts)
        return Examination(
            _joined([fit for one in each[:fitted] for fit in (one.fitted, one.held_out)]),
            _joined([fit for one in each[fitted:] for fit in (one.fitted, one.held_out)]),
            (),
            np.concatenate([one.residual for one in each]),
            each[0].estimates,
            each[0].settled,
            each[0].problem,
        )

    def _examined(self, part: Part, constants: Mapping[str, float], effects: Effects) -> Examination:
        carried = of_records(effects)
        for name, given in effects.items():
            constant = constant_of(name)
            for own in carried.values():
                if constant in own:
                    own[constant] += given[constant] * (part.covariate - self.level.mean)
        return part.of.examined(constants, carried, part.of.samples // 2)


@dataclass(frozen=True)
class PooledFreeRun(Pooled, FreeRun):
    """The same of records by their free runs."""

    @property
    def following(self) -> "PooledFreeRun":
        parts = tuple(part._replace(of=part.of.following) for part in self.parts if isinstance(part.of, FreeRun))
        return replace(self, followed=True, parts=parts)


def pooled(fit: Pool, judges: Pool, kind: type[Filtered]) -> Pooled:
    """The likelihood of the records that are fitted, with those held out behind them; kind: of a record by itself.

    Temperatures count from the first that was measured on any of them.
    """
    level = Level.of(fit)
    warm = next((m.record.channels["temperature"] for m in fit.members if "temperature" in m.record.channels), None)
    beginning = Beginning(0.0, None if warm is None else float(warm[0]))

    def part(pool: Pool, member: Member) -> Part:
        of = kind(pool.problem(member), beginning)
        return Part(member.name, of, member.covariate, level.scaled(member.covariate))

    made = PooledFreeRun if issubclass(kind, FreeRun) else Pooled
    return made(
        problem=fit.hardest,
        beginning=beginning,
        parts=tuple(part(fit, member) for member in fit.members),
        judges=tuple(_judging(part(judges, member)) for member in judges.members),
        level=level,
    )


def _judging(part: Part) -> Part:
    """A record that is held out: where a free run of it begins is told by its first quarter."""
    if not isinstance(part.of, FreeRun):
        return part
    return part._replace(of=replace(part.of, alone=True, telling=max(part.of.samples // BEGINNING, TELLING)))


def _beginnings(parts: Sequence[Part], samples: int) -> Iterator[Part]:
    """The beginning of each, as long as may be for so many samples in all."""
    lengths = np.sort([part.of.samples for part in parts])
    length, left = 0, samples
    for number, longest in enumerate(lengths):
        length = min(int(longest), left // (len(lengths) - number))
        left -= length
    for part in parts:
        yield part if part.of.samples <= length else part._replace(of=part.of.part(slice(0, length)))


def _joined(fits: Sequence[Fit]) -> Fit:
    """How well several parts are predicted, rms over them."""

    def rms(values: Sequence[float | None]) -> float | None:
        told = [value for value in values if value is not None]
        return float(np.sqrt(np.mean(np.square(told)))) if len(told) == len(values) else None

    def of(name: str) -> tuple[float, ...]:
        return tuple(np.sqrt(np.mean(np.square([getattr(fit, name) for fit in fits]), axis=0)).tolist())

    return Fit(
        of("innovation_rms"), of("noise_floor"), float(np.sqrt(np.mean([fit.ratio**2 for fit in fits]))),
        min(fit.whiteness_p for fit in fits), rms([fit.simulation_rmse for fit in fits]),
        rms([fit.angle_error_rms for fit in fits]), rms([fit.rate_error_rms for fit in fits]), fits[0].floor_from,
    )  # fmt: skip
