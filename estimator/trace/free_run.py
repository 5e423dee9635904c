"""The diagnosis of a single axis or of a free response: effects named and judged by the free run.

Without a rate that wanders and a control that corrects, such a record is one long experiment: what its drive and its
start make of it.  A free run sees there what an observer, corrected at every sample, would take up.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.effects.equation import equations
from estimator.model.catalogue import model_for
from estimator.observer import Observer
from estimator.refinement import Refined, refine
from estimator.scaling import Array
from estimator.settings import Device
from estimator.simulation import simulate
from estimator.trace.by_simulation import SimulationTrace, trace_by_simulation
from estimator.trace.diagnosis import Confusable, Diagnosis, Found, Interval, Rejected, Verdict
from estimator.trace.examination import Examination, examine
from estimator.trace.problem import Problem
from estimator.trace.record import Record

_FIRST = 50  # outputs that set the state of a free run and are not scored
_LEFT = 0.1  # of the power above the noise, what may be left where a record counts as explained
_NEAR = 3.0  # ratio to the noise up to which a model that nothing was added to counts as adequate


def trace_free_run(
    problem: Problem,
    *,
    split: int,
    progress: Callable[[str, int, int], None],
) -> Diagnosis:
    """As `estimator.trace.tracing.trace`, by the free run."""
    device = problem.device
    found = trace_by_simulation(problem.part(slice(0, split)), _FIRST, progress)
    later = problem.record.part(slice(split, len(problem.record)))
    errors = [
        free_run_error(seen, fit, later, _FIRST)
        for seen, fit in ((found.observer_before, found.before), (found.observer, found.after))
    ]
    held_out = [float(np.sqrt(np.nanmean(error**2))) for error in errors]
    verdict = verdict_of(held_out[0], held_out[1], device.noise[0], found.effects)
    carried = {**problem.effects, **{name: _coefficients(name, found, device) for name in found.effects}}
    before = _examined(problem, found.before, split)
    after = _examined(problem.carrying(carried), found.after, split) if found.effects else before
    named = found.effects if verdict is Verdict.EXPLAINED else ()
    was = f", was {held_out[0]:.3g} V" if found.effects else ""
    reasons = (
        f"a free run of the part held out is {held_out[1]:.3g} V rms off{was}; the noise is {device.noise[0]:.3g} V",
    )
    return Diagnosis(
        verdict=verdict,
        effects=tuple(_found(name, found, device) for name in named),
        confusable=tuple(
            Confusable(name, other, correlation, None, None)
            for name, other, correlation in found.alike
            if name in named
        ),
        rejected=(
            *(Rejected(name, reason) for name, reason in found.rejected.items()),
            *(
                Rejected(name, "explains part of the residual and leaves the rest")
                for name in found.effects
                if not named
            ),
        ),
        findings=before.findings,
        before=replace(before.fitted, simulation_rmse=_rmse(found.before)),
        after=replace(after.fitted, simulation_rmse=_rmse(found.after)),
        held_out_before=replace(before.held_out, simulation_rmse=held_out[0]),
        held_out_after=replace(after.held_out, simulation_rmse=held_out[1]),
        residual_before=before.residual,
        residual_after=after.residual,
        split=split,
        reasons=reasons,
    )


def free_run_error(observer: Observer, fit: Refined, record: Record, first: int) -> Array:
    """Residual (n, axes) V of a free run on another record; its first outputs set the state and are NaN."""
    state = fit.state.copy()
    state[: observer.states] = 0.0
    motion = observer.names[: observer.states]
    beginning = record.part(slice(0, first))
    state = refine(observer, beginning.sense, beginning.drive, start=state, free=motion, step=beginning.step).state
    residual = record.sense - simulate(observer, state, record.drive, step=record.step).sensed
    residual[:first] = np.nan
    return np.asarray(residual)


def verdict_of(before: float, after: float, noise: float, effects: tuple[str, ...] | list[str]) -> Verdict:
    """The verdict by the error on the held-out part, all three in one unit."""
    if not effects:
        return Verdict.ADEQUATE if before <= _NEAR * noise else Verdict.UNEXPLAINED
    was, left = (max(error**2 - noise**2, 0.0) for error in (before, after))
    return Verdict.EXPLAINED if after <= _NEAR * noise or left <= _LEFT * was else Verdict.UNEXPLAINED


def _rmse(fit: Refined) -> float:
    return float(np.sqrt(np.mean(fit.rmse**2)))


def _coefficients(name: str, found: SimulationTrace, device: Device) -> dict[str, float]:
    _, effect = effect_for(name, device.axes)
    return {c.name: found.after.value(c.name) for c in effect.coefficients}


def _examined(problem: Problem, fit: Refined, split: int) -> Examination:
    """The innovation of the bench's observer that begins with the constants of the free run."""
    _, model = model_for(problem.device.axes)
    constants = {constant.name for constant in model.constants}
    found = {name: float(value) for name, value in zip(fit.names, fit.state, strict=True) if name in constants}
    initial = {**problem.settings.initial, **found}
    alone = replace(problem, settings=replace(problem.settings, initial=initial), controller=None)
    return examine(alone, split)


def _found(name: str, found: SimulationTrace, device: Device) -> Found:
    _, effect = effect_for(name, device.axes)
    return Found(
        name=name,
        title=effect.title,
        equation=equations(effect),
        coefficients={
            c.name: Interval(found.after.value(c.name), *found.after.interval(c.name), c.unit)
            for c in effect.coefficients
        },
        evidence=found.evidence[name],
        undone=effect.undone.value,
    )
