"""The observer with chosen effects over a part of the record, as exact as the model goes.

One pass from the declared values finds the constants, a second begins with them and with a spread of many of their
standard deviations: linearised about the right place from the first sample on, its likelihood and covariance mean what
they say, while what is counted twice is one part in a hundred.  Where a coefficient leaves even that spread, as one may
that acts by more than its first power, the pass was linearised about the wrong place and another follows.  Beside
innovations that are larger than the observer takes them to be, the standard deviations are so many times larger, too:
where much is left, an average moves from pass to pass by more than noise would move it, and is no nearer for it.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.effects.catalogue import effect_for
from estimator.gaps import observe
from estimator.observer import Estimates, Observer
from estimator.record import Record
from estimator.scaling import Array, Scaling
from estimator.settings import Device, Gain, ObserverSettings, Variant
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.problem import Problem
from estimator.trace.start import begin_about, begin_moving

_SET = THRESHOLDS.start


@dataclass(frozen=True)
class Fitted:
    """A model after the fitting part: its observer, what it predicted there, twice its log-likelihood; settled: whether
    another pass, linearised about what this one found, would come to the same.
    """

    settings: ObserverSettings
    observer: Observer
    estimates: Estimates
    likelihood: float
    settled: bool = True


def log_likelihood(innovation: Array, deviation: Array) -> float:
    """Twice the log-likelihood of innovations (n, axes) with their predicted deviations, but for a constant."""
    with np.errstate(invalid="ignore"):
        terms = (innovation / deviation) ** 2 + 2.0 * np.log(deviation)
    return float(-np.sum(terms[np.isfinite(terms)]))


def widening(model: Fitted) -> float:
    """By how much a model's estimates are less sure than its observer takes them to be: its innovations are larger; no
    number where the observer follows none of the record.
    """
    return widening_of(model.estimates)


def widening_of(estimates: Estimates) -> float:
    """The same of the estimates of an observer."""
    with np.errstate(invalid="ignore", over="ignore"):
        normalised = (estimates.innovation / estimates.innovation_deviation) ** 2
    seen = normalised[~np.isnan(normalised)]
    return max(float(np.sqrt(np.mean(seen))), 1.0) if seen.size else float("nan")


def is_as_predicted(model: Fitted) -> bool:
    """Whether a model leaves no more than an explained record may, beside what its observer takes innovations to be."""
    return widening(model) ** 2 < 1.0 + THRESHOLDS.width.power


def constants_of(observer: Observer) -> dict[str, float]:
    """The base model's constants as estimated, SI, but for the rate, which is no constant."""
    names = observer.model.names[observer.states :]
    values = observer.state[observer.states : len(observer.model.names)]
    return {name: float(value) for name, value in zip(names, values, strict=True) if name != "rate"}


def coefficients_of(observer: Observer) -> dict[str, dict[str, float]]:
    """The effects of an observer with their coefficients as estimated and their parameters, SI."""
    values = dict(zip(observer.names, observer.state.tolist(), strict=True))
    return {
        effect.name: {
            **{c.name.partition(":")[0]: values[c.name] for c in effect.coefficients},
            **{
                p.name: observer.settings.effects[effect.name][p.name]
                for p in effect.parameters
                if p.name in observer.settings.effects[effect.name]
            },
        }
        for _, effect in observer.effects
    }


def is_lost(innovation: Array, device: Device) -> bool:
    """Whether innovations (n, axes) V are so large that the observer does not follow the motion."""
    missed = innovation / (np.abs(device.sense_gain) * device.amplitude)
    seen = missed[~np.isnan(missed)]
    return not (len(seen) and np.sqrt(np.mean(seen**2)) < THRESHOLDS.scan.locked)


def run(observer: Observer, record: Record, every: int | None = None) -> Estimates:
    """The observer over a record; lost samples have NaN innovation."""
    estimates = observe(
        observer,
        record.sense,
        record.drive,
        record.gaps,
        step=record.step,
        every=every or len(record),
        temperature=record.channels.get("temperature"),
    )
    return replace(estimates, innovation=np.where(np.isfinite(record.sense), estimates.innovation, np.nan))


def fit(problem: Problem, passes: int = 2, *, about: Observer | None = None, again: bool = True) -> Fitted:
    """The model of the record (`_fit`); where it comes to nothing, the best of those from elsewhere, as an effect's
    coefficients declare where.  Without `again`, by no more than those passes, whether they came near enough or not.
    """
    more = _SET.again if again else 0
    found = _fit(problem, passes, about, more)
    if about is not None or is_as_predicted(found):
        return found
    starts = [problem.carrying(effects) for effects in _other_starts(problem)]
    others = side_by_side([partial(_fit, start, passes, None, more) for start in starts])
    return max((found, *others), key=lambda fitted: fitted.likelihood)


