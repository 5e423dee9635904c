"""From the residual of the straight line to the effects that the sensor has beside it.

The candidate that predicts the fitting part best is added as long as the gain of likelihood outweighs its coefficients
and the number of candidates.  From the first on that fits the fitting part better and the held-out part worse, all are
taken back.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.diagnosis import Classes, Fit, Found, Interval, Rejected, Separation, Verdict
from estimator.errors import ModelError
from estimator.rate_sensor.agreement import Line, against
from estimator.rate_sensor.catalogue import EFFECTS
from estimator.rate_sensor.chain_model import ChainModel, with_effect
from estimator.rate_sensor.declaration import Effect, Range, Stage
from estimator.rate_sensor.model import Chain, Rows, SensorFit, fit, straight_line
from estimator.rate_sensor.record import SensorRecord
from estimator.residual.effective import effective_samples
from estimator.residual.whiteness import portmanteau
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.engine import (
    Chosen,
    Dissent,
    Estimate,
    Round,
    Rules,
    as_near,
    choose,
    gained,
    leaves_the_rest,
    why_not,
)
from estimator.trace.probability import of_rounds, stated
from estimator.trace.promises import Claim, Errors, Level

_SET = THRESHOLDS.rate_sensor

RULES = Rules(most=_SET.most, dissent=Dissent.CUTS)


@dataclass(frozen=True)
class SensorDiagnosis:
    """The answer for one sensor.

    base: V0 and S with intervals, beside the effects; before: the straight line, after: with the effects; fits over the
    fitting rows and over the held-out ones; residuals (n,) V of the whole record; share, probabilities: as of
    `estimator.diagnosis.Diagnosis`.
    """

    verdict: Verdict
    base: dict[str, Interval]
    effects: tuple[Found, ...]
    separations: tuple[Separation, ...]
    rejected: tuple[Rejected, ...]
    before: Fit
    after: Fit
    held_out_before: Fit
    held_out_after: Fit
    residual_before: Array
    residual_after: Array
    reasons: tuple[str, ...]
    share: float | None = None
    probabilities: tuple[Classes, ...] = ()


def alternate_blocks(count: int, length: int) -> Rows:
    """True for every other block of `length` rows: what is fitted, where a record has no split of its own."""
    return np.asarray(np.arange(count) // length % 2 == 0)


def trace_sensor(
    record: SensorRecord, declared: Range, noise: float, fitting: Rows, line: Line | None = None
) -> SensorDiagnosis:
    """Find what the straight line lacks on the rows `fitting` and score it on the others.

    noise: rms of one sample as declared, V; repeated rates of a table of steady states give it instead; line: what the
    data sheet declares, which what is fitted must agree with.  Raises ModelError when one of the two parts is empty or
    the rate never changes.
    """
    if not fitting.any() or fitting.all():
        raise ModelError("every row is in one part; keep some rows to fit and some to score")
    if float(np.ptp(record.rate[fitting])) < _SET.range_share * declared.rate:
        raise ModelError("the rate never changes in the fitting part; turn the sensor, at several rates")
    floor, freedom = noise_floor(record, fitting, noise)
    before = straight_line(record, declared, fitting)
    linear = fit(before.chain, fitting, [before.parameters])
    candidates = tuple(e for e in EFFECTS if e.applies_to(record) and excited(linear, e, fitting))
    chosen = choose(ChainModel(candidates, fitting, floor, before), linear, RULES)
    found = _promised(chosen, before, fitting, floor, freedom)
    after, gains = found.fit, found.gains
    rejected = _rejected(candidates, chosen, found.why)
    intervals = _intervals(after, fitting)
    base = {name: intervals[name] for name in ("V0", "S")}
    limits = () if line is None else against(base, line)
    verdict, reasons = _verdict(found.claim, after, fitting, (*limits, *beyond_the_model(after, floor)))
    if verdict not in (Verdict.EXPLAINED, Verdict.PARTLY):
        line_alone = _intervals(before, fitting)
        base = {name: line_alone[name] for name in base}
    effects = tuple(
        Found(
            effect.name,
            effect.title,
            (effect.equation,),
            {c.name: intervals[c.name] for c in effect.coefficients},
            evidence,
            effect.undone,
        )
        for effect, evidence in zip(after.chain.effects, gains.values(), strict=True)
    )
    named = verdict in (Verdict.EXPLAINED, Verdict.PARTLY)
    if not named:
        rejected += tuple(Rejected(name, leaves_the_rest(gain)) for name, gain in gains.items())
    source = "the declared noise" if math.isinf(freedom) else "the scatter of repeated rates"
    held_out, shown = ~fitting, after if named else before  # what is not named stands beside no figure
    return SensorDiagnosis(
        verdict,
        base,
        effects if named else (),
        _separations(after, candidates, fitting, as_near(chosen.rounds)) if named else (),
        rejected,
        _score(before, fitting, floor, source),
        _score(shown, fitting, floor, source),
        _score(before, held_out, floor, source),
        _score(shown, held_out, floor, source),
        before.residual,
        shown.residual,
        reasons,
        found.claim.residual.share if named else None,
        stated(
            of_rounds(chosen.rounds, lambda look: {}),
            {effect.name: effect.name for effect in effects} if named else {},
            set(found.why) - set(gains),
            None,
            is_open=verdict.is_open,
        ),
    )


def _intervals(fitted: SensorFit, rows: Rows) -> dict[str, Interval]:
    """Every parameter of a chain, by name."""
    half = fitted.half_widths(rows, effective_samples(fitted.residual[rows]))
    chain = fitted.chain
    return {
        name: Interval(float(value), float(value - width), float(value + width), unit)
        for name, unit, value, width in zip(chain.names, chain.units, fitted.parameters, half, strict=True)
    }


def noise_floor(record: SensorRecord, rows: Rows, noise: float) -> tuple[float, float]:
    """Rms scatter of repeated rates where steady states repeat any, else the declared noise, V; and of how many
    independent differences it is.
    """
    if record.step is None:
        rates, group = np.unique(np.round(record.rate[rows], 9), return_inverse=True)
        scatter, freedom = 0.0, 0
        for number in range(len(rates)):
            volts = record.voltage[rows][group == number]
            scatter += float(np.sum((volts - np.mean(volts)) ** 2))
            freedom += len(volts) - 1
        if freedom > 0 and scatter > 0.0:
            return math.sqrt(scatter / freedom), float(freedom)
    return noise, math.inf


def steady_rates(record: SensorRecord, declared: Range, rows: Rows) -> int:
    """How many different rates the record rests at: narrow classes of the range that hold enough of the samples."""
    classes = np.round(record.rate[rows] / (_SET.rest_width * declared.rate))
    _, counts = np.unique(classes, return_counts=True)
    return int(np.sum(counts >= _SET.rest_share * np.sum(rows)))


def excited(current: SensorFit, effect: Effect, rows: Rows) -> bool:
    """Whether the record shows the effect.

    A static curve needs more than three steady rates; any effect must change more than a shift and a stretch of what
    is there.
    """
    curve = effect.stage in (Stage.CHARACTERISTIC, Stage.LIMIT) or effect.name == "hysteresis"
    if curve and steady_rates(current.chain.record, current.chain.declared, rows) < _SET.curve:
        return False
    chain = Chain((*current.chain.effects, effect), current.chain.record, current.chain.declared)
    start = effect.starts(chain.record, chain.declared)[-1]
    size = np.where(np.array(start) == 0.0, _SET.first_size * chain.scales[-len(start) :], start)
    change = (chain.volts(np.concatenate([current.parameters, size])) + current.residual - chain.record.voltage)[rows]
    basis = np.linalg.qr(current.chain.jacobian(current.parameters)[rows] * current.chain.scales)[0]
    left = change - basis @ (basis.T @ change)
    return float(np.linalg.norm(left)) > _SET.excited * float(np.linalg.norm(change))


@dataclass(frozen=True)
class _Promised:
    """The fit less what no promise can be made of, what each effect left gains, the claim, and why the others went."""

    fit: SensorFit
    gains: Mapping[str, float]
    claim: Claim
    why: Mapping[str, str]


def _promised(
    chosen: Chosen[SensorFit, tuple[str, ...]], before: SensorFit, fitting: Rows, floor: float, freedom: float
) -> _Promised:
    """Less effects that may as well be nothing, or that a sample held out contradicts.  Where something is left, less
    those that explain little beside the largest; where the straight line is adequate, one effect after another, the
    least first, as long as the part held out is not predicted better.
    """
    current, gains = (chosen.fit, dict(chosen.gains)) if chosen.steps else (before, {})
    why: dict[str, str] = {}
    while True:
        claim = _claim(before, current, fitting, floor, freedom)
        gone = {
            name: reason for name, given in claim.effects.items() if (reason := promises.may_be_nothing(name, given))
        }
        gone |= {one.effect: said for one in claim.levels if (said := promises.contradicted(one))}
        if not gone and promises.broken(claim):
            gone = {name: leaves_the_rest(gains[name]) for name in promises.minor(gains)}
            if not gone and gains and not claim.residual.fell and _is_adequate(claim.residual.before, floor):
                least = min(gains, key=lambda name: gains[name])
                gone = {least: f"{gained(gains[least])}; {promises.fell(claim)[0]}"}
        if not gone:
            return _Promised(current, gains, claim, why)
        why |= gone
        gains = {name: gain for name, gain in gains.items() if name not in gone}
        current = _less(current, before, gone, fitting)


def _less(current: SensorFit, before: SensorFit, names: Collection[str], fitting: Rows) -> SensorFit:
    """The fit without these effects, from where it was."""
    chain = current.chain
    kept = tuple(effect for effect in chain.effects if effect.name not in names)
    if not kept:
        return before
    of = ["", "", *(effect.name for effect in chain.effects for _ in effect.coefficients)]
    start = np.array([value for value, name in zip(current.parameters, of, strict=True) if name not in names])
    return fit(replace(chain, effects=kept), fitting, [start])


def _claim(before: SensorFit, after: SensorFit, fitting: Rows, floor: float, freedom: float) -> Claim:
    held_out = ~fitting
    half = after.half_widths(fitting, effective_samples(after.residual[fitting]))
    values = dict(zip(after.chain.names, zip(after.parameters, half, strict=True), strict=True))
    volts = after.chain.record.voltage[held_out]
    effects, levels = {}, []
    for effect in after.chain.effects:
        effects[effect.name] = {
            c.name: Estimate(float(value), float(value - width), float(value + width))
            for c in effect.coefficients
            for value, width in [values[c.name]]
        }
        if effect.stage is Stage.LIMIT:
            low, high = effects[effect.name]["lo"], effects[effect.name]["hi"]
            lowest, highest, unit = float(np.min(volts)), float(np.max(volts)), after.chain.declared.unit
            levels.append(Level(effect.name, low.low, high.high, lowest, highest, floor, unit))
    # The floor that a dynamic record declares is that of a sample, and so independent; what is left is not.
    samples = effective_samples(after.residual[held_out])
    residual = Errors(before.rms(held_out), after.rms(held_out), floor, samples, freedom)
    return Claim(residual, effects, levels=tuple(levels))


def _rejected(
    candidates: tuple[Effect, ...], chosen: Chosen[SensorFit, tuple[str, ...]], why: Mapping[str, str]
) -> tuple[Rejected, ...]:
    """Every candidate that was not taken or did not stay, with what it gained; why: of those that did not stay."""
    rejected = []
    for effect in candidates:
        if effect.name in why:
            rejected.append(Rejected(effect.name, why[effect.name]))
        elif effect.name not in chosen.gains:
            rejected.append(Rejected(effect.name, _why(effect.name, chosen.rounds)))
    return tuple(rejected)


def _why(name: str, rounds: Sequence[Round[tuple[str, ...]]]) -> str:
    return why_not(rounds, name.__eq__) or "not looked at: as many effects as may be were taken"


def beyond_the_model(after: SensorFit, floor: float) -> tuple[str, ...]:
    """What the model of a response that was found cannot do on this record, a sentence each.

    It takes the rate as straight between its samples, and a memory of limited length as filled at rest.
    """
    record, scale = after.chain.record, abs(float(after.parameters[1]))
    timed = [effect for effect in after.chain.effects if effect.needs == "time" and effect.stage <= Stage.RATE]
    if not timed or record.step is None:
        return ()
    said = []
    bends = [np.diff(record.rate[stretch], 2) for stretch in record.stretches]
    bent = scale * float(np.median(np.abs(np.concatenate(bends)))) / 8.0
    if bent > floor:
        said.append(
            f"the rate bends by {bent:.3g} between its samples, more than the noise of {floor:.3g}, and the model of a "
            "response takes it as straight: sample faster, or turn more slowly"
        )
    starts = [np.diff(record.rate[stretch][:2]) for stretch in record.stretches]
    begins = float(np.max(np.abs(np.concatenate(starts)), initial=0.0))
    for effect in timed:
        if effect.transient is None and effect.stage is Stage.RATE:
            place = after.chain.names.index(effect.coefficients[0].name)
            unknown = scale * begins / record.step * float(after.parameters[place])
            if unknown > floor:
                said.append(
                    f"the record begins in motion, and {effect.name.replace('_', ' ')} needs the rate before: begin "
                    "the record at rest"
                )
    return tuple(said)


def _verdict(claim: Claim, after: SensorFit, fitting: Rows, limits: tuple[str, ...]) -> tuple[Verdict, tuple[str, ...]]:
    """limits: what speaks against the line that was fitted, and against the model of its response."""
    held_out = ~fitting
    record, errors = after.chain.record, claim.residual
    beyond = float(np.max(np.abs(record.rate[held_out]))) > _SET.beyond * float(np.max(np.abs(record.rate[fitting])))
    outside = "the rates held out lie beyond those of the fitting part, which cannot tell what happens there"
    if not claim.effects:
        if _is_adequate(errors.after, errors.floor):
            return (Verdict.UNEXPLAINED if limits else Verdict.ADEQUATE), limits
        left = "; ".join((*promises.at_floor(claim), *((outside,) if beyond else ())))
        return Verdict.UNEXPLAINED, (left, *limits)
    broken = (*promises.broken(claim), *limits)
    if not broken:
        return Verdict.EXPLAINED, ()
    broken = (*broken, *((outside,) if beyond else ()))
    if not promises.holds_in_part(claim):
        return Verdict.UNEXPLAINED, promises.not_named(claim.effects, broken)
    said = f"{promises.acts_like(claim.effects)}: {errors.share:.1%} of the power above the noise floor goes"
    return Verdict.PARTLY, (said, *broken)


def _is_adequate(error: float, floor: float) -> bool:
    return error <= _SET.adequate * floor


def _score(fitted: SensorFit, rows: Rows, floor: float, source: str) -> Fit:
    rms = fitted.rms(rows)
    lags = min(_SET.lags, int(np.sum(rows)) // 4)
    whiteness = portmanteau(fitted.residual[rows], lags).p if lags > 0 and rms > 0.0 else 1.0
    return Fit((rms,), (floor,), rms / floor, whiteness, simulation_rmse=rms, floor_from=source)


def _separations(
    after: SensorFit, candidates: tuple[Effect, ...], rows: Rows, near: Mapping[str, Collection[str]]
) -> tuple[Separation, ...]:
    """Pairs of an effect that was named and one that was not which this record does not tell apart, by their signatures
    or, of those that came as near, by their likelihoods.

    A signature is what the best fit of a candidate changes in the prediction, with the parameters of the base and of
    the other effects projected out.
    """
    pairs = []
    for index, effect in enumerate(after.chain.effects):
        others = tuple(e for e in after.chain.effects if e is not effect)
        count = len(effect.coefficients)
        first = 2 + sum(len(e.coefficients) for e in after.chain.effects[:index])
        start = np.delete(after.parameters, slice(first, first + count))
        without = fit(Chain(others, after.chain.record, after.chain.declared), rows, [start])
        own = _signature(without, effect, rows)
        for candidate in candidates:
            if candidate in after.chain.effects:
                continue
            other = _signature(without, candidate, rows)
            size = float(np.linalg.norm(own) * np.linalg.norm(other))
            alike = abs(float(own @ other)) / size if size > 0.0 else 0.0
            if alike > _SET.alike or candidate.name in near.get(effect.name, ()):
                advice = effect.look_alikes.get(candidate.name)
                pairs.append(Separation(effect.name, candidate.name, alike, advice, None))
    return tuple(pairs)


def _signature(without: SensorFit, effect: Effect, rows: Rows) -> Array:
    trial = with_effect(without, effect, rows)
    change = (without.residual - trial.residual)[rows]
    basis = np.linalg.qr(without.chain.jacobian(without.parameters)[rows] * without.chain.scales)[0]
    return np.asarray(change - basis @ (basis.T @ change))
