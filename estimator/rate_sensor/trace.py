"""From the residual of the straight line to the effects that the sensor has beside it.

The candidate that predicts the fitting part best is added as long as the gain of likelihood outweighs its coefficients
and the number of candidates.  From the first on that fits the fitting part better and the held-out part worse, all are
taken back.
"""

import math
from dataclasses import dataclass

import numpy as np

from estimator.errors import ModelError
from estimator.rate_sensor.catalogue import EFFECTS
from estimator.rate_sensor.chain_model import ChainModel, with_effect
from estimator.rate_sensor.declaration import Effect, Range, Stage
from estimator.rate_sensor.model import Chain, Rows, SensorFit, fit, straight_line
from estimator.rate_sensor.record import SensorRecord
from estimator.residual.effective import effective_samples
from estimator.residual.whiteness import portmanteau
from estimator.scaling import Array
from estimator.trace.diagnosis import Confusable, Fit, Found, Interval, Rejected, Verdict
from estimator.trace.engine import Chosen, Dissent, Outcome, Rules, choose

_ALIKE = 0.98  # correlation of signatures above which a record does not tell two effects apart
_EXPLAINED = 0.1  # of the power above the noise floor, what may be left where it counts as explained
_NEAR = 3.0  # ratio to the noise floor up to which a model counts as adequate
_EXCITED = 0.05  # of an effect's signature, what must be left when the line is taken out
_LAGS = 20
_CURVE = 4  # steady rates that a curve needs


RULES = Rules(most=6, dissent=Dissent.CUTS)


@dataclass(frozen=True)
class SensorDiagnosis:
    """The answer for one sensor.

    base: V0 and S with intervals; before: the straight line, after: with the effects; fits over the fitting rows and
    over the held-out ones; residuals (n,) V of the whole record.
    """

    verdict: Verdict
    base: dict[str, Interval]
    effects: tuple[Found, ...]
    confusable: tuple[Confusable, ...]
    rejected: tuple[Rejected, ...]
    before: Fit
    after: Fit
    held_out_before: Fit
    held_out_after: Fit
    residual_before: Array
    residual_after: Array
    reasons: tuple[str, ...]


