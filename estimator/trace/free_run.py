"""The diagnosis of a single axis or of a free response: effects named and judged by the free run.

Without a rate that wanders and a control that corrects, such a record is one long experiment: what its drive and its
start make of it.  A free run sees there what an observer, corrected at every sample, would take up.
"""

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from estimator.diagnosis import Diagnosis, Found, Interval, Rejected, Separation, Verdict
from estimator.effects.catalogue import effect_for
from estimator.errors import ModelError
from estimator.identification.axes import equations_on
from estimator.identification.examination import Examination, examine
from estimator.identification.problem import Problem
from estimator.identification.symmetries import heavier, mass_of_nonreciprocal, mass_of_sense_gain
from estimator.model.catalogue import model_for
from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import Refined
from estimator.scaling import Array
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.by_simulation import SimulationTrace, trace_by_simulation, without
from estimator.trace.claims import on_one_floor, residual_of
from estimator.trace.determined import declared, undetermined
from estimator.trace.engine import leaves_the_rest
from estimator.trace.free_run_model import estimates_of
from estimator.trace.held_out_error import held_out_error
from estimator.trace.nameless import Innovations, contest
from estimator.trace.probability import stated
from estimator.trace.promises import Claim, Constant, Errors

_SET = THRESHOLDS.free_runs
_SHOWN = 2000  # samples of a free run, for a picture of a few cycles


