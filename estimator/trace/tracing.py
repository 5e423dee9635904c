"""From a record to a diagnosis: which effect the model lacks, how large it is, and what the error is with it."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from estimator.diagnosis import Classes, Confusable, Diagnosis, Fit, Found, Interval, Rejected, Verdict
from estimator.effects.catalogue import effect_for
from estimator.errors import DivergedError
from estimator.settings import Device, ObserverSettings
from estimator.side_by_side import side_by_side, together
from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.angle import AngleReader
from estimator.trace.axes import equations_on
from estimator.trace.candidates import Parameters, kind
from estimator.trace.certainty import TWO_SIDED, all_of, covariance_of, interval_of
from estimator.trace.claims import claim_of, on_one_floor
from estimator.trace.conflict import reconciled, runs_backwards
from estimator.trace.criterion import TIE, threshold
from estimator.trace.engine import gained, last_carried, leaves_the_rest, why_not
from estimator.trace.evidence import Evidence
from estimator.trace.examination import Examination, examine
from estimator.trace.fitness import require_traceable
from estimator.trace.fitting import constants_of
from estimator.trace.free_response import loses_what_a_free_run_follows
from estimator.trace.free_run import trace_free_run
from estimator.trace.judgement import leftover
from estimator.trace.look import bounds
from estimator.trace.nameless import Contest
from estimator.trace.probability import NOTHING, stated
from estimator.trace.problem import Effects, Problem
from estimator.trace.selection import Selection, exactly, instead, select, without
from estimator.trace.separation import Advice, separations
from estimator.trace.symmetries import Constants, equivalents
from estimator.written import significant


def trace(
    problem: Problem,
    *,
    split: int,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> Diagnosis:
    """Choose effects on the samples before `split`, score them on the rest.

    The observer of `problem` is the bench's; effects that it carries already stay.  A single axis is traced by its
    free run, as is a free response that the observer loses.

    Raises ModelError for a record that cannot be traced, with what to record instead.
    """
    record, device, settings, known = problem.record, problem.device, problem.settings, problem.effects
    require_traceable(record, device, split)
    fitted_part = problem.part(slice(0, split))
    if device.axes == 1 or loses_what_a_free_run_follows(fitted_part):
        return trace_free_run(problem, split=split, progress=progress)
    selection, before = together(lambda: select(fitted_part, progress), lambda: examine(problem, split))
    progress("before and after", 1, 2)
    found = _judged(problem, selection, before, split, progress)
    progress("before and after", 2, 2)
    named, after = found.named, found.after
    was, fitted = on_one_floor(before.fitted, after.fitted)
    was_held_out, held_out = on_one_floor(before.held_out, after.held_out)
    watched = selection.rounds[-1].look.watched
    reader = AngleReader(problem.part(slice(0, min(split, THRESHOLDS.scoring.read))))
    largest, (alike, effects) = together(
        lambda: bounds(fitted_part.part(slice(0, THRESHOLDS.choice.confirmed)), found.selection.after, watched),
        lambda: (
            _confusable(named, found.selection, reader, progress),
            tuple(side_by_side([partial(_found, name, named, found.selection, reader) for name in named])),
        ),
    )
    return Diagnosis(
        verdict=found.verdict,
        effects=effects,
        confusable=_with_equivalents(alike, named, found.selection, device, settings),
        rejected=_rejected(named, selection, found.why, largest, device),
        findings=before.findings,
        before=was,
        after=fitted,
        held_out_before=was_held_out,
        held_out_after=held_out,
        residual_before=before.residual,
        residual_after=after.residual,
        split=split,
        reasons=found.reasons,
        angle_moved=reader.moved(known, found.selection.effects) if found.selection.gain else None,
        share=found.share,
        left=after.findings if found.verdict is Verdict.PARTLY else (),
        probabilities=_probabilities(found),
        undetermined=found.undetermined,
    ).of_what_is_named()


@dataclass(frozen=True)
class _Judged:
    """The verdict, and the models that it is about: what was selected less what no promise can be made of.

    why: of each effect that was selected and is not named, why not; share: of the residual's power above the floor on
    the part held out, what goes, None where nothing stood there; contest: with the nameless force; is_open: whether
    something is left, or a promise does not hold; undetermined: constants of which the record says less than is
    declared, a sentence.
    """

    verdict: Verdict
    named: Effects
    selection: Selection
    after: Examination
    why: Mapping[str, str]
    reasons: tuple[str, ...]
    share: float | None
    contest: Contest | None
    is_open: bool
    undetermined: tuple[str, ...] = ()


def _judged(
    problem: Problem,
    selection: Selection,
    before: Examination,
    split: int,
    progress: Callable[[str, int, int], None] = lambda stage, done, total: None,
) -> _Judged:
    """Hold what was selected to what the words promise.

    An effect that a guard of its own speaks against is taken out and the rest fitted anew; where that is its sign, what
    it explained is something else's, and the rest no more than a part.  Where something is left, so are those that
    explain little beside the largest.  Where a constant is not what the device may have, or the filter is surer than
    the record, constants and coefficients are first fitted by the likelihood itself.
    """
    part, known = problem.part(slice(0, split)), problem.effects
    why: dict[str, str] = {}
    elses: list[str] = []
    at_first: _Judged | None = None
    exact: list[set[str]] = []
    while True:
        selection, nothing, unlawful = _without_weak(part, selection, known)
        why |= nothing | unlawful
        elses += unlawful
        named = {name: given for name, given in selection.effects.items() if name not in known}
        try:
            after = examine(problem.carrying(selection.effects), split) if named else before
        except DivergedError:
            least = min(named, key=lambda name: selection.gain.get(name, 0.0))
            why[least] = "over the whole record the observer diverges with it"
            selection = without(part, selection, (least,))
            continue
        claim = claim_of(problem, selection, before, after, split)
        left = _left(part, selection)
        if not left and set(named) not in exact and ((conflict := promises.in_conflict(claim)) or named):
            exact.append(set(named))
            filtered, selection = selection, exactly(part, selection, progress, unless_right=not conflict)
            if selection is not filtered:
                continue
        against = promises.broken(claim) if named else ()
        share = claim.residual.share if named and not claim.residual.nothing_above else None
        if not against and not left and (doubtful := _rather_nothing(named, selection, why, claim.contest)):
            name, probability = doubtful
            why[name] = f"{gained(selection.gain[name])}; it is more probably nothing ({probability:.0%}) than there"
            selection = without(part, selection, (name,))
            continue
        if not against and not left:
            reasons = _reasons(named, selection, *on_one_floor(before.held_out, after.held_out), why)
            if words := promises.constants(claim):
                backwards = runs_backwards(claim.constants)
                words = (*words, backwards) if backwards else words
                return _in_conflict(problem, selection, after, split, why, (*words, *reasons), progress)
            doubts = (*_of_something_else(elses), *promises.one_curve(named))
            if named and doubts:
                told = (_in_part(named, claim), *doubts, *reasons)
                return _Judged(Verdict.PARTLY, named, selection, after, why, told, share, claim.contest, is_open=True)
            verdict = Verdict.EXPLAINED if named else Verdict.ADEQUATE
            unsure = promises.undetermined(claim) if set(named) in exact else ()
            return _Judged(
                verdict, named, selection, after, why, reasons, share, claim.contest, is_open=False, undetermined=unsure
            )
        refuted = bool(against) and not left and not promises.shows_at_first(claim)
        if refuted and (borne_out := _borne_out(problem, selection, before, named, split)) is not None:
            name, other, exchanged = borne_out
            why[name] = f"{gained(selection.gain[name])}, as {kind(other).replace('_', ' ')} does; {against[0]}"
            selection = exchanged
            continue
        gains = {name: selection.gain[name] for name in named}
        if small := promises.minor(gains):
            why |= {name: leaves_the_rest(gains[name]) for name in small}
        elif promises.holds_in_part(claim):
            reasons = (_in_part(named, claim), *left, *against)
            return _Judged(Verdict.PARTLY, named, selection, after, why, reasons, share, claim.contest, is_open=True)
        elif left and not named and at_first is not None:
            return at_first
        elif left:
            why |= {name: _no_explanation(gains[name], claim) for name in named}
            told = (*promises.not_named(named, left), *_turned_down(why))
            return _Judged(Verdict.UNEXPLAINED, {}, selection, before, why, told, None, claim.contest, is_open=True)
        else:  # what remains is at the floor anyhow: the least of them may go
            if at_first is None and promises.shows_at_first(claim):
                told = (_at_first(named), *_turned_down(why))
                at_first = _Judged(
                    Verdict.PARTLY, named, selection, after, dict(why), told, None, claim.contest, is_open=False
                )
            small = (min(gains, key=lambda name: gains[name]),)
            why |= {name: _no_explanation(gains[name], claim) for name in small}
        selection = without(part, selection, small)


def _left(part: Problem, selection: Selection) -> tuple[str, ...]:
    """What the model that was selected leaves of the part that it was fitted to, a sentence each."""
    resonance = float(np.sqrt(part.device.target)) / (2.0 * np.pi)
    return leftover(selection, part.record.part(slice(0, selection.samples)), resonance)


def _borne_out(
    problem: Problem, selection: Selection, before: Examination, named: Iterable[str], split: int
) -> tuple[str, str, Selection] | None:
    """An effect that the part held out speaks against, a rival of it that keeps every promise, and the selection with
    that in its place; None where there is none.

    The part that was fitted does not tell them apart, so the choice among them was none: the part held out refutes one
    and not the other.
    """
    part = problem.part(slice(0, split))
    for name in named:
        for other in selection.rivals.get(name, {}):
            found = instead(part, selection, name, other)
            try:
                after = examine(problem.carrying(found.effects), split)
            except DivergedError:
                continue
            claim = claim_of(problem, found, before, after, split)
            if not promises.broken(claim) and not promises.constants(claim) and not _left(part, found):
                return name, other, found
    return None


def _in_conflict(
    problem: Problem,
    selection: Selection,
    after: Examination,
    split: int,
    why: Mapping[str, str],
    reasons: tuple[str, ...],
    progress: Callable[[str, int, int], None],
) -> _Judged:
    """Nothing is left and nothing named, with a constant that the device cannot have: what would let it be."""
    found = reconciled(problem.part(slice(0, split)), selection, progress)
    if found is None:
        return _Judged(Verdict.UNEXPLAINED, {}, selection, after, why, reasons, None, None, is_open=True)
    name, selected = found
    said = f"{promises.acts_like((name,))}: with it every constant of the model is one that the bench file allows"
    after = examine(problem.carrying(selected.effects), split)
    named = {name: selected.effects[name]}
    return _Judged(Verdict.PARTLY, named, selected, after, why, (said, *reasons), None, None, is_open=False)


def _without_weak(
    part: Problem, selection: Selection, known: Effects
) -> tuple[Selection, dict[str, str], dict[str, str]]:
    """Less the effects that are of the wrong sign or may as well be nothing, one after another; and why, of those that
    may be nothing and of those that would be something else.
    """
    nothing: dict[str, str] = {}
    unlawful: dict[str, str] = {}
    while True:
        given = {name: given for name, given in selection.coefficients.items() if name not in known}
        weak = promises.weak(given)
        if not weak:
            return selection, nothing, unlawful
        least = min(weak, key=lambda name: selection.gain.get(name, 0.0))
        (unlawful if promises.wrong_sign(least, given[least]) else nothing)[least] = weak[least]
        selection = without(part, selection, (least,))


def _rather_nothing(
    named: Effects, selection: Selection, why: Mapping[str, str], contest: Contest | None
) -> tuple[str, float] | None:
    """The effect that is the most probably nothing, and how probably, where that is more than all that it may be."""
    if not named:
        return None
    told = _accounted({name: name for name in named}, selection, why, contest, is_open=False)
    nothing = {str(one.effect): one.probabilities.get(NOTHING, 0.0) for one in told}
    most = max(nothing, key=lambda name: nothing[name], default=None)
    return (most, nothing[most]) if most is not None and nothing[most] > 1.0 - nothing[most] else None


def _of_something_else(unlawful: Iterable[str]) -> tuple[str, ...]:
    """What is said of the effects that came out with the wrong sign, a sentence for all of them."""
    names = " and ".join(kind(name).replace("_", " ") for name in unlawful)
    return (f"what {names} of the other sign would explain is left: it is something else's",) if names else ()


def _probabilities(found: _Judged) -> tuple[Classes, ...]:
    called = {name: _short(name, found.named) for name in found.named}
    return _accounted(called, found.selection, found.why, found.contest, is_open=found.is_open)


def _accounted(
    called: Mapping[str, str], selection: Selection, why: Mapping[str, str], contest: Contest | None, *, is_open: bool
) -> tuple[Classes, ...]:
    """How probable each account is of what is named, by how it is called; why: of what is not, for what reason."""
    against = {kind(name) for name in why} - {kind(name) for name in called}
    return stated(selection.accounts, called, against, contest, is_open=is_open)


def _in_part(named: Effects, claim: promises.Claim) -> str:
    """What is said of a part: no more than that it acts so."""
    errors = claim.residual
    them = "it" if len(named) == 1 else "them"
    return (
        f"{promises.acts_like(named)}: with {them} {errors.share:.1%} of the residual's power above the noise floor "
        f"goes on the part held out, from {errors.before:.4g} to {errors.after:.4g} × the floor"
    )


def _at_first(named: Effects) -> str:
    """What is said of effects that the part held out says nothing of."""
    them = "it" if len(named) == 1 else "them"
    return (
        f"{promises.acts_like(named)}: with {them} nothing is left of what the beginning of the record shows; the part "
        "held out shows nothing of the kind, and tells neither for nor against it"
    )


def _no_explanation(gain: float, claim: promises.Claim) -> str:
    if against := promises.broken(claim, promises.PARTLY):
        return f"{gained(gain)}; {against[0]}"
    return leaves_the_rest(gain)


def _turned_down(why: Mapping[str, str]) -> tuple[str, ...]:
    """A sentence for each effect that was selected and is not named."""
    return tuple(f"{kind(name).replace('_', ' ')} is no explanation: {reason}" for name, reason in why.items())


def _reasons(named: Effects, selection: Selection, before: Fit, after: Fit, why: Mapping[str, str]) -> tuple[str, ...]:
    """Why the model is complete, with what is named, as sentences; why: of what was selected and is not."""
    was = f", and was {before.ratio:.4g} ×" if named else ""
    looked_for = {kind(name) for name in selection.rounds[-1].look.evidence} - {kind(name) for name in (*named, *why)}
    other = "other " if named or why else ""
    return (
        f"the innovation of the part held out is {after.ratio:.4g} × the noise floor{was}",
        f"none of the {len(looked_for)} {other}effects looked for explains more than chance would",
        *(said for name in named if (said := promises.turned(name, selection.coefficients[name]))),
        *_turned_down(why),
    )


def _short(name: str, named: Effects) -> str:
    """The name without its label, where that says which is meant."""
    return name if sum(kind(other) == kind(name) for other in named) > 1 else kind(name)


def _found(name: str, named: Effects, selection: Selection, reader: AngleReader) -> Found:
    _, effect = effect_for(name, reader.problem.device.axes, reader.problem.device.own)
    spread = covariance_of(name, selection.after, selection.searched[name])
    return Found(
        name=_short(name, named),
        title=effect.title,
        equation=equations_on(effect, 2),
        coefficients=_intervals(name, selection, reader.problem.device),
        evidence=selection.gain[name],
        undone=effect.undone.value,
        angle_bound=reader.bound(selection.effects, name, spread),
    )


def _intervals(name: str, selection: Selection, device: Device) -> dict[str, Interval]:
    """Coefficients and searched parameters with their 95 % intervals; a coefficient moves with the parameters."""
    model, searched = selection.after, selection.searched[name]
    _, effect = effect_for(name, device.axes, device.own)
    given, found = selection.effects[name], selection.coefficients[name]
    intervals = _coefficients(name, selection, device)
    for p in effect.parameters:
        if p.name in searched.names:
            low, high = interval_of(p.name, given[p.name], model, searched)
            intervals[p.name] = Interval(given[p.name], low, high, p.unit)
        elif p.found_as is not None and p.name in given:  # the same number as a coefficient
            own = next(symbol for c, symbol in zip(effect.coefficients, found, strict=True) if c.symbol == p.found_as)
            intervals[p.name] = replace(intervals[own], value=given[p.name], unit=p.unit)
    return intervals


def _coefficients(name: str, selection: Selection, device: Device) -> dict[str, Interval]:
    """Those of an effect that was selected, with their 95 % intervals."""
    _, effect = effect_for(name, device.axes, device.own)
    return {
        symbol: Interval(one.value, one.low, one.high, c.unit)
        for c, (symbol, one) in zip(effect.coefficients, selection.coefficients[name].items(), strict=True)
    }


def _or_nothing(found: Mapping[str, Interval]) -> dict[str, Interval]:
    """The same intervals, with zero in them."""
    return {symbol: replace(one, low=min(one.low, 0.0), high=max(one.high, 0.0)) for symbol, one in found.items()}


def _interval(value: float, deviation: float, unit: str) -> Interval:
    return Interval(value, value - TWO_SIDED * deviation, value + TWO_SIDED * deviation, unit)


def _confusable(
    named: Effects,
    selection: Selection,
    reader: AngleReader,
    progress: Callable[[str, int, int], None],
) -> tuple[Confusable, ...]:
    """Who looks like a named effect on this record or explains as much, what would tell them apart, and what hangs on
    it: of each kind the one that is most alike.
    """
    pairs: dict[tuple[str, str], tuple[str, str, float, Parameters]] = {}
    for step in selection.rounds:
        if step.taken is None or step.taken not in named:
            continue
        alike, near = selection.alike[step.taken], selection.rivals[step.taken]
        for other in (*near, *(other for other, likeness in alike.items() if likeness > THRESHOLDS.scan.same)):
            if kind(other) != kind(step.taken):
                given = near[other].parameters if other in near else step.look.watched[other]
                pairs.setdefault((step.taken, kind(other)), (step.taken, other, alike.get(other, float("nan")), given))
    behind = {which: _behind(*which, selection) for which in pairs}
    alike_still = [which for which in pairs if behind[which] is None]
    asked = [pairs[which][:2] for which in alike_still]
    advised = dict(zip(alike_still, separations(asked, selection, reader.problem, progress), strict=True))
    apart = side_by_side(
        [partial(reader.mistaken, selection.effects, name, other, given) for name, other, _, given in pairs.values()]
    )
    found = []
    for (which, (name, other, likeness, _)), moved in zip(pairs.items(), apart, strict=True):
        told = advised.get(which, Advice())
        experiment = None if told.experiment is None else told.experiment.name
        found.append(
            Confusable(
                _short(name, named), kind(other), likeness, told.words, told.expected, moved, experiment, told.takes,
                behind[which],
            )
        )  # fmt: skip
    return tuple(found)


def _behind(taken: str, other: str, selection: Selection) -> float | None:
    """By how much less likely the record is with a kind that was carried than with the effect taken, in twice the
    log-likelihood; None where it was not carried, or the record does not tell the two apart.
    """
    carried = {kind(name) for one in selection.rounds if one.taken == taken for name in one.gains}
    account = next((one for one in selection.accounts.get(taken, ()) if one.name == other), None)
    if other not in carried or account is None or account.deficit < TIE * max(account.dispersion, 1.0):
        return None
    return account.deficit


def _with_equivalents(
    alike: tuple[Confusable, ...], named: Effects, selection: Selection, device: Device, settings: ObserverSettings
) -> tuple[Confusable, ...]:
    """And what the named effects may be as well because the equations are the same: no experiment tells those apart."""
    intervals = {kind(name): _intervals(name, selection, device) for name in named}
    nonreciprocal = intervals.get("nonreciprocal_stiffness", {}).get("kn") or _of_nonreciprocal(selection)
    pairs = {(pair.effect, pair.other): pair for pair in alike}
    for same in equivalents(intervals, _constants(selection, device, settings), nonreciprocal):
        whose = next(_short(name, named) for name in named if kind(name) == same.effect)
        pairs[whose, same.other] = Confusable(whose, same.other, 1.0, same.told_by, None, same.angle)
    return tuple(pairs.values())


def _of_nonreciprocal(selection: Selection) -> Interval | None:
    item = selection.rounds[-1].look.evidence.get("nonreciprocal_stiffness")
    if item is None:
        return None
    (value,), (deviation,) = item.coefficients.tolist(), item.deviation.tolist()
    return _interval(value, deviation, "1/s²")


def _constants(selection: Selection, device: Device, settings: ObserverSettings) -> Constants:
    """As found; as declared where the observer does not estimate them."""
    found = constants_of(selection.after.observer)
    names = ("xx", "yy", "xy")
    kxx, kyy, kxy = (found.get(f"k{name}", k) for name, k in zip(names, device.stiffness, strict=True))
    dxx, dyy, dxy = (found.get(f"d{name}", d) for name, d in zip(names, device.damping, strict=True))
    spread = settings.spread.stiffness * device.target
    return Constants((kxx, kyy, kxy), (dxx, dyy, dxy), device.stiffness, spread)


def _rejected(
    named: Effects, selection: Selection, why: Mapping[str, str], largest: Mapping[str, Evidence], device: Device
) -> tuple[Rejected, ...]:
    """Every other candidate once, with what it would have explained at best and a bound on its coefficients.

    why: of those that were selected and are not named, which may be nothing or as large as they were carried; largest:
    what bounds the coefficients of the others.
    """
    last = selection.rounds[-1]
    kinds = {kind(name) for name in named}
    dismissed = {kind(name): reason for name, reason in why.items() if kind(name) not in kinds}
    rejected: dict[str, Rejected] = {}
    enough = threshold(len(last.look.evidence))
    alone: dict[str, float] = {}
    for name, item in selection.rounds[0].look.evidence.items():  # best first
        alone.setdefault(kind(name), item.gain)
    sizes = {kind(name): _or_nothing(_coefficients(name, selection, device)) for name in why if name in selection.gain}
    carried = {kind(name): selection.gain[name] for name in why if name in selection.gain}
    for name, reason in dismissed.items():
        rejected[name] = Rejected(name, reason, sizes.get(name, {}), alone.get(name), carried.get(name))
    for name, item in last.look.evidence.items():
        if kind(name) in kinds or kind(name) in rejected:
            continue
        _, effect = effect_for(name, device.axes, device.own)
        bound = {}
        if (most := largest.get(name)) is not None:
            wider = all_of(len(effect.coefficients)) / TWO_SIDED
            bound = {
                c.name.partition(":")[0]: _interval(float(value), wider * float(sd), c.unit)
                for c, value, sd in zip(effect.coefficients, most.coefficients, most.deviation, strict=True)
                if sd > 0.0
            }
        reason = _why(name, item, enough, selection)
        rejected[kind(name)] = Rejected(kind(name), reason, bound, alone.get(kind(name)), _last_gain(name, selection))
    return tuple(rejected.values())


def _last_gain(name: str, selection: Selection) -> float | None:
    """What its kind gained in the last round that carried it, of which `_why` tells."""
    last = last_carried(selection.rounds, lambda other: kind(other) == kind(name))
    return None if last is None or last[0].score is None else last[0].score.gain


def _why(name: str, item: Evidence, enough: float, selection: Selection) -> str:
    """Why it was not taken; enough: significance that chance reaches for none of the candidates."""
    if reason := why_not(selection.rounds, lambda other: kind(other) == kind(name)):
        return reason
    alike = max((others.get(name, 0.0) for others in selection.alike.values()), default=0.0)
    if alike > THRESHOLDS.scan.same:
        return f"looks like what was taken (likeness {alike:.5f}) and explains less"
    if item.significance > enough:
        return "what it would explain is not the same from part to part of the record"
    if alike > THRESHOLDS.choice.shadowed:
        return f"nothing is left for it (likeness {alike:.3f} to what was taken)"
    if replace(item, scatter=1.0).significance > enough:
        return (
            f"would gain {significant(item.gain)} in twice the log-likelihood, but what it would explain differs from "
            f"part to part of the record by {significant(item.scatter)} times the power of noise"
        )
    return "explains no more than chance would"