def alternate_blocks(count: int, length: int) -> Rows:
    """True for every other block of `length` rows: what is fitted, where a record has no split of its own."""
    return np.asarray(np.arange(count) // length % 2 == 0)


def trace_sensor(record: SensorRecord, declared: Range, noise: float, fitting: Rows) -> SensorDiagnosis:
    """Find what the straight line lacks on the rows `fitting` and score it on the others.

    noise: rms of one sample as declared, V; repeated rates of a table of steady states give it instead.  Raises
    ModelError when one of the two parts is empty or the rate never changes.
    """
    if not fitting.any() or fitting.all():
        raise ModelError("every row is in one part; keep some rows to fit and some to score")
    if float(np.ptp(record.rate[fitting])) < 1e-3 * declared.rate:
        raise ModelError("the rate never changes in the fitting part; turn the sensor, at several rates")
    floor = noise_floor(record, fitting, noise)
    before = straight_line(record, declared, fitting)
    linear = fit(before.chain, fitting, [before.parameters])
    candidates = tuple(e for e in EFFECTS if e.applies_to(record) and excited(linear, e, fitting))
    chosen = choose(ChainModel(candidates, fitting, floor, before), linear, RULES)
    after = chosen.fit if chosen.steps else before
    rejected = _rejected(candidates, chosen)
    reasons: list[str] = []
    verdict = _verdict(before, after, fitting, floor, reasons)
    effective = effective_samples(after.residual[fitting])
    half = after.half_widths(fitting, effective)
    intervals = {
        name: Interval(float(value), float(value - width), float(value + width), unit)
        for name, unit, value, width in zip(after.chain.names, after.chain.units, after.parameters, half, strict=True)
    }
    found = tuple(
        Found(
            effect.name,
            effect.title,
            (effect.equation,),
            {c.name: intervals[c.name] for c in effect.coefficients},
            evidence,
            effect.undone,
        )
        for effect, evidence in zip(after.chain.effects, chosen.gains.values(), strict=True)
    )
    held_out = ~fitting
    return SensorDiagnosis(
        verdict,
        {name: intervals[name] for name in ("V0", "S")},
        found,
        _confusable(after, candidates, fitting),
        rejected,
        _score(before, fitting, floor),
        _score(after, fitting, floor),
        _score(before, held_out, floor),
        _score(after, held_out, floor),
        before.residual,
        after.residual,
        tuple(reasons),
    )


def noise_floor(record: SensorRecord, rows: Rows, noise: float) -> float:
    """Rms scatter of repeated rates where steady states repeat any, else the declared noise; V."""
    if record.step is None:
        rates, group = np.unique(np.round(record.rate[rows], 9), return_inverse=True)
        scatter, freedom = 0.0, 0
        for number in range(len(rates)):
            volts = record.voltage[rows][group == number]
            scatter += float(np.sum((volts - np.mean(volts)) ** 2))
            freedom += len(volts) - 1
        if freedom > 0 and scatter > 0.0:
            return math.sqrt(scatter / freedom)
    return noise


def steady_rates(record: SensorRecord, declared: Range, rows: Rows) -> int:
    """How many different rates the record rests at: classes of 2 % of the range that hold 1 % of the samples."""
    classes = np.round(record.rate[rows] / (0.02 * declared.rate))
    _, counts = np.unique(classes, return_counts=True)
    return int(np.sum(counts >= 0.01 * np.sum(rows)))


def excited(current: SensorFit, effect: Effect, rows: Rows) -> bool:
    """Whether the record shows the effect.

    A static curve needs more than three steady rates; any effect must change more than a shift and a stretch of what
    is there.
    """
    curve = effect.stage in (Stage.CHARACTERISTIC, Stage.LIMIT) or effect.name == "hysteresis"
    if curve and steady_rates(current.chain.record, current.chain.declared, rows) < _CURVE:
        return False
    chain = Chain((*current.chain.effects, effect), current.chain.record, current.chain.declared)
    start = effect.starts(chain.record, chain.declared)[-1]
    size = np.where(np.array(start) == 0.0, 0.01 * chain.scales[-len(start) :], start)
    change = (chain.volts(np.concatenate([current.parameters, size])) + current.residual - chain.record.voltage)[rows]
    basis = np.linalg.qr(current.chain.jacobian(current.parameters)[rows] * current.chain.scales)[0]
    left = change - basis @ (basis.T @ change)
    return float(np.linalg.norm(left)) > _EXCITED * float(np.linalg.norm(change))


def _rejected(candidates: tuple[Effect, ...], chosen: Chosen[SensorFit, tuple[str, ...]]) -> tuple[Rejected, ...]:
    evidence: dict[str, float] = {}
    taken_back = set()
    for one in chosen.rounds:
        evidence |= one.gains
        taken_back |= {each.name for each in one.tried if each.outcome in (Outcome.OBJECTED, Outcome.AFTER)}
    rejected = []
    for effect in candidates:
        if effect.name in chosen.gains:
            continue
        if effect.name in taken_back:
            reason = "fits the fitting part better and the held-out part worse, or follows an effect that does"
        else:
            reason = f"evidence {evidence.get(effect.name, 0.0):.1f} does not outweigh its coefficients"
        rejected.append(Rejected(effect.name, reason))
    return tuple(rejected)


def _verdict(before: SensorFit, after: SensorFit, fitting: Rows, floor: float, reasons: list[str]) -> Verdict:
    held_out = ~fitting
    record = before.chain.record
    beyond = float(np.max(np.abs(record.rate[held_out]))) > 1.05 * float(np.max(np.abs(record.rate[fitting])))
    was = max(before.rms(held_out) ** 2 - floor**2, 0.0)
    left = max(after.rms(held_out) ** 2 - floor**2, 0.0)
    near = after.rms(held_out) <= _NEAR * floor
    if not near:
        text = f"what is left on the held-out part is {after.rms(held_out) / floor:.3g} × the noise floor"
        if beyond:
            text += "; its rates lie beyond those of the fitting part, which cannot tell what happens there"
        reasons.append(text)
    if not after.chain.effects:
        return Verdict.ADEQUATE if near else Verdict.UNEXPLAINED
    return Verdict.EXPLAINED if near or left <= _EXPLAINED * was else Verdict.UNEXPLAINED


def _score(fitted: SensorFit, rows: Rows, floor: float) -> Fit:
    rms = fitted.rms(rows)
    lags = min(_LAGS, int(np.sum(rows)) // 4)
    whiteness = portmanteau(fitted.residual[rows], lags).p if lags > 0 and rms > 0.0 else 1.0
    return Fit((rms,), (floor,), rms / floor, whiteness, simulation_rmse=rms)


def _confusable(after: SensorFit, candidates: tuple[Effect, ...], rows: Rows) -> tuple[Confusable, ...]:
    """Pairs of an effect that was named and one that was not whose signatures this record does not tell apart.

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
            if alike > _ALIKE:
                advice = effect.look_alikes.get(candidate.name)
                pairs.append(Confusable(effect.name, candidate.name, alike, advice, None))
    return tuple(pairs)


def _signature(without: SensorFit, effect: Effect, rows: Rows) -> Array:
    trial = with_effect(without, effect, rows)
    change = (without.residual - trial.residual)[rows]
    basis = np.linalg.qr(without.chain.jacobian(without.parameters)[rows] * without.chain.scales)[0]
    return np.asarray(change - basis @ (basis.T @ change))
