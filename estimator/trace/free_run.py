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
from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.side_by_side import stop_if_abandoned
from estimator.simulation import remembers, simulate
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
    """`Likelihood` of a record by its free run; telling: how many first samples tell its start, none where that is of
    the model's parameters; alone: of no record that was fitted, so that these tell its offsets too; followed: whether
    the run is corrected for the random force that the record asks for.
    """

    followed: bool = False
    telling: int = 0
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
        telling = self.telling or (TELLING if rows.start else 0)
        return replace(self, problem=part.problem, beginning=part.beginning, telling=telling)

    @property
    def following(self) -> "FreeRun":
        """The same with the random force that the record asks for: then a run does not lose the motion for what a model
        lacks, and tells it.
        """
        return replace(self, followed=True)

    def layout(self, effects: Effects) -> Layout:
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
        return super().at_first(layout, model) if self.followed else model

    def quieten(self, layout: Layout, model: Model) -> Model:
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


class _Run:
    """A free run over a record, with its derivatives by the constants, by the start, and by effects in `tested`.

    x: what it begins with, of the observer; told: places in x of what a part tells that was not fitted, its motion,
    and of a record by itself all else of where it begins.
    """

    def __init__(self, of: FreeRun, layout: StartLayout, model: Model, derivatives: bool, tested: Effects) -> None:
        self.of, self.layout, self.model, self.tested = of, layout, model, tested
        self.record = of.problem.record
        self.effects = layout.effects_of(model)
        self.observer = observer = observer_of(of.problem, self.effects, model.noise, tested)
        self.known, self.by = (layout.index, layout.kept) if derivatives else (layout.index[:0], layout.kept[:0])
        lacking = observer.effects[observer.carried :]
        self.names = (
            *(layout.names if derivatives else ()),
            *(effect.name for _, effect in lacking for _ in effect.coefficients),
        )
        self.slips = any(effect.slips for _, effect in observer.effects)
        self.x = observer.x
        self.x[observer.states + layout.index] = model.theta[: len(layout.index)]
        self.x[observer.estimated_index] = layout.fixed
        self.x[observer.estimated_index[layout.kept]] = model.theta[layout.start]
        states, own = np.arange(observer.states), {c.name for one in layout.effects for c in one.coefficients if c.own}
        self.own = [k for k in range(len(layout.index)) if of.alone and layout.names[k] in own]
        self.start = np.union1d(states, layout.kept) if of.alone else states
        self.told = np.concatenate([observer.states + layout.index[self.own], observer.estimated_index[self.start]])

    def over_all(self) -> Array:
        """Whitened rows (axes · n, k + 2) of all stretches: derivatives, error, logarithm of the deviation; the last is
        NaN where a sample does not count.
        """
        parts = self.record.stretches or (slice(0, len(self.record)),)
        return np.concatenate([self._over(part, fitted=number == 0 and not self.of.telling)
                               for number, part in enumerate(parts)])  # fmt: skip

    def _over(self, stretch: slice, *, fitted: bool) -> Array:
        record, before = self.record.part(stretch), self.of.part(slice(stretch.start, None)).beginning
        x = self.x.copy()
        if not fitted:
            telling = record.part(slice(0, self.of.telling or None))
            x[: self.observer.states], _ = seen_motion(telling, self.observer)
            x[self.told] = self._nearest(telling, before, x)
        rows = self._run(record, before, x, self.known, self.by, self.tested)
        if fitted:
            return rows
        if len(self.by) and len(rows):
            own = np.array([*self.own, *(len(self.known) + np.flatnonzero(np.isin(self.by, self.start)))])
            seen = np.flatnonzero(~np.isnan(rows[:, -1]))
            others = np.setdiff1d(np.arange(rows.shape[1] - 2), own)
            answer = np.linalg.lstsq(rows[np.ix_(seen, own)], rows[np.ix_(seen, others)], rcond=BLIND)[0]
            rows[:, others] -= rows[:, own] @ answer
            rows[:, own] = 0.0
        rows[: self.of.telling * self.of.axes, -1] = np.nan
        return rows

    def _nearest(self, record: Record, before: Beginning, x: Array) -> Array:
        """Of what is told, where the run lies closest to a record, from `x` on; beside the motion, as sure beforehand
        as it is declared.
        """
        own, states, layout = self.own, self.observer.states, self.layout
        beside = layout.start[np.isin(layout.kept, self.start[states:])]
        deviation = np.concatenate([layout.deviation[own], np.full(states, np.inf), layout.deviation[beside]])
        now: Array = x[self.told]
        nearest, given, least = now, np.concatenate([layout.mean[own], now[len(own) :]]), np.inf
        for _ in range(PASSES):
            x[self.told] = now
            rows = self._run(record, before, x, layout.index[own], self.start, {})
            counted = rows[~np.isnan(rows[:, -1])]
            off = (now - given) / deviation
            power = float(np.sum(counted[:, -2] ** 2) + np.sum(off**2))
            if not np.isfinite(power) or len(counted) < states:
                break
            if power < least:
                gained, nearest, least = least - power, now, power
                if gained < BLIND * power:
                    break
            design = np.vstack([counted[:, : len(now)], np.diag(1.0 / deviation)])
            now = now - np.linalg.lstsq(design, np.concatenate([counted[:, -2], off]), rcond=BLIND)[0]
        return nearest

    def _run(
        self, record: Record, before: Beginning, x: Array, known: NDArray[np.int64], by: NDArray[np.int64],
        tested: Effects,
    ) -> Array:  # fmt: skip
        """Rows of one stretch from `x`, with derivatives by the constants `known` and by these of the start; before:
        what effects count from.
        """
        observer = observer_of(self.of.problem, self.effects, self.model.noise, tested)
        observer.x[:] = x[: len(observer.x)]
        w = sum(len(effect.coefficients) for _, effect in observer.effects[observer.carried :])
        columns = np.eye(len(observer.estimated_index))[:, by]
        rows = np.zeros((len(record) * self.of.axes, len(known) + len(by) + w + 2))
        (self._simulate if self.slips else self._scan)(observer, record, before, known, columns, rows)
        rows[~np.isfinite(record.sense).ravel(), -1] = np.nan
        return rows

    def _scan(
        self, observer: Observer, record: Record, before: Beginning, known: NDArray[np.int64], columns: Array,
        rows: Array,
    ) -> None:  # fmt: skip
        """Fill the rows by the filter's pass, of a start that is known; columns (start, m)."""
        observer.begin_at(before.seconds, before.temperature)
        observer.assume(observer.estimated, np.zeros((len(columns), len(columns))))
        observer.hold(observer.estimated[observer.states :])
        c, m = len(known), columns.shape[1]
        z, u, h, warmth = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
        observer.allow_steps(float(np.max(h, initial=observer.h)), u.shape[2] - 1)
        delta = np.zeros((len(columns), rows.shape[1] - 2))
        delta[:, c : c + m] = columns
        index = np.concatenate([known, np.full(m, -1)]).astype(np.int64)
        scan_block(observer, Portion(z, u, h, warmth), Signatures(delta, rows, known=index))

    def _simulate(
        self, observer: Observer, record: Record, before: Beginning, known: NDArray[np.int64], columns: Array,
        rows: Array,
    ) -> None:  # fmt: skip
        """The same by the run that carries what depends on the way, and its sensitivities."""
        c, m, k = len(known), columns.shape[1], rows.shape[1] - 2
        whole = Observer(observer.device, observer.settings, known=True)
        state = np.array(observer.x * observer.factors)
        drive = np.concatenate([0.0 * record.drive[:1], record.drive])
        step = np.concatenate([record.step[:1], record.step])
        try:
            run = simulate(whole, state, drive, step=step, sensitive=bool(k), ago=before.seconds)
        except ModelError:
            rows[:, -2] = np.inf
            return
        deviation = np.sqrt(observer.sense_noise) * np.abs(observer.volts)
        rows[:, -2] = ((record.sense - run.sensed[1:]) / deviation).ravel()
        rows[:, -1] = np.tile(np.log(deviation / np.abs(observer.volts)), len(record))
        if k:
            scaled = -(run.sensitivity[1:] * observer.factors) / deviation[:, None]
            by = scaled.reshape(-1, scaled.shape[2])
            rows[:, :c] = by[:, observer.states + known]
            rows[:, c : c + m] = by[:, observer.estimated_index] @ columns
            rows[:, c + m : k] = by[:, by.shape[1] - (k - c - m) :]
