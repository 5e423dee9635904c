"""From what a scan shows to what the model lacks: the leading candidates fitted, their likelihoods compared.

Far from the truth a score test is a rough guide, so those that come into question are each fitted once.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.chance import TWO_SIDED, chi2_isf
from estimator.completeness.answer import Lacking
from estimator.completeness.constants import Off, shares
from estimator.completeness.scores import Scores, ratio_of
from estimator.completeness.stretched import Stretched, beside
from estimator.completeness.turning import Turning
from estimator.completeness.words import Nearest
from estimator.diagnosis import Interval
from estimator.effects.catalogue import effect_for
from estimator.effects.labels import kind
from estimator.scaling import Array
from estimator.settings import Device
from estimator.side_by_side import side_by_side
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import RARE, TIE
from estimator.trace.named import effects_of
from estimator.trace.problem import Effects
from estimator.trace.score_test import Score
from estimator.trace.search import first_possible, fitted_candidates, gain_of

HARMLESS = 1.0 / 3.0
"""Of the limit: what moves the angle by less is told, not held against the run."""


@dataclass(frozen=True)
class Taken:
    """What a record shows: one effect, or several constants of the calibration together.

    angle: how far it moves the angle where that is most; shift, deviation (m,) rad: how far in the course of the run;
    model: the one that has the effect, None for constants, which every model has; freed: the constant that is off by
    more than is declared, "" where it is another effect.
    """

    lacking: tuple[Lacking, ...]
    angle: Interval
    shift: Array
    deviation: Array
    model: FittedModel | None = None
    freed: str = ""


def freed(
    of: Stretched, bare: FittedModel, base: FittedModel, constants: Collection[str], enough: float
) -> dict[str, FittedModel]:
    """By constant, the model in which it is off by more than is declared and the others are as declared; none where all
    are as declared.  bare: the model without constants.
    """
    if as_declared(base, constants):
        return {}
    there = base.layout.effects_of(base.model)

    def fitted(name: str) -> FittedModel:
        free, others = of.freeing(name), {one: there[one] for one in constants if one != name}
        # By itself first: among others that can do the same, its likelihood is a ridge, and a bent one.
        alone = beside(free, bare, {one: given for one, given in there.items() if one not in others}, enough)
        return beside(free, alone, others, enough)

    models = side_by_side([partial(fitted, name) for name in constants])
    return dict(zip(constants, models, strict=True))


def as_declared(model: FittedModel, constants: Collection[str]) -> bool:
    """Whether constants of the calibration are together no farther off than chance lets what is declared of them be."""
    places = [k for name in constants for k in model.layout.of(name)]
    off = model.model.theta[places] / model.layout.deviation[places]
    return not places or bool(off @ off < chi2_isf(RARE, len(places)))


def odds(model: FittedModel) -> float:
    """Twice the log-likelihood with all that is declared as measurements, less what the parameters cost (Schwarz)."""
    return 2.0 * model.objective - float(model.told.sum() * np.log(model.evaluation.count.sum()))


@dataclass(frozen=True)
class Leader:
    """What explains most once the model has it: an effect, or a constant that may be off by more than is declared;
    alike: other constants that do as well in its place.
    """

    name: str
    model: FittedModel
    is_freed: bool = False
    alike: tuple[str, ...] = ()


def leader(
    of: Stretched, base: FittedModel, serious: Sequence[Score], beyond: Mapping[str, FittedModel], margin: float
) -> Leader | None:
    """The best of serious effects and of constants `beyond` what is declared (`freed`); None where none stands better
    by `margin` (twice the log-likelihood).
    """
    best = first_possible(of, fitted_candidates(of, base, serious)) if serious else None
    if best is not None and not best[1].surplus_over(base) > margin:
        best = None
    ranked = sorted(beyond.items(), key=lambda pair: -odds(pair[1]))
    off = first_possible(of, ranked)
    if off is not None and odds(off[1]) > max(odds(base) + margin, odds(best[1]) if best else -np.inf):
        alike = (name for name, model in ranked if name != off[0] and odds(model) > odds(off[1]) - TIE)
        return Leader(*off, True, tuple(alike))
    return None if best is None else Leader(*best)


def leading(
    of: Stretched,
    base: FittedModel,
    first: Leader,
    seen: Scores,
    others: Collection[str],
    turning: Turning,
    move: Callable[[Effects], Array],
    limits: tuple[float, float],
) -> Taken | Nearest | None:
    """What the first candidate does to the angle; the nearest where the innovation stays above so many times what is
    predicted of it, rms, or `others`, constants of the calibration, are still off by more than is declared; None where
    it is not sure by the margin.  limits: those of innovation and margin.

    Far from the truth a score test is outside its linear range: effects that are not there take up most of the residual
    of one that is. What is left then tells, and an interval, which presumes that nothing is, would be none.  `move` has
    how far (m,) effects as large as they are move the angle.
    """
    name, model, (enough, margin) = first.name, first.model, limits
    ratio = _ratio_of(of, model)
    if not ratio <= enough:
        return Nearest(kind(name), f"{ratio:.3g} × the noise")
    if first.is_freed and not as_declared(model, [one for one in others if one != name]):
        return Nearest(name, "other constants of the calibration off by more than is declared")
    if not gain_of(of, model, name) > margin:  # else it is the noise of the base model that is not fitted
        return None
    gain = 2.0 * (model.objective - base.objective) if first.is_freed else model.rise_over(base)
    return _taken_alone(of, first, gain, seen, turning, move({name: effects_of(model)[name]}))


def _taken_alone(of: Stretched, first: Leader, gain: float, seen: Scores, turning: Turning, moved: Array) -> Taken:
    name, model = first.name, first.model
    effect, layout = of.effect(name), model.layout
    places = layout.of(name)[: len(effect.coefficients)]
    factor = layout.factor[places]
    values, spread = model.model.theta[places] * factor, model.covariance[np.ix_(places, places)]
    spread = spread * np.outer(factor, factor)
    half = TWO_SIDED * np.sqrt(np.diagonal(spread))
    shift, deviation = turning.course([name], values, spread)
    if np.all(np.isfinite(moved)):  # else the run's observer loses the motion with it: the derivative is what there is
        shift = moved
    angle = largest(shift, deviation)
    lacking = Lacking(
        effect=kind(name),
        title=effect.title,
        coefficients={
            c.name.partition(":")[0]: Interval(float(value), float(value - h), float(value + h), c.unit)
            for c, value, h in zip(effect.coefficients, values, half, strict=True)
        },
        evidence=gain,
        angle=angle,
        alike=tuple(dict.fromkeys(kind(o) for o in (*first.alike, *seen.alike(name, values)) if kind(o) != kind(name))),
    )
    return Taken((lacking,), angle, shift, deviation, model, name if first.is_freed else "")


def taken_together(off: Off, turning: Turning, device: Device, harmless: float) -> Taken:
    """The constants as they were found.  What one of them does to the angle is its share of what all do: of two that
    the record tells only together, each by itself may turn the angle far more than both do.  It is told where they do
    most, and where that is below `harmless` rad at the end, where the calibration's part of the budget counts.
    """
    found, names = off.found, list(off.places)
    shift, deviation = turning.course(names, found.mean, found.covariance)
    at = int(np.argmax(np.abs(shift)))
    angle = largest(shift, deviation)
    g = found.sensitivity[at if angle.high >= harmless else -1]
    sizes = shares(g * found.mean * float(g @ found.mean), off.places)
    spreads = shares(g * (found.covariance @ g), off.places)
    half = TWO_SIDED * found.deviation
    lacking = []
    for name, places in off.places.items():
        intervals = zip(found.symbols[places], found.units[places], found.mean[places], half[places], strict=True)
        lacking.append(
            Lacking(
                effect=kind(name),
                title=effect_for(name, device.axes, device.own)[1].title,
                coefficients={
                    symbol: Interval(float(value), float(value - h), float(value + h), unit)
                    for symbol, unit, value, h in intervals
                },
                evidence=off.evidence,
                angle=_interval(sizes[name], spreads[name]),
            )
        )
    lacking.sort(key=lambda item: -item.angle.value)
    return Taken(tuple(lacking), angle, shift, deviation)


def _ratio_of(of: Stretched, model: FittedModel) -> float:
    """Innovation of a model with the declared noise over what it predicts of it, rms; infinite where it loses the
    motion.
    """
    quiet = replace(model.model, noise=of.declared_noise())
    seen = of.evaluate(model.layout, quiet, derivatives=False)
    ratio = ratio_of(seen)
    return ratio if seen.sound and np.isfinite(ratio) else float("inf")


def largest(shift: Array, deviation: Array) -> Interval:
    """How far the angle is off, at the instant where that is most; shift and its deviation (m,) rad."""
    at = int(np.argmax(np.abs(shift)))
    return _interval(float(abs(shift[at])), float(deviation[at]))


def _interval(size: float, deviation: float) -> Interval:
    half = TWO_SIDED * deviation
    return Interval(size, max(size - half, 0.0), size + half, "rad")
