"""One pass over a record with an observer that lacks the effects it watches: how much each would explain."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from estimator.kernel.gram import BLOCK, add_gram
from estimator.kernel.layout import OUTPUT
from estimator.kernel.scan import Block, Signatures, scan_block
from estimator.kernel.scan_plain import scan_plain_block, scans_plainly
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Gain
from estimator.side_by_side import stop_if_abandoned
from estimator.thresholds import THRESHOLDS
from estimator.trace.problem import Problem
from estimator.trace.start import begin_about

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
        """Innovation over what was predicted of it, rms."""
        return float(np.sqrt(np.nanmean((self.innovation / self.deviation) ** 2)))


def scan(
    problem: Problem,
    watched: Watched,
    previous: Observer | None = None,
    *,
    weighed: bool = True,
    vector: bool = True,
) -> Scan:
    """Run the observer of `problem` over its record and follow the signatures of the effects in `watched`.

    watched: by name, each with its parameters in SI; previous: an observer whose pass over the record came before.
    Without `weighed` there are no normal equations: zeros.  Without `vector`, the general kernel runs where the quick
    one could.
    Raises ModelError as `Observer` does.
    """
    record, device, settings = problem.record, problem.device, problem.settings
    carrying = replace(settings, effects={**settings.effects, **watched})
    observer = Observer(device, carrying, problem.controller, watched=len(watched))
    if previous is not None:
        begin_about(observer, previous)
    columns, plausible, first = {}, [], 0
    for _, effect in observer.effects[observer.carried :]:
        columns[effect.name] = slice(first, first + len(effect.coefficients))
        first += len(effect.coefficients)
        plausible += [coefficient.plausible for coefficient in effect.coefficients]
    scale = np.array(plausible)
    z, u, h, warmth = observer.scaled(record.sense, record.drive, record.step, record.channels.get("temperature"))
    observer.allow_steps(float(np.max(h, initial=observer.h)), u.shape[2] - 1)
    rows = np.zeros(len(record), OUTPUT)
    delta = np.zeros((observer.states + len(observer.active), first))
    normal, score = np.zeros((PARTS, first, first)), np.zeros((PARTS, first))
    width = first + BLOCK - first % BLOCK  # with a column for the innovation
    turned, course = np.zeros(first), np.zeros((PARTS * COURSE, first))
    edges = np.linspace(0, len(record), PARTS + 1).astype(int)
    level = _SET.jump
    if settings.gain is Gain.EKF and vector:
        observer.carry_both()
    arrays = observer.arrays
    quick = vector and bool(scans_plainly(arrays.settings, arrays.active, arrays.x[: len(arrays.x) - first]))
    for part, (begin, end) in enumerate(pairwise(edges)):
        stop_if_abandoned()
        equations = np.zeros((device.axes * (end - begin) if weighed else 0, width))
        instants = course[part * COURSE : (part + 1) * COURSE]
        for start, stop, read, spread in _uninterrupted(record, int(begin), int(end)):
            span, lines = slice(start, stop), slice(device.axes * (start - begin), device.axes * (stop - begin))
            block = Block(z[span], u[span], h[span], warmth[span], rows[span])
            signatures = Signatures(delta, level, equations[lines], turned, instants[read])
            _advance(observer, block, signatures, quick=quick)
            if spread is not None:
                observer.unsettle(spread)
        if weighed:
            products = np.zeros(width * width)
            add_gram(equations.ravel(), width, products)
            upper = np.triu(products.reshape(width, width))
            normal[part] = upper[:first, :first] + np.triu(upper[:first, :first], 1).T
            score[part] = upper[:first, first]
        with np.errstate(all="ignore"):
            own = rows[begin:end]
            nis = own["nu"][:, : device.axes] ** 2 / own["s"][:, : device.axes]
        if not np.isnan(nis).all():
            level = _SET.jump * max(1.0, float(np.nanmedian(nis)) / 0.455)
    factors = observer.factors[len(observer.names) - first :]
    volts = np.array([observer.scaling.sense(axis) for axis in range(device.axes)])
    variance = rows["s"][:, : device.axes]
    return Scan(
        columns=columns,
        normal=normal * np.outer(scale, scale),
        score=score * scale,
        plausible=scale * np.abs(factors),
        innovation=np.where(np.isfinite(record.sense), rows["nu"][:, : device.axes] * volts, np.nan),
        deviation=np.sqrt(np.where(variance > 0.0, variance, np.nan)) * np.abs(volts),
        observer=observer,
        course=course / factors,
    )


def _advance(observer: Observer, block: Block, signatures: Signatures, *, quick: bool) -> None:
    kernel = scan_plain_block if quick else scan_block
    kernel(observer.arrays, block, signatures)


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
