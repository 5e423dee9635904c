"""From what a scan shows to what the model lacks: the leading candidates carried, their likelihoods compared.

Far from the truth a scan is a rough guide, so those that come into question are each carried by an observer once.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from estimator.completeness.answer import Lacking
from estimator.completeness.constants import Constants, Found, constants_of, shares
from estimator.completeness.turning import Turning
from estimator.completeness.words import Nearest
from estimator.diagnosis import Interval
from estimator.effects.catalogue import effect_for
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device
from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import Parameters, kind
from estimator.trace.certainty import TWO_SIDED, covariance_of
from estimator.trace.criterion import chance_gain, schwarz
from estimator.trace.evidence import Evidence, likeness
from estimator.trace.fitting import Fitted, coefficients_of, fit
from estimator.trace.observer_model import carries_over, estimates_of, numbers
from estimator.trace.problem import Problem
from estimator.trace.scan import Scan
from estimator.trace.searched import NOTHING
from estimator.trace.width import second_thoughts, shortlist

_TRIED = 3
_BESIDE = 1  # tried beside them, of another kind
_COMPARED = 10_000  # samples on which candidates are compared, at least
_ENOUGH = 1000.0  # of twice the log-likelihood: so much tells candidates apart
HARMLESS = 1.0 / 3.0
"""Of the limit: what moves the angle by less is told, not held against the run."""


@dataclass(frozen=True)
class Taken:
    """What a record shows: one effect, or several constants of the calibration together.

    angle: how far it moves the angle where that is most; shift, deviation (m,) rad: how far in the course of the run;
    given: coefficients and parameters as an observer takes them, SI, by name in the scan.
    """

    lacking: tuple[Lacking, ...]
    angle: Interval
    shift: Array
    deviation: Array
    given: dict[str, dict[str, float]]


def leading(
    problem: Problem,
    base: Fitted,
    watched: dict[str, Parameters],
    seen: Scan,
    serious: list[Evidence],
    turning: Turning,
    enough: float,
    declared: Mapping[str, float] = MappingProxyType({}),
) -> Taken | Nearest | None:
    """The effect that explains most once it is included in the model, None where none explains more than chance would;
    the nearest where the innovation stays above `enough` times what is predicted of it, rms.  Where the constants with
    declared standard deviations (by symbol, SI), all of them a little off, explain still more, these.

    Far from the truth a score test is outside its linear range: effects that are not there take up most of the residual
    of one that is. What is left then tells, and an interval, which presumes that nothing is, would be none.
    """
    record, device = problem.record, problem.device
    problem = problem.under(base.settings)
    names = shortlist(seen, serious)[:_TRIED]
    if serious[0].gain > _ENOUGH:
        names += second_thoughts({item.name: item for item in serious}, names)[:_BESIDE]
    share = min(_ENOUGH / serious[0].gain, 1.0)
    compared = problem.part(slice(0, min(max(int(share * len(record)), _COMPARED), len(record))))
    effects = coefficients_of(base.observer)
    without = fit(compared.carrying(effects))
    models = {name: fit(compared.carrying({**effects, name: watched[name]})) for name in names}
    gains = {name: model.likelihood - without.likelihood for name, model in models.items()}
    best = max(gains, key=lambda name: gains[name] - price(name, device, compared.record))
    worth = gains[best] - price(best, device, compared.record)
    constants = constants_of(declared, turning.columns, device)
    added = [name for name in constants.effects if name not in effects]
    if len(constants.effects) > 1 and added:
        cost = sum(price(name, device, compared.record) for name in added)
        model = fit(compared.carrying({**{name: {} for name in added}, **effects}))
        gain = model.likelihood - without.likelihood
        if (
            gain - cost > worth
            and ratio_of(model) <= enough
            and (gain >= _ENOUGH or carries_over(compared, without, model, *added))
        ):
            return _taken_together(constants, constants.after(problem), gain, turning, device)
    _, effect = effect_for(best, device.axes, device.own)
    candidates = len(seen.columns) * tries(watched[best], len(record))
    if not gains[best] > chance_gain(len(effect.coefficients), candidates):
        return None
    # What is weak must be borne out by samples that it was not found on, as in tracing; what is strong is beyond that.
    if gains[best] < _ENOUGH and not carries_over(compared, without, models[best], best):
        return None
    model = models[best]
    ratio = ratio_of(model)
    if not ratio <= enough:
        return Nearest(kind(best), ratio)
    covariance = covariance_of(best, model, NOTHING)
    given = coefficients_of(model.observer)[best]
    found = estimates_of(model, {})[best]
    values = np.array([one.value for one in found.values()])
    alike = likeness(seen, best, values)
    lacking = Lacking(
        effect=kind(best),
        title=effect.title,
        coefficients={
            symbol: Interval(one.value, one.low, one.high, c.unit)
            for c, (symbol, one) in zip(effect.coefficients, found.items(), strict=True)
        },
        evidence=gains[best],
        angle=angle_of(turning.of(best), values, covariance),
        alike=tuple(
            dict.fromkeys(
                kind(o) for o, value in alike.items() if value > THRESHOLDS.scan.same and kind(o) != kind(best)
            )
        ),
    )
    return Taken((lacking,), lacking.angle, *turning.course([best], values, covariance), {best: given})


def _taken_together(constants: Constants, found: Found, gain: float, turning: Turning, device: Device) -> Taken:
    """The constants as they were found.  What one of them does to the angle is its share of what all do: of two that
    the record tells only together, each by itself may turn the angle far more than both do.
    """
    moves = np.hstack([turning.of(name) for name in constants.effects])
    shift, deviation = turning.course(constants.effects, found.values, found.covariance)
    at = int(np.argmax(np.abs(shift)))
    sizes = shares(moves[at] * found.values * shift[at], constants.places)
    spreads = shares(moves[at] * (found.covariance @ moves[at]), constants.places)
    lacking = []
    for name, places in constants.places.items():
        _, effect = effect_for(name, device.axes, device.own)
        half = TWO_SIDED * np.sqrt(np.diagonal(found.covariance)[places])
        lacking.append(
            Lacking(
                effect=kind(name),
                title=effect.title,
                coefficients={
                    c.name.partition(":")[0]: Interval(float(value), float(value - h), float(value + h), c.unit)
                    for c, value, h in zip(effect.coefficients, found.values[places], half, strict=True)
                },
                evidence=gain,
                angle=_interval(sizes[name], spreads[name]),
            )
        )
    lacking.sort(key=lambda item: -item.angle.value)
    angle = _interval(float(abs(shift[at])), float(deviation[at]))
    return Taken(tuple(lacking), angle, shift, deviation, found.given)


def ratio_of(model: Fitted) -> float:
    """Innovation of a model over what it predicts of it, rms."""
    with np.errstate(all="ignore"):
        normalised = (model.estimates.innovation / model.estimates.innovation_deviation) ** 2
    return float(np.sqrt(np.nanmean(normalised)))


def tries(parameters: Parameters, samples: int) -> int:
    """In how many places an effect was looked for: a frequency comes from the largest of all lines of the residual."""
    return max(samples // 2, 1) if "omega" in parameters else 1


def price(name: str, device: Device, record: Record) -> float:
    """What the numbers of an effect cost in likelihood (Schwarz 1978)."""
    return schwarz(numbers(name, device), record.sense.size)


def angle_of(moves: Array, values: Array, covariance: Array) -> Interval:
    """How far the angle is off, at the instant where that is most, for coefficients with that covariance; moves (m, k)
    rad per SI unit.
    """
    shift = moves @ values
    at = int(np.argmax(np.abs(shift)))
    return _interval(float(abs(shift[at])), float(np.sqrt(moves[at] @ covariance @ moves[at])))


def _interval(size: float, deviation: float) -> Interval:
    half = TWO_SIDED * deviation
    return Interval(size, max(size - half, 0.0), size + half, "rad")
