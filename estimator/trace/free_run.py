"""The likelihood of a free run: what the model says a record should have been, given its start and its drive.

The filter's own pass without a random force and with a start that is known: its gain is zero, an innovation is what a
run that nothing corrects is off.  The start is among the parameters.  What such a run leaves is seldom white; the
record then counts for as many samples as its error has independent ones.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.chance import chi2_isf
from estimator.core.following import Portion, Signatures, scan_block
from estimator.correlation import effective_samples
from estimator.effects.declaration import Effect
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.side_by_side import stop_if_abandoned
from estimator.simulation import REMEMBERED, simulate
from estimator.trace.candidates import candidates
from estimator.trace.examination import Examination, examine
from estimator.trace.filtered import ROUGH, Filtered
from estimator.trace.fit import PASSES
from estimator.trace.likelihood import (
    AT_FLOOR,
    RARE,
    Beginning,
    Evaluation,
    Layout,
    Model,
    Noise,
    ObserverLayout,
    observer_of,
)
from estimator.trace.problem import Effects, Problem

TELLING = 50
"""Samples that tell where a part begins that was not fitted; they do not count."""
HALF_TURN = np.pi
"""Phase over which a wrong stiffness has not lost count of the cycles: so long is what is fitted first."""
FEWEST = 64
"""Samples of that, at least."""
BLIND = 1e-9
"""Of the largest singular value, below which a part says nothing of a direction of its start."""


class StartLayout(ObserverLayout):
    """A layout with the start of the record behind: motion, sense offsets, and a rate where the model has one.

    start (m,) places among the parameters.
    """

    def __init__(self, problem: Problem, effects: Effects) -> None:
        super().__init__(problem, effects)
        observer = observer_of(problem, effects, None)
        rows = observer.estimated_index
        mean, deviation = observer.x[rows].copy(), observer.initial_deviations
        given = set(problem.settings.initial)
        motion, sure = seen_motion(problem.record, observer)
        for k, name in enumerate(observer.names[: observer.states]):
            if name not in given:
                mean[k], deviation[k] = motion[k], min(deviation[k], sure[k])
        kept = deviation > 0.0
        self.kept = np.flatnonzero(kept)
        self.start = len(self.names) + np.arange(int(kept.sum()))
        self.names = (*self.names, *(observer.names[i] for i in rows[kept]))
        self.owner = (*self.owner, *("" for _ in self.start))
        self.mean = np.concatenate([self.mean, mean[kept]])
        self.deviation = np.concatenate([self.deviation, deviation[kept]])
        self.factor = np.concatenate([self.factor, observer.factors[rows][kept]])
        self.least = np.concatenate([self.least, np.full(len(self.start), -np.inf)])
        self.most = np.concatenate([self.most, np.full(len(self.start), np.inf)])
        self.fixed = mean

    def spread(self, share: float) -> Array:
        """As `Layout.spread`; the start in full: the record's first samples measured it, whatever comes after them."""
        spread = np.array(super().spread(share))
        spread[self.start] = self.deviation[self.start]
        return spread


def seen_motion(record: Record, observer: Observer) -> tuple[Array, Array]:
    """Scaled displacements and velocities (states,) one interval before the first sample, as the first samples show
    them: by the resonance, where they hold a cycle of it, else by a parabola; and how sure that is, the samples being
    off all the same way.
    """
    device, rows = observer.device, slice(0, TELLING)
    time, sense = np.cumsum(record.step[rows]), record.sense[rows]
    rings = 2.0 * np.pi / observer.h <= TELLING
    wave = observer.scaling.omega0 * time
    columns = [np.cos(wave), np.sin(wave) / observer.scaling.omega0, np.ones(len(time))]
    design = np.column_stack(columns if rings else [np.ones(len(time)), time, time**2])
    told = np.all(np.isfinite(sense), axis=1)
    if told.sum() <= design.shape[1]:
        return np.zeros(observer.states), np.full(observer.states, np.inf)
    found = np.linalg.lstsq(design[told], sense[told], rcond=None)[0]
    left = np.sqrt(np.mean((sense[told] - design[told] @ found) ** 2, axis=0))
    spread = np.sqrt(told.sum() * np.diagonal(np.linalg.inv(design[told].T @ design[told]))[:2])
    off = spread[:, None] * np.maximum(left, device.noise)
    factors = np.tile(np.asarray(device.sense_gain), (2, 1)).T.ravel() * observer.factors[: observer.states]
    return found[:2].T.ravel() / factors, off.T.ravel() / np.abs(factors)


