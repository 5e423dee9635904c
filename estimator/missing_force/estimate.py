"""The force that a model lacks, and its form: few terms, found by the search that a trace makes.

The form is what a trace finds where the laws of a library stand beside the catalogue; it is no cause.  The force is a
Gaussian process beside the motion, in one state; the form is not asked for it.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estimator.core.compiler import command
from estimator.diagnosis import Interval
from estimator.effects.declaration import Effect
from estimator.effects.labels import kind
from estimator.errors import ModelError
from estimator.missing_force.beside import beside
from estimator.missing_force.library import Term, library
from estimator.missing_force.result import Form, FormTerm, MissingForce
from estimator.missing_force.smoother import Smoothed, chosen, smooth
from estimator.observer import Estimates
from estimator.scaling import Scaling
from estimator.settings import Sensed
from estimator.trace.chosen import REFINED
from estimator.trace.examination import examine
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import ObserverLayout, observer_of
from estimator.trace.named import constants_of, effects_of, intervals_of
from estimator.trace.observed import run
from estimator.trace.problem import Effects, Problem
from estimator.trace.start import begin_moving
from estimator.trace.trace import judged_on, likelihood_of
from estimator.trace.traceable import require_traceable
from estimator.trace.verdict import Judged

_UNEVEN = 1e-3  # largest spread of the steps


def missing_force(problem: Problem, split: int) -> MissingForce:
    """The force that the model of `problem` lacks; its form chosen before `split`, judged behind it.

    Of a long record as much is looked at on either side of the split as a trace fits.  Raises ModelError where a
    channel shows no displacement, the samples are not evenly spaced, or no filter follows the record.
    """
    first, last = max(split - REFINED, 0), min(split + REFINED, len(problem.record))
    problem, split = problem.part(slice(first, last)), split - first
    step = problem.record.step[1:]
    if any(sensed is not Sensed.DISPLACEMENT for sensed in problem.device.sensed):
        raise ModelError("a channel shows no displacement")
    if not len(step) or float(np.ptp(step)) > _UNEVEN * float(np.mean(step)):
        raise ModelError("the samples are not evenly spaced")
    residual = examine(problem, split).residual[:split]
    terms = library(problem, residual) if command() else ()  # they are compiled on first use
    device = replace(problem.device, own=(*problem.device.own, *(term.effect for term in terms)))
    problem = replace(problem, device=device)
    require_traceable(problem.record, problem.device, split)
    _, judged, _ = judged_on(likelihood_of(problem, split), split)
    form = _form(judged, {term.effect.name: term for term in terms})
    return _drawn(problem, judged, form, first, split)


def _form(judged: Judged, terms: Mapping[str, Term]) -> Form:
    """None where the part held out does not bear it out."""
    was, now, share = judged.evidence.before_ratio, judged.evidence.floor_ratio, judged.share
    if not judged.named or not now < was or share is None:
        return Form((), 1.0, was, was)
    found = tuple(_term(judged, name, terms.get(kind(name))) for name in judged.named)
    return Form(found, float(np.sqrt(max(1.0 - share, 0.0))), was, now)


def _term(judged: Judged, name: str, law: Term | None) -> FormTerm:
    effect = judged.evidence.of.effect(name)
    assert isinstance(effect, Effect)
    intervals, inside = intervals_of(effect, judged.evidence.model, name), {kind(p.name) for p in effect.parameters}

    def told(*, within: bool) -> dict[str, Interval]:
        return {key: one for key, one in intervals.items() if (key in inside) is within}

    if law is None:
        written = kind(name).replace("_", " ")
        return FormTerm(written, not effect.pushes, told(within=False), told(within=True), {}, kind(name))
    labelled = {label: f"c_{label.replace(' ', '_')}" for label in law.laws}
    own = {label: intervals[symbol] for label, symbol in labelled.items()}
    return FormTerm(law.form, not effect.pushes, own, told(within=True), law.laws)


def _drawn(problem: Problem, judged: Judged, form: Form, first: int, split: int) -> MissingForce:
    """What the model that was fitted with the form lacks: without the effects of the form, and with them."""
    model, record, scaling = judged.evidence.model, problem.record, Scaling.of(problem.device)
    start, told = _followed(problem, model)
    axes, fitted = problem.device.axes, constants_of(model)
    motion = {name: told.of(name) for name in told.names}
    for name in ("phi_x", "phi_y")[:axes]:  # as they are known at the end
        start[name] = fitted.get(name, float(motion[name][-1]))
        motion[name] = np.array(start[name])
    every = effects_of(model)

    def smoothed(effects: Effects) -> Smoothed:
        known = beside(problem, effects, motion, start)
        return smooth(known, chosen(known))

    drawn = after = smoothed({name: given for name, given in every.items() if name not in judged.named})
    if form.terms:
        after = smoothed(every)
    force, length = scaling.force, scaling.length
    gain = start.get("drive_gain_x", scaling.drive_gain) / scaling.drive_gain
    return MissingForce(
        first=first,
        time=np.asarray((first + np.arange(len(record))) * np.mean(record.step)),
        position=after.motion[:, ::2] * length,
        velocity=after.motion[:, 1::2] * length * scaling.omega0,
        drive=np.sum(record.drive, axis=2) / scaling.drive * gain * force,
        force=drawn.force * force,
        deviation=drawn.force_deviation * force,
        left=after.force * force,
        left_deviation=after.force_deviation * force,
        temperature=record.channels.get("temperature"),
        there=np.all(np.isfinite(record.sense), axis=1),
        split=split,
        form=form,
    )


def _followed(problem: Problem, model: FittedModel) -> tuple[dict[str, float], Estimates]:
    """Where a filter of the model begins, SI, and what it makes of the record."""
    layout = model.layout
    assert isinstance(layout, ObserverLayout)
    noise = model.model.noise if problem.device.axes == 2 else None
    observer = observer_of(problem, layout.effects_of(model.model), noise)
    observer.x[observer.states + layout.index] = model.model.theta[: len(layout.index)]
    begin_moving(observer, problem.record)
    start = dict(zip(observer.names, observer.state.tolist(), strict=True))
    told = run(observer, problem.record, every=1)
    if not np.all(np.isfinite(told.state)):
        raise ModelError("no filter follows this record")
    return start, told
