"""From the amplitude of a ring-down to the law of its damping: chosen on one part, judged on another.

Both parts are blocks taken by turns, since what is large at the beginning of a ring-down has died away at its end.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from estimator.diagnosis import Diagnosis, Fit, Found, Interval, Rejected, Residual, Separation, Verdict
from estimator.envelope.laws import laws
from estimator.envelope.model import EnvelopeFit, EnvelopeModel, Rows, Term, fitted, shown, terms
from estimator.envelope.record import Envelope, Resonator
from estimator.errors import ModelError
from estimator.residual.effective import effective_samples
from estimator.residual.whiteness import portmanteau
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.engine import Chosen, Dissent, Estimate, Rules, as_near, choose, leaves_the_rest, why_not
from estimator.trace.probability import of_rounds, stated
from estimator.trace.promises import Claim, Constant, Errors

_SET = THRESHOLDS.envelope

RULES = Rules(most=_SET.most, dissent=Dissent.NEXT, anew=True)
"""Anew: beside friction, which bends a ring-down the other way, drag alone has the wrong sign."""


def by_turns(samples: int) -> Rows:
    """True for what is fitted, where a record has no split of its own: three blocks of every five."""
    return np.asarray(np.arange(samples) // _SET.block % 5 < 3)


def trace_envelope(envelope: Envelope, resonator: Resonator, fitting: Rows) -> Diagnosis:
    """Find what linear damping lacks on the rows `fitting` and score it on the others.

    Raises ModelError where one of the two parts is too small, or the amplitude does not fall.
    """
    held_out = ~fitting
    for rows, part in ((fitting, "fitted"), (held_out, "held out")):
        if int(np.sum(rows)) < _SET.fewest // 2:
            raise ModelError(f"the part to be {part} has {int(np.sum(rows))} samples; at least {_SET.fewest // 2}")
    choice, later = _divided(fitting)
    every = terms(laws(resonator.device.own), resonator)
    start = fitted(envelope, resonator, (), choice)
    chosen = choose(EnvelopeModel(envelope, resonator, choice, later, every), start, RULES)
    before = fitted(envelope, resonator, (), fitting)
    after = before
    if chosen.steps:
        after = fitted(envelope, resonator, chosen.fit.terms, fitting, chosen.fit)
    gains = dict(chosen.gains)
    after, why = _promised(envelope, resonator, fitting, before, after, gains)
    claim = _claim(resonator, before, after, held_out)
    verdict, against = _judged(claim)
    named = tuple(term for term in after.terms) if verdict in (Verdict.EXPLAINED, Verdict.PARTLY) else ()
    told = against if named else promises.not_named([term.name for term in after.terms], against)
    if not named:
        why |= {term.name: leaves_the_rest(gains[term.name]) for term in after.terms}
    estimates = after.estimates(resonator)
    return Diagnosis(
        verdict=verdict,
        effects=tuple(_found(term, estimates[term.name], gains[term.name]) for term in named),
        separations=_alike(envelope, resonator, after, named, every, fitting, as_near(chosen.rounds)),
        rejected=_rejected(every, chosen, why, {term.name for term in named}),
        findings=(),
        before=_score(before, fitting, resonator),
        after=_score(after, fitting, resonator),
        held_out_before=_score(before, held_out, resonator),
        held_out_after=_score(after, held_out, resonator),
        residual_before=_residual(before),
        residual_after=_residual(after),
        split=int(np.sum(fitting)),
        reasons=(_summary(verdict, named, after if named else before, claim, resonator), *told),
        share=claim.residual.share if named else None,
        probabilities=stated(
            of_rounds(chosen.rounds, lambda look: {}),
            {term.name: term.name for term in named},
            set(why) - {term.name for term in named},
            None,
            is_open=verdict.is_open,
        ),
        undetermined=tuple(_as_another(term, estimates[term.name], every) for term in named if _same_laws(term, every)),
    ).of_what_is_named()


def _same_laws(term: Term, every: tuple[Term, ...]) -> tuple[Term, ...]:
    """The laws that do the same to an amplitude."""
    return tuple(
        other
        for other in every
        if other is not term and term.law is not None and other.law is not None and other.law.degree == term.law.degree
    )


def _as_another(term: Term, estimates: Mapping[str, Estimate], every: tuple[Term, ...]) -> str:
    """What else a law may be, with the coefficient that it then has."""
    said = []
    for other in _same_laws(term, every):
        assert term.law is not None  # look-alikes are laws
        assert other.law is not None
        factor = term.law.size * other.factor / (other.law.size * term.factor)
        one = estimates[term.symbol]
        said.append(
            f"{other.name} with {other.symbol} = {factor * one.value:.4g} [{factor * one.low:.4g}, "
            f"{factor * one.high:.4g}] {other.unit}"
        )
    return f"an amplitude does not tell {term.name} from {' or '.join(said)}"


def _divided(fitting: Rows) -> tuple[Rows, Rows]:
    """Of what is fitted, the rows on which candidates compete, and every third block, which must agree."""
    number = np.cumsum(fitting) - 1
    agreeing = number // _SET.block % 3 == 2
    return np.asarray(fitting & ~agreeing), np.asarray(fitting & agreeing)


def _promised(
    envelope: Envelope,
    resonator: Resonator,
    fitting: Rows,
    before: EnvelopeFit,
    after: EnvelopeFit,
    gains: Mapping[str, float],
) -> tuple[EnvelopeFit, dict[str, str]]:
    """The fit less what no promise can be made of and, where something is left, less what explains little beside the
    largest; and why those went.
    """
    why: dict[str, str] = {}
    while after.terms:
        claim = _claim(resonator, before, after, ~fitting)
        gone = promises.weak(claim.effects)
        if not gone and promises.broken(claim):
            kept = {term.name: gains[term.name] for term in after.terms}
            gone = {name: leaves_the_rest(gains[name]) for name in promises.minor(kept)}
        if not gone:
            break
        why |= gone
        keep = [place for place, term in enumerate(after.terms, start=2) if term.name not in gone]
        left = tuple(after.terms[place - 2] for place in keep)
        if not left:
            return before, why
        start = replace(after, terms=left, unknowns=after.unknowns[[0, 1, *keep]])
        after = fitted(envelope, resonator, left, fitting, start)
    return after, why


def _claim(resonator: Resonator, before: EnvelopeFit, after: EnvelopeFit, held_out: Rows) -> Claim:
    damping, (declared, deviation) = after.damping(resonator), resonator.damping
    return Claim(
        Errors(
            before.rms(held_out),
            after.rms(held_out),
            resonator.noise,
            effective_samples(after.residual[held_out]),
        ),
        after.estimates(resonator),
        constants=(Constant("dxx", damping.value, damping.low, damping.high, declared, deviation, positive=True),),
    )


def _judged(claim: Claim) -> tuple[Verdict, tuple[str, ...]]:
    against = promises.broken(claim)
    if not claim.effects:
        left = (*promises.at_floor(claim), *promises.constants(claim))
        return (Verdict.UNEXPLAINED if left else Verdict.ADEQUATE), left
    if not against:
        return Verdict.EXPLAINED, ()
    return Verdict.PARTLY if promises.holds_in_part(claim) else Verdict.UNEXPLAINED, against


def _found(term: Term, estimates: Mapping[str, Estimate], evidence: float) -> Found:
    coefficients = {symbol: Interval(one.value, one.low, one.high, term.unit) for symbol, one in estimates.items()}
    return Found(term.name, term.title, term.equation, coefficients, evidence, term.undone)


def _alike(
    envelope: Envelope,
    resonator: Resonator,
    after: EnvelopeFit,
    named: tuple[Term, ...],
    every: tuple[Term, ...],
    rows: Rows,
    near: Mapping[str, Collection[str]],
) -> tuple[Separation, ...]:
    """Pairs of a term that was named and one that was not which this record does not tell apart: their signatures,
    beside all that is fitted else, are the same, or their likelihoods came as near.
    """
    pairs = []
    for place, term in enumerate(named, start=2):
        others = np.delete(np.arange(len(after.unknowns)), place)
        own = _beside(after.derivative[rows][:, place], after.derivative[rows][:, others])
        for candidate in every:
            if candidate in named:
                continue
            _, derivative = shown(envelope, resonator, (*after.terms, candidate), np.append(after.unknowns, 0.0))
            rest = _beside(derivative[rows][:, -1], after.derivative[rows][:, others])
            size = float(np.linalg.norm(own) * np.linalg.norm(rest))
            alike = abs(float(own @ rest)) / size if size > 0.0 else 0.0
            if alike > THRESHOLDS.free_runs.alike or candidate.name in near.get(term.name, ()):
                pairs.append(Separation(term.name, candidate.name, min(alike, 1.0), _apart(term, candidate), None))
    return tuple(pairs)


def _apart(term: Term, candidate: Term) -> str | None:
    """What would tell two laws apart."""
    if term.law is not None and candidate.law is not None and term.law.degree == candidate.law.degree:
        return "the waveform: the two take the same energy from a cycle, at other places in it"
    return term.look_alikes.get(candidate.name) or candidate.look_alikes.get(term.name)


def _beside(column: Array, others: Array) -> Array:
    basis = np.linalg.qr(others / np.maximum(np.linalg.norm(others, axis=0), np.finfo(float).tiny))[0]
    return np.asarray(column - basis @ (basis.T @ column))


def _rejected(
    every: tuple[Term, ...], chosen: Chosen[EnvelopeFit, tuple[str, ...]], why: Mapping[str, str], named: set[str]
) -> tuple[Rejected, ...]:
    told = dict(chosen.barred) | dict(why)
    return tuple(
        Rejected(term.name, told.get(term.name) or why_not(chosen.rounds, term.name.__eq__) or "nothing is left for it")
        for term in every
        if term.name not in named
    )


def _score(fit: EnvelopeFit, rows: Rows, resonator: Resonator) -> Fit:
    rms = fit.rms(rows)
    lags = min(THRESHOLDS.rate_sensor.lags, int(np.sum(rows)) // 4)
    whiteness = portmanteau(fit.residual[rows], lags).p if rms > 0.0 else 1.0
    return Fit((rms,), (resonator.noise,), rms / resonator.noise, whiteness, simulation_rmse=rms)


def _residual(fit: EnvelopeFit) -> Residual:
    nothing: Array = np.zeros(0)
    return Residual(fit.residual[:, None], nothing, nothing[:, None])


def _summary(verdict: Verdict, named: tuple[Term, ...], after: EnvelopeFit, claim: Claim, resonator: Resonator) -> str:
    unit, errors, damping = resonator.device.sense_unit, claim.residual, after.damping(resonator)
    was = f", was {errors.before:.3g} {unit}" if named else ""
    left = errors.after if named else errors.before
    quality = resonator.scaling.omega0 / damping.value if damping.value > 0.0 else float("inf")
    said = (
        f"linear damping is {damping.value:.4g} 1/s [{damping.low:.4g}, {damping.high:.4g}], a quality factor of "
        f"{quality:.4g}; the part held out is {left:.3g} {unit} rms off{was}; the declared noise is {errors.floor:.3g} "
        f"{unit}"
    )
    if verdict is not Verdict.PARTLY:
        return said
    acts = promises.acts_like([term.name for term in named])
    return f"{acts}: {errors.share:.1%} of the power above the noise goes; {said}"