@dataclass(frozen=True)
class FreeRun(Filtered):
    """`Likelihood` of a record by its free run; fitted: whether its start is that of the model's parameters, else its
    first samples, `telling` of them, tell it; alone: of no record that was fitted, so that these tell its offsets too;
    followed: whether the run is corrected for the random force that the record asks for.
    """

    fitted: bool = True
    followed: bool = False
    telling: int = TELLING
    alone: bool = False

    @property
    def first(self) -> int:
        """Samples over which the declared stiffness keeps count of the cycles."""
        settings, device = self.problem.settings, self.problem.device
        step = float(np.mean(self.problem.record.step))
        unsure = 0.5 * settings.spread.stiffness * float(np.sqrt(device.target)) * step
        return max(FEWEST, int(HALF_TURN / unsure)) if unsure > 0.0 else super().first

    @property
    def most(self) -> int:
        """Effects beside the declared: measured mechanisms have several."""
        return 6

    def _part(self, rows: slice) -> "FreeRun":
        """Behind the beginning, a part that is not fitted."""
        part = super()._part(rows)
        return replace(self, problem=part.problem, beginning=part.beginning, fitted=self.fitted and not rows.start)

    @property
    def following(self) -> "FreeRun":
        """The same with the random force that the record asks for: then a run does not lose the motion for what a model
        lacks, and tells it.
        """
        return replace(self, followed=True)

    def layout(self, effects: Effects) -> Layout:
        """The parameters of the model with these effects, and the start of the record."""
        return StartLayout(self.problem, effects)

    def disturbed(self, layout: Layout, model: Model) -> tuple[Model, Model]:
        """The model, and the same with the random force that the record asks for: none, where the run's error is no
        more than the noise that is declared.
        """
        seen = self.evaluate(layout, model, derivatives=False)
        if self.above_floor(seen, None) < AT_FLOOR:
            return model, model
        return model, self._with_force(layout, model, ROUGH)

    def examined(self, constants: Mapping[str, float], effects: Effects, split: int) -> Examination:
        """What the bench's observer makes of the record with these effects and from these constants on."""
        problem = self.problem.carrying(effects)
        initial = {**problem.settings.initial, **constants}
        return examine(replace(problem, settings=replace(problem.settings, initial=initial), controller=None), split)

    def above_floor(self, held_out: Evaluation, after: Examination | None) -> float:
        """The run's error over the noise that is declared, rms."""
        return float(np.sqrt(np.nanmean((held_out.innovation / np.asarray(self.problem.device.noise)) ** 2)))

    def chance(self, held_out: Evaluation) -> float:
        """A run's error remembers, so that few samples of it are independent."""
        left = held_out.innovation[np.all(np.isfinite(held_out.innovation), axis=1)]
        worth = sum(effective_samples(column) for column in left.T) if len(left) else 1.0
        return float(np.sqrt(chi2_isf(RARE, worth) / worth))

    def candidates(self, model: Model, evaluation: Evaluation) -> Effects:
        """The whole catalogue beside a model, with what depends on the way that the mass came."""
        found = candidates(self.problem, model.effects, evaluation, freely=True)
        if not np.any(self.problem.record.drive):
            found = {name: given for name, given in found.items() if not self._own_line(model, given)}
        if any(remembers(self.effect(name)) for name in model.effects):
            return {name: given for name, given in found.items() if not self.effect(name).slips}
        if any(self.effect(name).slips for name in model.effects):
            return {name: given for name, given in found.items() if not remembers(self.effect(name))}
        return found

    def _own_line(self, model: Model, given: Mapping[str, float]) -> bool:
        """Whether a line is one of the model's own modes, which ring without a drive."""
        if "omega" not in given:
            return False
        constants = dict(zip(self.layout(model.effects).names, model.theta.tolist(), strict=True))
        k = np.diag([constants.get(name, 0.0) for name in ("kxx", "kyy")[: self.axes]])
        k = k + constants.get("kxy", 0.0) * (1.0 - np.eye(self.axes))
        own = np.sqrt(np.abs(np.linalg.eigvalsh(k)) * self.problem.device.target)
        return bool(np.min(np.abs(own - given["omega"])) * self.problem.span < 2.0 * np.pi)

    def declared_noise(self) -> Noise:
        """That of the sensors: nothing disturbs a free run."""
        return self.no_disturbance()

    def at_first(self, layout: Layout, model: Model) -> Model:
        """The model as it is, or with the random force that makes the record most probable, of all."""
        return super().at_first(layout, model) if self.followed else model

    def quieten(self, layout: Layout, model: Model) -> Model:
        """The model as it is, or with about the random force that makes the record most probable."""
        return super().quieten(layout, model) if self.followed else model

    def fit_noise(self, layout: Layout, model: Model) -> Model:
        """The model with the noise of each axis and the share of independent samples as its error has them."""
        if self.followed:
            return super().fit_noise(layout, replace(model, noise=replace(model.noise, independent=1.0)))
        model = replace(model, noise=replace(model.noise, force=self.declared_noise().force))
        if self.axes > 1:
            model = self._balanced(layout, model)
        seen = self.evaluate(layout, model, derivatives=False)
        if not seen.sound:
            return model
        told = [column[np.isfinite(column)] for column in (seen.innovation / seen.deviation).T]
        share = float(np.mean([effective_samples(column) / len(column) for column in told]))
        return replace(model, noise=replace(model.noise, independent=share))

    def _evaluated(self, layout: Layout, model: Model, derivatives: bool, tested: Effects | None) -> Evaluation:
        assert isinstance(layout, StartLayout)
        stop_if_abandoned()
        slips = {name: given for name, given in (tested or {}).items() if self.effect(name).slips}
        others = {name: given for name, given in (tested or {}).items() if name not in slips}
        run = _Run(self, layout, model, derivatives, others)
        rows, names = run.over_all(), run.names
        if slips:
            way = _Run(self, layout, model, derivatives, slips)
            own = len(layout.names) - len(layout.searched) if derivatives else 0
            rows = np.column_stack([rows[:, :-2], way.over_all()[:, own:-2], rows[:, -2:]])
            names = (*names, *way.names[len(layout.names) if derivatives else 0 :])
        if derivatives and layout.by_difference:
            with np.errstate(invalid="ignore"):  # a run that is lost has no derivative
                shifted = [
                    (_Run(self, layout, moved, derivatives=False, tested={}).over_all()[:, 0] - rows[:, -2]) / step
                    for moved, step in layout.shifted(model)
                ]
            for place, column in zip(layout.by_difference, shifted, strict=True):
                rest = rows[:, place + (place in layout.tied) :]
                rows = np.column_stack([rows[:, :place], column, rest])
        whitened = rows.reshape(self.samples, self.axes, -1)
        with np.errstate(over="ignore", invalid="ignore"):
            deviation = np.exp(whitened[:, :, -1])
            innovation = whitened[:, :, -2] * deviation
        # Of a coloured error, n samples say as much as fewer that are independent.
        volts, share = run.observer.volts, model.noise.independent
        return Evaluation.of_rows(
            names, whitened, innovation * volts, deviation * np.abs(volts), weight=share, share=share
        )


