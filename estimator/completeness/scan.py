"""One pass over a record with an observer that lacks the effects it watches: how much each would explain."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from estimator.core.following import BLOCK, Portion, Signatures, gram, scan_block
from estimator.core.layout import OUTPUT
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.side_by_side import side_by_side, stop_if_abandoned, workers
from estimator.thresholds import THRESHOLDS
from estimator.trace.problem import Problem
from estimator.trace.start import begin_about, begin_moving

_SET = THRESHOLDS.scan

PARTS = _SET.parts
COURSE = _SET.course  # instants of a part at which the angle's sensitivity is kept
Watched = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Scan:
    """Normal equations of the watched coefficients, by part of the record, scaled to their plausible sizes.

    normal (parts, k, k), score (parts, k); columns: those of each watched effect; plausible (k,) SI sizes; innovation
    and its predicted deviation (n, axes) V; observer: as it stands after the last sample; course (parts · COURSE, k):
    how far the reported angle would have moved by then, were a coefficient carried, rad for one SI unit of it.
    """

    columns: dict[str, slice]
    normal: Array
    score: Array
    plausible: Array
    innovation: Array
    deviation: Array
    observer: Observer
    course: Array

    @property
    def sound(self) -> bool:
        """Whether the observer kept the motion: one that diverged, as after a jump that it takes for motion, has
        equations of no meaning.
        """
        seen = np.isfinite(self.innovation)  # a lost sample has none, and is no fault
        return bool(np.isfinite(self.normal).all() and np.isfinite(self.deviation[seen]).all())

    @property
    def ratio(self) -> float:
        """Innovation over what was predicted of it, rms; no number where the observer never had one."""
        normalised = (self.innovation / self.deviation) ** 2
        return float(np.sqrt(np.nanmean(normalised))) if not np.isnan(normalised).all() else np.nan


def scan(
    problem: Problem,
    watched: Watched,
    previous: Observer | None = None,
    *,
    weighed: bool = True,
    halves: bool = False,
    held: bool = False,
) -> Scan:
    """Run the observer of `problem` over its record and follow the signatures of the effects in `watched`.

    watched: by name, each with its parameters in SI; previous: an observer whose pass over the record came before.
    Without `weighed` there are no normal equations: zeros.  With `halves`, where two may work at a time, each follows
    half of the effects, with an observer of its own; the numbers are the same, and `observer` is that of the first
    half.  With `held`, the coefficients of what the observer carries stay as they are.
    Raises ModelError as `Observer` does.
    """
    names = list(watched)
    middle = (len(names) + 1) // 2 if halves and workers() > 1 else len(names)
    passes = [
        _Pass(problem, {name: watched[name] for name in share}, previous, weighed=weighed, held=held)
        for share in ([names[:middle], names[middle:]] if middle < len(names) else [names])
    ]
    size = sum(len(one.plausible) for one in passes)
    width = size + BLOCK - size % BLOCK  # with a column for the innovation
    normal, score = np.zeros((PARTS, size, size)), np.zeros((PARTS, size))
    edges = np.linspace(0, len(problem.record), PARTS + 1).astype(int)
    for part, (begin, end) in enumerate(pairwise(edges.tolist())):
        stop_if_abandoned()
        shown = side_by_side([partial(one.advance, part, begin, end) for one in passes])
        if weighed:
            equations = shown[0] if len(shown) == 1 else _beside(shown, [len(one.plausible) for one in passes], width)
            upper = np.triu(gram(equations))
            normal[part] = upper[:size, :size] + np.triu(upper[:size, :size], 1).T
            score[part] = upper[:size, size]
    columns: dict[str, slice] = {}
    for one in passes:
        at = max((taken.stop for taken in columns.values()), default=0)
        columns |= {name: slice(at + own.start, at + own.stop) for name, own in one.columns.items()}
    scale = np.concatenate([one.plausible for one in passes])
    first = passes[0]
    volts = np.array([first.observer.scaling.sense(axis) for axis in range(problem.device.axes)])
    variance = first.rows["s"][:, : problem.device.axes]
    return Scan(
        columns=columns,
        normal=normal * np.outer(scale, scale),
        score=score * scale,
        plausible=scale * np.abs(np.concatenate([one.factors for one in passes])),
        innovation=np.where(
            np.isfinite(problem.record.sense), first.rows["nu"][:, : problem.device.axes] * volts, np.nan
        ),
        deviation=np.sqrt(np.where(variance > 0.0, variance, np.nan)) * np.abs(volts),
        observer=first.observer,
        course=np.concatenate([one.course / one.factors for one in passes], axis=1),
    )


def _beside(shown: Sequence[Array], sizes: Sequence[int], width: int) -> Array:
    """Equations of all columns, by those of each share and the innovation behind them (lines, width)."""
    both = np.zeros((len(shown[0]), width))
    at = 0
    for own, size in zip(shown, sizes, strict=True):
        both[:, at : at + size + 1] = own[:, : size + 1]
        at += size
    return both


class _Pass:
    """An observer on its way over the record, and what it follows of the effects in `watched`.

    columns: those of each effect; plausible, factors (k,): scaled sizes and SI units of them; rows: what was observed;
    course: as `Scan` has it, scaled.
    """

    def __init__(
        self,
        problem: Problem,
        watched: Watched,
        previous: Observer | None,
        *,
        weighed: bool,
        held: bool,
    ) -> None:
        self.record, settings, self.weighed = problem.record, problem.settings, weighed
        carrying = replace(settings, effects={**settings.effects, **watched})
        self.observer = observer = Observer(problem.device, carrying, problem.controller, watched=len(watched))
        if previous is not None:
            begin_about(observer, previous)
            begin_moving(observer, problem.record)
        if held:
            observer.hold_coefficients()
        self.columns: dict[str, slice] = {}
        sizes: list[float] = []
        for _, effect in observer.effects[observer.carried :]:
            self.columns[effect.name] = slice(len(sizes), len(sizes) + len(effect.coefficients))
            sizes += [coefficient.plausible for coefficient in effect.coefficients]
        self.plausible = np.array(sizes)
        k = len(sizes)
        self.factors = observer.factors[len(observer.names) - k :]
        record = problem.record
        self.scaled = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
        _, u, h, _ = self.scaled
        observer.allow_steps(float(np.max(h, initial=observer.h)), u.shape[2] - 1)
        self.rows = np.zeros(len(record), OUTPUT)
        self.delta = np.zeros((observer.states + len(observer.active), k))
        self.turned, self.course = np.zeros(k), np.zeros((PARTS * COURSE, k))
        self.level = _SET.jump

    def advance(self, part: int, begin: int, end: int) -> Array:
        """Over one part of the record; its equations (axes · samples, columns, the innovation and some to spare)."""
        z, u, h, warmth = self.scaled
        axes, k = self.observer.device.axes, len(self.plausible)
        equations = np.zeros((axes * (end - begin) if self.weighed else 0, k + BLOCK - k % BLOCK))
        instants = self.course[part * COURSE : (part + 1) * COURSE]
        for start, stop, read, spread in _uninterrupted(self.record, begin, end):
            span, lines = slice(start, stop), slice(axes * (start - begin), axes * (stop - begin))
            portion = Portion(z[span], u[span], h[span], warmth[span], self.rows[span])
            signatures = Signatures(self.delta, self.level, equations[lines], self.turned, instants[read])
            scan_block(self.observer, portion, signatures)
            if spread is not None:
                self.observer.unsettle(spread)
        with np.errstate(all="ignore"):
            own = self.rows[begin:end]
            nis = own["nu"][:, :axes] ** 2 / own["s"][:, :axes]
        if not np.isnan(nis).all():
            self.level = _SET.jump * max(1.0, float(np.nanmedian(nis)) / 0.455)
        return equations


def _uninterrupted(record: Record, begin: int, end: int) -> Iterator[tuple[int, int, slice, Array | None]]:
    """A part of the record cut behind its gaps: first row, end, at which of the part's instants the course is read,
    and what a gap at the end adds to the motion.

    Without gaps that is the part as it is; a gap may end where the course is read.
    """
    gaps = None if record.gaps is None else record.gaps.part(slice(begin, end))
    if gaps is None or not len(gaps):
        yield begin, end, slice(0, COURSE), None
        return
    after = dict(zip((gaps.last + 1).tolist(), gaps.spread, strict=True))
    reads = np.ceil(np.arange(1, COURSE + 1) * (end - begin) / COURSE).astype(int).tolist()
    at = 0
    for stop in sorted({*after, *reads}):
        due = [k for k, read in enumerate(reads) if read == stop]
        yield begin + at, begin + stop, slice(due[0], due[-1] + 1) if due else slice(0), after.get(stop)
        at = stop
