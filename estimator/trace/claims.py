"""The claim of a trace of two axes: what its models say, and what the part held out says of it."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from estimator.diagnosis import Fit
from estimator.effects.catalogue import effect_for
from estimator.effects.search import Search
from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import Gain
from estimator.side_by_side import together
from estimator.trace.candidates import kind, searched_by
from estimator.trace.certainty import TWO_SIDED
from estimator.trace.constancy import constancies
from estimator.trace.determined import declared
from estimator.trace.engine import Estimate
from estimator.trace.examination import Examination
from estimator.trace.fitting import Fitted, log_likelihood, widening
from estimator.trace.nameless import contest
from estimator.trace.problem import Problem
from estimator.trace.promises import Claim, Constant, Departure, Errors, Level, Vote, is_positive
from estimator.trace.selection import Selection
from estimator.trace.sidebands import sidebands


def claim_of(problem: Problem, selection: Selection, before: Examination, after: Examination, split: int) -> Claim:
    """What is to be said of the whole record of `problem`, of which all from `split` on is held out."""
    known = problem.effects
    effects = {name: given for name, given in selection.coefficients.items() if name not in known}
    later = len(problem.record) - split
    residual = residual_of(before.held_out, after.held_out, later * problem.device.axes)
    was, now = (
        log_likelihood(one.estimates.innovation[split:], one.estimates.innovation_deviation[split:])
        for one in (before, after)
    )
    contested, departures = together(
        lambda: contest(before.innovations, after.innovations, split),
        lambda: _departures(problem.part(slice(0, split)), selection, effects),
    )
    return Claim(
        residual=replace(residual, gain=now - was),
        effects=effects,
        constants=(*constants_of(problem, selection.after), *_rate(problem, after, split)),
        levels=_levels(problem, selection, effects, split),
        votes=_votes(problem, before, after, split),
        contest=contested,
        departures=departures,
        sidebands=sidebands(problem.record.part(slice(0, split)), selection.effects, effects),
    )


def _departures(problem: Problem, selection: Selection, names: Iterable[str]) -> dict[str, Departure]:
    """Of these effects, over the part that was fitted: what departs by δ from a coefficient c gains δ² where c has
    gained c².
    """
    return {
        name: Departure(float(np.sqrt(one.excess / max(selection.gain[name], one.excess, 1.0))), one.chance)
        for name, one in constancies(problem, selection.after, names).items()
    }


def residual_of(before: Fit, after: Fit, samples: float) -> Errors:
    """Innovations of the part held out in multiples of the floor (`on_one_floor`)."""
    was, left = on_one_floor(before, after)
    return Errors(was.ratio, left.ratio, 1.0, samples)


def on_one_floor(before: Fit, after: Fit) -> tuple[Fit, Fit]:
    """Both over the same floor, per axis the lower of the two that were seen: a model that raises all of the spectrum
    does not raise its own measure, and what an effect had put into the floor counts as a part of the residual.
    """
    floor = np.minimum(before.noise_floor, after.noise_floor)
    source = before.floor_from
    if after.floor_from != source:
        source = f"the lower of {source} and {after.floor_from}"

    def over(fit: Fit) -> Fit:
        multiples = np.array(fit.innovation_rms) / np.maximum(floor, np.finfo(float).tiny)
        ratio = float(np.sqrt(np.mean(multiples**2)))
        return replace(fit, noise_floor=tuple(floor.tolist()), ratio=ratio, floor_from=source)

    return over(before), over(after)


def constants_of(problem: Problem, model: Fitted) -> tuple[Constant, ...]:
    """Those of the base model but for the rate, which moves."""
    beginning = Observer(problem.device, replace(problem.settings, gain=Gain.EKF, effects={}))
    observer = model.observer
    with np.errstate(invalid="ignore"):
        sure = widening(model) * np.sqrt(np.diagonal(observer.covariance))
    found = []
    for name, one in declared(beginning).items():
        if name == "rate" or name not in observer.estimated:
            continue
        value = float(observer.state[observer.names.index(name)])
        half = TWO_SIDED * float(sure[observer.estimated.index(name)])
        constant = Constant(
            name, value, value - half, value + half, one.value, one.deviation, positive=is_positive(name)
        )
        found.append(constant)
    return tuple(found)


def _rate(problem: Problem, after: Examination, split: int) -> tuple[Constant, ...]:
    """The rate where it was estimated farthest from its initial value, beside how far it may have moved by then."""
    if "rate" not in after.estimates.names:
        return ()
    later = after.estimates.index >= split
    estimates = after.estimates
    rate, sure = estimates.of("rate")[later], estimates.deviation[later, estimates.names.index("rate")]
    initial = problem.settings.initial.get("rate", 0.0)
    beyond = np.abs(rate - initial) - TWO_SIDED * sure
    if not np.any(np.isfinite(beyond)):
        return ()
    at = int(np.nanargmax(beyond))
    random_walk = problem.settings.process_noise.rate**2 * problem.span
    deviation = float(np.sqrt(problem.settings.spread.rate**2 + random_walk))
    value, half = float(rate[at]), TWO_SIDED * float(sure[at])
    return (Constant("rate", value, value - half, value + half, initial, deviation),)


def _levels(
    problem: Problem, selection: Selection, effects: Mapping[str, Mapping[str, Estimate]], split: int
) -> tuple[Level, ...]:
    """Of a sense chain that saturates, where all that goes over the level is lost."""
    found = []
    for name, coefficients in effects.items():
        if searched_by(name) is not Search.LEVELS:
            continue
        (level,) = (selection.effects[name][p.name] for p in effect_for(name, problem.device.axes)[1].parameters)
        for axis, share in enumerate(coefficients.values()):
            if not share.low <= 1.0 <= share.high:
                continue
            most = abs(problem.device.sense_gain[axis]) * level
            seen: Array = problem.record.sense[split:, axis]
            noise, unit = max(problem.device.noise[axis], 0.0), problem.device.sense_unit
            found.append(Level(kind(name), -most, most, float(np.nanmin(seen)), float(np.nanmax(seen)), noise, unit))
    return tuple(found)


def _rate_moved(before: Examination, after: Examination, split: int) -> float:
    """By what the estimate of the rate differs, rms over the part held out."""
    was, now = (one.estimates.of("rate")[one.estimates.index >= split] for one in (before, after))
    return float(np.sqrt(np.nanmean((now - was) ** 2)))


def _votes(problem: Problem, before: Examination, after: Examination, split: int) -> tuple[Vote, ...]:
    """Angle and rate against the record's own reference for the rate.

    To be expected are what the observer takes its estimate to be off by, and the noise of the reference, which its
    steps from sample to sample tell.  An angle that is off has been so in one draw.  An estimate of the rate also
    lags, by any model; it only must not become worse: with e the error before and δ by what an effect moves the
    estimate, |e + δ| < |e| says that more than half of δ is in −e.  It is drawn anew once in the observer's memory.
    """
    reference = problem.record.channels.get("rate")
    if reference is None or after.held_out.rate_error_rms is None or before.held_out.rate_error_rms is None:
        return ()
    later = reference[split:]
    step = float(np.mean(problem.record.step[split:]))
    span = float(np.sum(problem.record.step[split:]))
    noise = float(np.nanstd(np.diff(later))) / np.sqrt(2.0)
    estimates = after.estimates
    sure = estimates.deviation[estimates.index >= split, estimates.names.index("rate")]
    rate = float(np.sqrt(np.nanmean(sure**2) + noise**2))
    draws = max(span / problem.settings.memory, 1.0)
    errors = Errors(before.held_out.rate_error_rms, after.held_out.rate_error_rms, rate, draws)
    votes = [Vote("error of the rate", "rad/s", errors, _rate_moved(before, after, split))]
    if before.held_out.angle_error_rms is not None and after.held_out.angle_error_rms is not None:
        random_walk = noise * step * np.sqrt(len(later))
        angle = float(np.sqrt(np.nanmean(estimates.angle_deviation[split:] ** 2) + random_walk**2))
        errors = Errors(before.held_out.angle_error_rms, after.held_out.angle_error_rms, angle, 1.0)
        votes.append(Vote("error of the angle", "rad", errors))
    return tuple(votes)