def trace_free_run(
    problem: Problem,
    *,
    split: int,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> Diagnosis:
    """Choose effects on the samples before `split` by the free run of a single axis, score them on the rest."""
    part = problem.part(slice(0, split))
    selected = trace_by_simulation(part, _SET.scored_from, progress)
    later = problem.record.part(slice(split, len(problem.record)))
    found, claim, why = _promised(part, selected, later)
    errors, device = claim.residual, problem.device
    carried = {**problem.effects, **{name: _coefficients(name, found, device) for name in found.effects}}
    before = _examined(problem, found.before, split)
    after = _examined(problem.carrying(carried), found.after, split) if found.effects else before
    was, fitted = on_one_floor(before.fitted, after.fitted)
    was_held_out, held_out = on_one_floor(before.held_out, after.held_out)
    claim = replace(claim, observed=residual_of(before.held_out, after.held_out, later.sense.size))
    verdict, against = judged(claim, _rmse(found.before))
    named = found.effects if verdict in (Verdict.EXPLAINED, Verdict.PARTLY) else ()
    told = against if named else promises.not_named(found.effects, against)
    if not named:
        why |= {name: leaves_the_rest(found.evidence[name]) for name in found.effects}
    return Diagnosis(
        verdict=verdict,
        effects=tuple(_found(name, found, device) for name in named),
        separations=(
            *(
                Separation(name, other, correlation, None, None)
                for name, other, correlation in found.alike
                if name in named
            ),
            *_unequal_masses(problem, found, named),
        ),
        rejected=tuple(Rejected(name, reason) for name, reason in (why | dict(found.rejected)).items()),
        findings=before.findings,
        before=replace(was, simulation_rmse=_rmse(found.before)),
        after=replace(fitted, simulation_rmse=_rmse(found.after)),
        held_out_before=replace(was_held_out, simulation_rmse=errors.before),
        held_out_after=replace(held_out, simulation_rmse=errors.after),
        residual_before=before.residual,
        residual_after=after.residual,
        split=split,
        reasons=(_summary(verdict, named, errors, device.sense_unit), *told),
        share=errors.share if named else None,
        left=after.findings if verdict is Verdict.PARTLY else (),
        probabilities=stated(
            found.accounts,
            {name: name for name in named},
            set(why) - set(named),
            claim.contest,
            is_open=verdict.is_open,
        ),
        undetermined=undetermined(found.after),
        free_run=_shown(found, later),
    ).of_what_is_named()


def _shown(found: SimulationTrace, later: Record) -> tuple[Array, Array]:
    """Measured less simulated (m, axes) V at the beginning of what the choice never saw, before and after."""
    beginning = later.part(slice(0, _SET.scored_from + _SHOWN))
    before = free_run_error(found.observer_before, found.before, beginning, _SET.scored_from)
    return before, free_run_error(found.observer, found.after, beginning, _SET.scored_from)


def _unequal_masses(problem: Problem, found: SimulationTrace, named: tuple[str, ...]) -> tuple[Separation, ...]:
    """What a stiffness that is not symmetric, or a sense gain, may be as well where nothing drives."""
    if np.any(problem.record.drive):
        return ()
    masses: dict[str, float | None] = {}
    if "nonreciprocal_stiffness" in named:
        masses["nonreciprocal_stiffness"] = mass_of_nonreciprocal(found.after.value("kxy"), found.after.value("kn"))
    elif "sense_gain" in named:
        masses["sense_gain"] = mass_of_sense_gain(found.after.value("gy"))
    return tuple(
        Separation(name, "unequal_masses", 1.0, heavier(mass), None)
        for name, mass in masses.items()
        if mass is not None
    )


def _promised(part: Problem, found: SimulationTrace, later: Record) -> tuple[SimulationTrace, Claim, dict[str, str]]:
    """What was found, less effects that a guard of their own speaks against, and, where something is left, less those
    that explain little beside the largest; the claim; and why the others went.
    """
    why: dict[str, str] = {}
    while True:
        claim = claimed(part, found, later)
        if weak := promises.weak(claim.effects):
            least = min(weak, key=lambda name: found.evidence[name])
            why[least] = weak[least]
            found = without(part, found, (least,), _SET.scored_from)
            continue
        small = promises.minor(found.evidence)
        if not small or not promises.broken(claim):
            return found, claim, why
        why |= {name: leaves_the_rest(found.evidence[name]) for name in small}
        found = without(part, found, small, _SET.scored_from)


def claimed(part: Problem, found: SimulationTrace, later: Record) -> Claim:
    """What is to be said of `later`, which the choice on the record of `part` never saw."""
    runs = ((found.observer_before, found.before), (found.observer, found.after))
    errors = [free_run_error(seen, fit, later, _SET.scored_from) for seen, fit in runs]
    if not np.any(np.isfinite(errors[0])):
        raise ModelError(
            f"gaps leave no stretch of more than {_SET.scored_from} samples to the part that is held out; "
            "mend the link and record again"
        )
    before, after = (float(np.sqrt(np.nanmean(error**2))) for error in errors)
    split = len(part.record)
    deviation = np.broadcast_to(np.array(part.device.noise), (split + len(later), part.device.axes))
    was, now = (
        Innovations(np.concatenate([fit.residual, error]), deviation, slice(_SET.scored_from, split))
        for (_, fit), error in zip(runs, errors, strict=True)
    )
    noise = part.device.noise[0]
    estimates = estimates_of(found.observer, found.after)
    return Claim(
        residual=Errors(before, after, noise, later.sense.size),
        effects={name: estimates[name] for name in found.effects},
        constants=_constants(found),
        contest=contest(was, now, split),
    )


def _constants(found: SimulationTrace) -> tuple[Constant, ...]:
    """Those of the base model, beside what the observer began with."""
    fit = found.after
    return tuple(
        Constant(
            name, fit.value(name), *fit.interval(name), one.value, one.deviation, positive=promises.is_positive(name)
        )
        for name, one in declared(found.observer_before).items()
        if name in fit.free
    )


def judged(claim: Claim, fitted: float = 0.0) -> tuple[Verdict, tuple[str, ...]]:
    """The verdict, and what keeps a record from being explained; fitted: rms error of the free run, of the base model,
    on the part that was fitted: one part that is predicted does not make up for one that is not.
    """
    errors = claim.residual
    if not claim.effects:
        conflict = promises.constants(claim)
        verdict = verdict_of(max(errors.before, fitted), errors.after, errors.floor, ())
        if fitted > _SET.adequate * errors.floor >= errors.before:
            above = fitted / errors.floor
            conflict = (*conflict, f"a free run of the part that was fitted is {above:.3g} × the declared noise off")
        return Verdict.UNEXPLAINED if conflict else verdict, conflict
    against = (*promises.broken(claim), *promises.one_curve(claim.effects))
    if not against:
        return Verdict.EXPLAINED, ()
    return Verdict.PARTLY if promises.holds_in_part(claim) else Verdict.UNEXPLAINED, against


def _summary(verdict: Verdict, named: tuple[str, ...], errors: Errors, unit: str) -> str:
    was = f", was {errors.before:.3g} {unit}" if named else ""
    noise = f"the declared noise is {errors.floor:.3g} {unit}"
    left = errors.after if named else errors.before
    off = f"a free run of the part held out is {left:.3g} {unit} rms off{was}; {noise}"
    if verdict is not Verdict.PARTLY:
        return off
    return f"{promises.acts_like(named)}: {errors.share:.1%} of the power above the noise goes; {off}"


def free_run_error(observer: Observer, fit: Refined, record: Record, first: int) -> Array:
    """Residual (n, axes) V of a free run on another record; its first outputs, and those behind each gap, set the state
    and are NaN.
    """
    return held_out_error(observer, fit.state, record, first)


def verdict_of(before: float, after: float, noise: float, effects: Collection[str]) -> Verdict:
    """The verdict by the error on the held-out part alone, all three in one unit."""
    if not effects:
        return Verdict.ADEQUATE if before <= _SET.adequate * noise else Verdict.UNEXPLAINED
    errors = Errors(before, after, noise)
    if errors.fell and errors.at_floor:
        return Verdict.EXPLAINED
    return Verdict.PARTLY if errors.share >= THRESHOLDS.promises.part else Verdict.UNEXPLAINED


def _rmse(fit: Refined) -> float:
    return float(np.sqrt(np.mean(fit.rmse**2)))


def _coefficients(name: str, found: SimulationTrace, device: Device) -> dict[str, float]:
    _, effect = effect_for(name, device.axes, device.own)
    return {c.name.partition(":")[0]: found.after.value(c.name) for c in effect.coefficients}


def _examined(problem: Problem, fit: Refined, split: int) -> Examination:
    """The innovation of the bench's observer that begins with the constants of the free run."""
    _, model = model_for(problem.device.axes)
    constants = {constant.name for constant in model.constants}
    found = {name: float(value) for name, value in zip(fit.names, fit.state, strict=True) if name in constants}
    initial = {**problem.settings.initial, **found}
    alone = replace(problem, settings=replace(problem.settings, initial=initial), controller=None)
    return examine(alone, split)


def _found(name: str, found: SimulationTrace, device: Device) -> Found:
    _, effect = effect_for(name, device.axes, device.own)
    return Found(
        name=name,
        title=effect.title,
        equation=equations_on(effect, device.axes),
        coefficients={
            c.name: Interval(found.after.value(c.name), *found.after.interval(c.name), c.unit)
            for c in effect.coefficients
        },
        evidence=found.evidence[name],
        undone=effect.undone.value,
    )