def remembers(effect: Effect) -> bool:
    """Whether an effect depends on drives or readings of the past, which only the filter's pass carries."""
    return effect.delayed is not None or any(signal.source in REMEMBERED for signal in effect.signals)


class _Run:
    """A free run over a record, with its derivatives by the constants, by the start, and by effects in `tested`."""

    def __init__(self, of: FreeRun, layout: StartLayout, model: Model, derivatives: bool, tested: Effects) -> None:
        self.of, self.layout, self.model, self.tested = of, layout, model, tested
        self.record = of.problem.record
        self.effects = layout.effects_of(model)
        self.observer = self._observer(tested)
        self.known = layout.index if derivatives else layout.index[:0]
        self.moved = len(layout.kept) if derivatives else 0
        lacking = self.observer.effects[self.observer.carried :]
        self.names = (
            *(layout.names if derivatives else ()),
            *(effect.name for _, effect in lacking for _ in effect.coefficients),
        )
        self.slips = any(effect.slips for _, effect in self.observer.effects)

    def _observer(self, tested: Effects) -> Observer:
        observer = observer_of(self.of.problem, self.effects, self.model.noise, tested)
        observer.x[observer.states + self.layout.index] = self.model.theta[: len(self.layout.index)]
        observer.x[observer.estimated_index] = self.layout.fixed
        observer.x[observer.estimated_index[self.layout.kept]] = self.model.theta[self.layout.start]
        return observer

    def over_all(self) -> Array:
        """Whitened rows (axes · n, k + 2) of all stretches: derivatives, error, logarithm of the deviation; the last is
        NaN where a sample does not count.
        """
        return np.concatenate([self._over(stretch, first=number == 0) for number, stretch in enumerate(self.stretches)])

    @property
    def stretches(self) -> list[slice]:
        """Parts that gaps keep apart."""
        return list(self.record.stretches) or [slice(0, len(self.record))]

    def _over(self, stretch: slice, *, first: bool) -> Array:
        record, before = self.record.part(stretch), self.of.part(slice(stretch.start, None)).beginning
        start = self.observer.x[self.observer.estimated_index].copy()
        if first and self.of.fitted:
            return self._run(record, before, start, self.known, self.moved, self.tested)
        states = self.observer.states
        telling = record if self.of.fitted else record.part(slice(0, self.of.telling))
        start[:states], _ = seen_motion(telling, self.observer)
        start = self._told(telling, before, start)
        rows = self._run(record, before, start, self.known, self.moved, self.tested)
        c = len(self.known)
        if self.moved and len(rows):
            own = np.array([*self.own, *(c + np.flatnonzero(np.isin(self.layout.kept, self.of_start)))])
            seen = np.flatnonzero(~np.isnan(rows[:, -1]))
            others = np.setdiff1d(np.arange(rows.shape[1] - 2), own)
            answer = np.linalg.lstsq(rows[np.ix_(seen, own)], rows[np.ix_(seen, others)], rcond=BLIND)[0]
            rows[:, others] -= rows[:, own] @ answer
            rows[:, own] = 0.0
        if not self.of.fitted:
            rows[: self.of.telling * self.of.axes, -1] = np.nan
        return rows

    @property
    def of_start(self) -> NDArray[np.int64]:
        """What of a start a part tells that was not fitted: the motion, and of a record by itself all else."""
        states = np.arange(self.observer.states)
        return np.union1d(states, self.layout.kept) if self.of.alone else states

    @property
    def own(self) -> list[int]:
        """Coefficients of where a record begins, which one by itself tells with its start."""
        names = {c.name for effect in self.layout.effects for c in effect.coefficients if c.own}
        return [k for k in range(len(self.layout.index)) if self.of.alone and self.layout.names[k] in names]

    def _told(self, record: Record, before: Beginning, start: Array) -> Array:
        """The start whose run lies closest to a record, and in the model the coefficients of where it begins; beside
        the motion, as sure beforehand as they are declared.
        """
        own, states, layout = self.own, self.observer.states, self.layout
        m, rows_of = len(own), self.of_start
        beside = [int(np.flatnonzero(layout.kept == k)[0]) for k in rows_of[states:].tolist()]
        deviation = np.concatenate(
            [layout.deviation[own], np.full(states, np.inf), layout.deviation[layout.start[beside]]]
        )
        given = np.concatenate([layout.mean[own], start[rows_of]])
        now = np.concatenate([self.model.theta[own], start[rows_of]])
        nearest, least = now, np.inf
        for _ in range(PASSES):
            rows = self._run(record, before, self._begin(start, now), layout.index[own], -1, {})
            told = rows[~np.isnan(rows[:, -1])]
            off = (now - given) / deviation
            power = float(np.sum(told[:, -2] ** 2) + np.sum(off**2))
            if not np.isfinite(power) or len(told) < states:
                break
            if power < least:
                gained, nearest, least = least - power, now, power
                if gained < BLIND * power:
                    break
            design = np.vstack([told[:, : m + len(rows_of)], np.diag(1.0 / deviation)])
            now = now - np.linalg.lstsq(design, np.concatenate([told[:, -2], off]), rcond=BLIND)[0]
        return self._begin(start, nearest)

    def _begin(self, start: Array, told: Array) -> Array:
        """The start with what a part tells of it; the coefficients of where a record begins go into the model."""
        m = len(self.own)
        if m:
            theta = self.model.theta.copy()
            theta[self.own] = told[:m]
            self.model = replace(self.model, theta=theta)
        begun = start.copy()
        begun[self.of_start] = told[m:]
        return begun

    def _run(
        self,
        record: Record,
        before: Beginning,
        start: Array,
        known: NDArray[np.int64],
        moved: int,
        tested: Effects,
    ) -> Array:
        """Rows of one stretch from `start`; before: what effects count from; moved: how many columns of the layout's
        start, −1 for those that a part tells (`of_start`).
        """
        observer = self._observer(tested)
        observer.x[observer.estimated_index] = start
        observer.begin_at(before.seconds, before.temperature)
        columns = np.eye(len(start))[:, self.of_start if moved < 0 else self.layout.kept[:moved]]
        if self.slips:
            return self._simulated(observer, record, before.seconds, known, columns)
        still = np.zeros((len(start), len(start)))
        observer.assume(observer.estimated, still)
        observer.hold(observer.estimated[observer.states :])
        c, m = len(known), columns.shape[1]
        w = sum(len(effect.coefficients) for _, effect in observer.effects[observer.carried :])
        z, u, h, warmth = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
        observer.allow_steps(float(np.max(h, initial=observer.h)), u.shape[2] - 1)
        delta = np.zeros((len(start), c + m + w))
        delta[:, c : c + m] = columns
        rows = np.zeros((len(z) * self.of.axes, c + m + w + 2))
        index = np.concatenate([known, np.full(m, -1)]).astype(np.int64)
        scan_block(observer, Portion(z, u, h, warmth), Signatures(delta, rows, known=index))
        rows[~np.isfinite(record.sense).ravel(), -1] = np.nan
        return rows

    def _simulated(
        self, observer: Observer, record: Record, ago: float, known: NDArray[np.int64], columns: Array
    ) -> Array:
        """The same by the run that carries what depends on the way, and its sensitivities."""
        c, m, axes = len(known), columns.shape[1], self.of.axes
        w = sum(len(effect.coefficients) for _, effect in observer.effects[observer.carried :])
        whole = Observer(observer.device, observer.settings, known=True)
        state = np.array(observer.x * observer.factors)
        drive = np.concatenate([0.0 * record.drive[:1], record.drive])
        step = np.concatenate([record.step[:1], record.step])
        rows = np.full((len(record) * axes, c + m + w + 2), np.nan)
        try:
            run = simulate(whole, state, drive, step=step, sensitive=bool(c + m + w), ago=ago)
        except ModelError:
            rows[:, -2], rows[:, -1] = np.inf, 0.0
            return rows
        deviation = np.sqrt(observer.sense_noise) * np.abs(observer.volts)
        rows[:, -2] = ((record.sense - run.sensed[1:]) / deviation).ravel()
        rows[:, -1] = np.tile(np.log(deviation / np.abs(observer.volts)), len(record))
        if c + m + w:
            scaled = -(run.sensitivity[1:] * observer.factors) / deviation[:, None]
            by = scaled.reshape(-1, scaled.shape[2])
            rows[:, :c] = by[:, observer.states + known]
            rows[:, c : c + m] = by[:, observer.estimated_index] @ columns
            rows[:, c + m : c + m + w] = by[:, by.shape[1] - w :]
        rows[~np.isfinite(record.sense).ravel(), -1] = np.nan
        return rows
