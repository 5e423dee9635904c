"""From a record to a diagnosis: which effect the model lacks, how large it is, and what the error is with it."""

from collections.abc import Callable

import numpy as np
from scipy.stats import norm

from estimator.effects.catalogue import effect_for
from estimator.effects.equation import equations
from estimator.settings import Device
from estimator.trace.angle import AngleReader
from estimator.trace.candidates import kind
from estimator.trace.certainty import covariance_of, widening
from estimator.trace.criterion import threshold
from estimator.trace.diagnosis import Confusable, Diagnosis, Fit, Found, Interval, Rejected, Verdict
from estimator.trace.evidence import SAME
from estimator.trace.examination import examine
from estimator.trace.fitness import require_traceable
from estimator.trace.free_run import trace_free_run
from estimator.trace.judgement import leftover
from estimator.trace.problem import Effects, Problem
from estimator.trace.selection import Selection, select
from estimator.trace.separation import separations

_READ = 100_000  # samples in which the angle is read once for each possibility
_TWO_SIDED = float(norm.ppf(0.975))


def trace(
    problem: Problem,
    *,
    split: int,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> Diagnosis:
    """Choose effects on the samples before `split`, score them on the rest.

    The observer of `problem` is the bench's; effects that it carries already stay.  A single axis is traced by its
    free run.

    Raises ModelError for a record that cannot be traced, with what to record instead.
    """
    record, device, known = problem.record, problem.device, problem.effects
    require_traceable(record, device, split)
    if device.axes == 1:
        return trace_free_run(problem, split=split, progress=progress)
    selection = select(problem.part(slice(0, split)), progress)
    progress("before and after", 0, 2)
    before = examine(problem, split)
    progress("before and after", 1, 2)
    chosen = {name: given for name, given in selection.effects.items() if name not in known}
    after = examine(problem.carrying(selection.effects), split) if chosen else before
    progress("before and after", 2, 2)
    resonance = float(np.sqrt(device.target)) / (2.0 * np.pi)
    left = leftover(selection, record.part(slice(0, selection.samples)), resonance)
    named = chosen if not left else {}
    verdict = Verdict.UNEXPLAINED if left else Verdict.EXPLAINED if named else Verdict.ADEQUATE
    reader = AngleReader(problem.part(slice(0, min(split, _READ))))
    return Diagnosis(
        verdict=verdict,
        effects=tuple(_found(name, named, selection, reader) for name in named),
        confusable=_confusable(named, selection, reader, progress),
        rejected=_rejected(named, chosen, selection, device),
        findings=before.findings,
        before=before.fitted,
        after=after.fitted,
        held_out_before=before.held_out,
        held_out_after=after.held_out,
        residual_before=before.residual,
        residual_after=after.residual,
        split=split,
        reasons=left or _reasons(named, selection, before.held_out, after.held_out),
        angle_moved=reader.moved(known, selection.effects) if chosen else None,
    )


def _reasons(named: Effects, selection: Selection, before: Fit, after: Fit) -> tuple[str, ...]:
    """Why the model is complete, with what is named, as sentences."""
    was = f", and was {before.ratio:.4g} ×" if named else ""
    looked_for = {kind(name) for name in selection.rounds[-1].look.evidence} - {kind(name) for name in named}
    return (
        f"the innovation of the part held out is {after.ratio:.4g} × the noise floor{was}",
        f"none of the {len(looked_for)} {'other ' if named else ''}effects looked for explains more than chance would",
    )


def _short(name: str, named: Effects) -> str:
    """The name without its label, where that says which is meant."""
    return name if sum(kind(other) == kind(name) for other in named) > 1 else kind(name)


def _found(name: str, named: Effects, selection: Selection, reader: AngleReader) -> Found:
    _, effect = effect_for(name, reader.problem.device.axes)
    spread = covariance_of(name, selection.after, selection.searched[name])
    return Found(
        name=_short(name, named),
        title=effect.title,
        equation=equations(effect),
        coefficients=_intervals(name, selection, reader.problem.device),
        evidence=selection.gain[name],
        undone=effect.undone.value,
        angle_bound=reader.bound(selection.effects, name, spread),
    )


def _intervals(name: str, selection: Selection, device: Device) -> dict[str, Interval]:
    """Coefficients and searched parameters with their 95 % intervals; a coefficient moves with the parameters."""
    model, searched = selection.after, selection.searched[name]
    _, effect = effect_for(name, device.axes)
    given = selection.effects[name]
    covariance = covariance_of(name, model, searched)
    intervals = {}
    for i, c in enumerate(effect.coefficients):
        symbol = c.name.partition(":")[0]
        intervals[symbol] = _interval(given[symbol], float(np.sqrt(covariance[i, i])), c.unit)
    for p in effect.parameters:
        if p.name in searched.names:
            intervals[p.name] = _interval(given[p.name], widening(model) * searched.deviation(p.name), p.unit)
    return intervals


def _interval(value: float, deviation: float, unit: str) -> Interval:
    return Interval(value, value - _TWO_SIDED * deviation, value + _TWO_SIDED * deviation, unit)


def _confusable(
    named: Effects,
    selection: Selection,
    reader: AngleReader,
    progress: Callable[[str, int, int], None],
) -> tuple[Confusable, ...]:
    """Who looks like a named effect on this record, what would tell them apart, and what hangs on it."""
    pairs = [
        (step, step.taken, other, likeness)
        for step in selection.rounds
        if step.taken is not None and step.taken in named
        for other, likeness in selection.alike[step.taken].items()
        if likeness > SAME and kind(other) != kind(step.taken)
    ]
    pairs = [
        (step, name, other, likeness)
        for index, (step, name, other, likeness) in enumerate(pairs)
        if kind(other) not in {kind(before) for _, taken, before, _ in pairs[:index] if taken == name}
    ]
    advice = separations([(name, other) for _, name, other, _ in pairs], selection, reader.problem, progress)
    return tuple(
        Confusable(
            _short(name, named), kind(other), likeness, *told,
            angle_apart=reader.mistaken(selection.effects, name, other, step.look.watched[other]),
        )
        for (step, name, other, likeness), told in zip(pairs, advice, strict=True)
    )  # fmt: skip


def _rejected(named: Effects, chosen: Effects, selection: Selection, device: Device) -> tuple[Rejected, ...]:
    """Every other candidate once, with what it would have explained at best and a bound on its coefficients."""
    last = selection.rounds[-1]
    kinds = {kind(name) for name in named}
    rejected: dict[str, Rejected] = {}
    enough = threshold(len(last.look.evidence))
    alone: dict[str, float] = {}
    for name, item in selection.rounds[0].look.evidence.items():  # best first
        alone.setdefault(kind(name), item.gain)
    for name, item in last.look.evidence.items():
        if kind(name) in kinds or kind(name) in rejected:
            continue
        _, effect = effect_for(name, device.axes)
        bound = {
            c.name.partition(":")[0]: Interval(
                float(value), float(value - _TWO_SIDED * sd), float(value + _TWO_SIDED * sd), c.unit
            )
            for c, value, sd in zip(effect.coefficients, item.coefficients, item.deviation, strict=True)
            if sd > 0.0
        }
        why = _why(name, item.significance > enough, chosen, selection)
        rejected[kind(name)] = Rejected(kind(name), why, bound, alone.get(kind(name)))
    for name in chosen:
        if kind(name) not in kinds:
            rejected[kind(name)] = Rejected(
                kind(name), f"explains part of the residual (gain {selection.gain[name]:.4g}) and leaves the rest", {}
            )
    return tuple(rejected.values())


def _why(name: str, serious: bool, chosen: Effects, selection: Selection) -> str:
    tried = selection.rounds[-1].gains.get(name)
    if tried is not None:
        return f"carried, it gains {tried:.4g} in twice the log-likelihood: no more than chance"
    alike = max((others.get(name, 0.0) for taken, others in selection.alike.items() if taken in chosen), default=0.0)
    if alike > SAME:
        return f"looks like what was taken (likeness {alike:.5f}) and explains less"
    if serious:
        return "what it would explain is not the same from part to part of the record"
    if alike > 0.9:
        return f"nothing is left for it (likeness {alike:.3f} to what was taken)"
    return "explains no more than chance would"
