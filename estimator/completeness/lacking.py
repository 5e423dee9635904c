"""From what a scan shows to what the model lacks: the leading candidates carried, their likelihoods compared.

Far from the truth a scan is a rough guide, so those that come into question are each carried by an observer once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.completeness.answer import Lacking
from estimator.completeness.turning import Turning
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
from estimator.written import plus_minus

_TRIED = 3
_BESIDE = 1  # tried beside them, of another kind
_COMPARED = 10_000  # samples on which candidates are compared, at least
_ENOUGH = 1000.0  # of twice the log-likelihood: so much tells candidates apart
HARMLESS = 1.0 / 3.0
"""Of the limit: what moves the angle by less is told, not held against the run."""


@dataclass(frozen=True)
class Taken:
    """An effect that a record shows: by its name in the scan, with its coefficients (k,), their covariance (k, k), and
    coefficients and parameters as an observer takes them, SI.
    """

    name: str
    lacking: Lacking
    values: Array
    covariance: Array
    given: dict[str, float]


@dataclass(frozen=True)
class Nearest:
    """The effect that explains most of a record, and not what is missing: with it the innovation is still `ratio` times
    what is predicted of it, rms, so that its coefficients are those of something else.
    """

    effect: str
    ratio: float


def in_words(
    lacks: Sequence[Lacking],
    harmless: Sequence[Lacking],
    left: Sequence[str],
    watched: int,
    nearest: Nearest | None = None,
) -> str:
    """Why the outcome is what it is, one line."""
    if nearest is not None:
        missing = (
            f"something is missing that no effect explains by itself: {nearest.effect} comes nearest and leaves "
            f"{nearest.ratio:.3g} × the noise; hil trace tells"
        )
        return "; ".join([missing, *map(told, harmless)])
    if lacks:
        return "; ".join([*map(told, lacks), *map(_small, harmless)])
    if left:
        beside = "beside what is harmless, the" if harmless else "the"
        return "; ".join(
            [f"{beside} residual is explained by no effect known: {', '.join(left)}", *map(_small, harmless)]
        )
    return (
        "; ".join(map(_small, harmless)) or f"none of the {watched} effects looked for explains more than chance would"
    )


def told(item: Lacking) -> str:
    """An effect that is lacking, in one line."""
    name, sizes = _name_and_sizes(item)
    return f"lacks {name}: {sizes}; the angle may be off by {item.angle.value:.3g} rad"


def _small(item: Lacking) -> str:
    """An effect that is there and harmless, in one line."""
    name, sizes = _name_and_sizes(item)
    return f"small effect found: {name}, negligible: {sizes}, {item.angle.value:.3g} rad of the angle"


def _name_and_sizes(item: Lacking) -> tuple[str, str]:
    sizes = ", ".join(
        f"{symbol} = {plus_minus(c.value, 0.5 * (c.high - c.low))}" + (f" {c.unit}" if c.unit != "1" else "")
        for symbol, c in item.coefficients.items()
    )
    like = f" (or {', '.join(item.alike)})" if item.alike else ""
    return f"{item.effect}{like}", sizes


def leading(
    problem: Problem,
    base: Fitted,
    watched: dict[str, Parameters],
    seen: Scan,
    serious: list[Evidence],
    turning: Turning,
    enough: float,
) -> Taken | Nearest | None:
    """The effect that explains most once it is included in the model, None where none explains more than chance would;
    the nearest where the innovation stays above `enough` times what is predicted of it, rms.

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
    return Taken(best, lacking, values, np.asarray(covariance), given)


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
    half = TWO_SIDED * float(np.sqrt(moves[at] @ covariance @ moves[at]))
    size = float(abs(shift[at]))
    return Interval(size, max(size - half, 0.0), size + half, "rad")