def _other_starts(problem: Problem) -> list[dict[str, dict[str, float]]]:
    """The effects, with one of them that has no coefficients yet begun where its declaration has it tried."""
    device = problem.device
    starts = []
    for name, given in problem.effects.items():
        _, effect = effect_for(name, device.axes, device.own)
        scaling = Scaling.of(device)
        tried = {
            c.name.partition(":")[0]: [value * scaling.coefficient(c) for value in c.tried]
            for c in effect.coefficients
            if c.tried
        }
        if any(symbol in given for symbol in tried):
            continue
        for values in zip(*tried.values(), strict=True):
            begun = dict(zip(tried, values, strict=True))
            starts.append({**{other: dict(own) for other, own in problem.effects.items()}, name: {**given, **begun}})
    return starts


def _fit(problem: Problem, passes: int, about: Observer | None, again: int) -> Fitted:
    """Estimate constants and effects over the record without forgetting, beginning again with what was found; with
    `passes` of two, up to `again` more where the second shows that the first did not come near enough.

    about: an observer with the same effects that a pass over part of the record came to, whose settings the problem
    has: begun about it, one pass is as good as a second, and followed by others where that would be.
    """
    device = problem.device
    current = replace(problem.settings, gain=Gain.EKF)
    previous = about
    opening = _opening(problem) if passes > 1 and about is None else problem
    settled = False
    for number in range(passes + (again if passes > 1 or about is not None else 0)):
        observer = Observer(device, current, problem.controller)
        if not problem.effects and device.axes == 2 and current.variant is Variant.FULL:
            observer.carry_both()
        if previous is not None:
            begin_about(observer, previous)
        begin_moving(observer, problem.record)
        coefficients = slice(len(observer.x) - len(observer.coefficient_deviations), None)
        begun, spread = observer.x[coefficients].copy(), observer.coefficient_deviations
        estimates = run(observer, (problem if number else opening).record)
        previous = observer
        diverged = _has_diverged(observer, estimates)
        if number == 0 and passes > 1 and about is None and not diverged and is_lost(estimates.innovation, device):
            observer = previous = _catching(problem, current, opening.record) or observer
        if diverged:
            if number == 0 and opening is not problem:
                return _fit(problem, 1, None, 0)
            break
        found = constants_of(observer) | _steady_rate(problem, observer)
        current = replace(current, initial={**current.initial, **found}, effects=coefficients_of(observer))
        settled = bool(np.all(np.abs(observer.x[coefficients] - begun) <= widening_of(estimates) * spread))
        if number + 1 >= passes and settled:
            break
    likelihood = log_likelihood(estimates.innovation, estimates.innovation_deviation)
    return Fitted(current, observer, estimates, -np.inf if diverged else likelihood, settled)


def _has_diverged(observer: Observer, estimates: Estimates) -> bool:
    """Whether a state is no number any more, or what should be a variance of an innovation none."""
    return not (np.all(np.isfinite(observer.x)) and np.all(np.isfinite(estimates.innovation_deviation)))


def _catching(problem: Problem, settings: ObserverSettings, record: Record) -> Observer | None:
    """An observer that forgets, as the bench's does, at the end of the record, if it follows the motion: it comes back
    from where a start has led it that an effect which is not carried has upset.
    """
    observer = Observer(problem.device, replace(settings, gain=Gain.FADING), problem.controller)
    begin_moving(observer, record)
    estimates = run(observer, record)
    later = estimates.innovation[len(record) // 2 :]
    return None if _has_diverged(observer, estimates) or is_lost(later, problem.device) else observer


def _opening(problem: Problem) -> Problem:
    """What a first pass is made of: a part of a long record, where nothing goes with a temperature, which has hardly
    moved by then.
    """
    samples = len(problem.record)
    enough = max(_SET.opening, round(_SET.opening_share * samples))
    if enough >= samples or "temperature" in problem.record.channels:
        return problem
    return problem.part(slice(0, enough))


def _steady_rate(problem: Problem, observer: Observer) -> dict[str, float]:
    """The rate at the end of a pass, where it moves by less over the record than it is unknown by beforehand: begun far
    from it, with constants that are known, an observer takes the start for something else and is long in forgetting it.
    """
    settings = problem.settings
    if "rate" not in observer.names or settings.process_noise.rate * np.sqrt(problem.span) >= settings.spread.rate:
        return {}
    return {"rate": float(observer.state[observer.names.index("rate")])}
