"""The force that a model lacks, and its form: few terms, found by the search that a trace makes.

The form is what a trace finds where the laws of a library stand beside the catalogue; it is no cause.  The force is a
Gaussian process beside the motion, in one state; the form is not asked for it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.core.compiler import command
from estimator.diagnosis import Interval
from estimator.effects.declaration import Effect
from estimator.effects.labels import kind
from estimator.errors import ModelError
from estimator.missing_force.along import along
from estimator.missing_force.library import Term, library
from estimator.missing_force.linear import Linear, turned
from estimator.missing_force.result import Form, FormTerm, MissingForce
from estimator.missing_force.smoother import Smoothed, chosen, smooth
from estimator.observer import Observer
from estimator.scaling import Array, Scaling
from estimator.settings import Sensed
from estimator.trace.examination import examine
from estimator.trace.filtered import Filtered
from estimator.trace.likelihood import ObserverLayout, observer_of
from estimator.trace.named import constants_of, effects_of, intervals_of
from estimator.trace.observed import run
from estimator.trace.problem import Problem
from estimator.trace.result import Judged
from estimator.trace.start import begin_moving
from estimator.trace.trace import judged_on

_BEFORE, _AFTER = 120_000, 80_000  # samples on either side of the split
_UNEVEN = 1e-3  # largest spread of the steps
_LEAST_NOISE = 1e-16


def missing_force(problem: Problem, split: int) -> MissingForce:
    """The force that the model of `problem` lacks; its form chosen before `split`, judged behind it.

    Of a long record the 120,000 samples before the split and the 80,000 behind it are looked at.  Raises ModelError
    where a channel shows no displacement, the samples are not evenly spaced, or no filter follows the record.
    """
    first, last = max(split - _BEFORE, 0), min(split + _AFTER, len(problem.record))
    problem, split = problem.part(slice(first, last)), split - first
    step = problem.record.step[1:]
    if any(sensed is not Sensed.DISPLACEMENT for sensed in problem.device.sensed):
        raise ModelError("a channel shows no displacement")
    if not len(step) or float(np.ptp(step)) > _UNEVEN * float(np.mean(step)):
        raise ModelError("the samples are not evenly spaced")
    residual = examine(problem, split).residual.innovation[:split]
    terms = library(problem, residual) if command() else ()  # they are compiled on first use
    device = replace(problem.device, own=(*problem.device.own, *(term.effect for term in terms)))
    problem = replace(problem, device=device)
    _, judged, _ = judged_on(problem, split)
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


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known beside the force: the base model along the record, scaled, and the terms of the form (SI)."""

    linear: Linear
    terms: tuple[tuple[Effect, Mapping[str, float]], ...]
    temperature: Array | None
    force_noise: float

    def form(self, motion: Array, scaling: Scaling) -> tuple[Array, Array]:
        """Force and sensed displacement (n, axes) of the form along a motion (n, states)."""
        linear = self.linear
        n, axes = len(motion), linear.axes
        driven = linear.drive @ np.ones(linear.drive.shape[2])
        series: dict[str, Array] = {"t": np.arange(n, dtype=np.float64) * linear.step}
        series["T"] = np.zeros(n) if self.temperature is None else np.nan_to_num(self.temperature)
        for axis, name in enumerate("xy"[:axes]):
            series |= {name: motion[:, 2 * axis], f"v{name}": motion[:, 2 * axis + 1], f"u{name}": driven[:, axis]}
        force, sensed = np.zeros((n, axes)), np.zeros((n, axes))
        for effect, given in self.terms:
            one, other = along(effect, given, scaling, series, axes)
            force, sensed = force + one, sensed + other
        return force, sensed


def _known(problem: Problem, judged: Judged) -> _Known:
    """By the model that was fitted with the form; a filter of it tells offsets and rate."""
    model, of = judged.evidence.model, judged.evidence.of
    assert isinstance(of, Filtered)
    assert isinstance(model.layout, ObserverLayout)
    record, axes = problem.record, problem.device.axes
    filtered = observer_of(problem, model.layout.effects_of(model.model), model.model.noise if of.axes == 2 else None)
    filtered.x[filtered.states + model.layout.index] = model.model.theta[: len(model.layout.index)]
    begin_moving(filtered, record)
    told = run(filtered, record, every=1)
    if not np.all(np.isfinite(told.state)):
        raise ModelError("no filter follows this record")
    observer = Observer(problem.device, replace(problem.settings, effects={}))
    z, u, h, _ = observer.scaled(record.sense, record.drive, record.step, None)
    factor = dict(zip(observer.names, observer.factors, strict=True))
    fitted = dict(zip(model.layout.names, (model.model.theta * model.layout.factor).tolist(), strict=True))
    offset = [fitted.get(name, float(told.of(name)[-1])) / factor[name] for name in ("phi_x", "phi_y")[:axes]]
    constants = {**dict(zip(told.names, told.state[-1].tolist(), strict=True)), **constants_of(model)}
    warm = record.channels.get("temperature")
    given = effects_of(model)
    return _Known(
        Linear(
            sense=z, drive=u, step=float(np.mean(h[1:])),
            noise=np.array(problem.device.noise) / np.abs(observer.volts),
            constants={
                name: value / float(factor[name]) for name, value in constants.items()
                if name in factor and name != "rate" and not name.startswith("phi")
            },
            offset=np.array(offset),
            rate=told.of("rate") / factor["rate"] if "rate" in told.names else np.zeros(len(z)),
        ),
        tuple((effect, given[effect.name]) for _, effect in filtered.effects if effect.name in judged.named),
        None if warm is None else warm - warm[0],
        float(observer.force_noise[0]) + _LEAST_NOISE,
    )  # fmt: skip


def _drawn(problem: Problem, judged: Judged, form: Form, first: int, split: int) -> MissingForce:
    known, scaling = _known(problem, judged), Scaling.of(problem.device)
    linear = known.linear

    def smoothed(sense: Array) -> Smoothed:
        part = replace(linear, sense=sense)
        latent = chosen(part, known.force_noise)
        seen = smooth(part, latent, None, known.force_noise)
        return smooth(part, latent, turned(linear, seen.motion), known.force_noise)

    drawn = after = smoothed(linear.sense)
    told = np.zeros_like(drawn.force)
    if form.terms:
        told, sensed = known.form(drawn.motion, scaling)
        if np.any(sensed):
            after = smoothed(linear.sense - sensed)
            told, _ = known.form(after.motion, scaling)
    length, speed = scaling.length, scaling.length * scaling.omega0
    force, gain = scaling.force, linear.constants.get("drive_gain_x", 1.0)
    return MissingForce(
        first=first,
        time=np.asarray((first + np.arange(len(drawn.force))) * linear.step / scaling.omega0),
        position=drawn.motion[:, ::2] * length,
        velocity=drawn.motion[:, 1::2] * speed,
        drive=(linear.drive @ np.ones(linear.drive.shape[2])) * gain * force,
        force=drawn.force * force,
        deviation=drawn.force_deviation * force,
        left=(after.force - told) * force,
        left_deviation=after.force_deviation * force,
        temperature=problem.record.channels.get("temperature"),
        there=np.all(np.isfinite(linear.sense), axis=1),
        split=split,
        form=form,
    )
