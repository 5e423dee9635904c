"""How many candidates are carried, and which: the one place that says so for two axes."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping

from estimator.thresholds import THRESHOLDS
from estimator.trace.candidates import Parameters, is_line, kind
from estimator.trace.criterion import TIE, chance_gain
from estimator.trace.evidence import Evidence, likeness
from estimator.trace.fitting import Fitted
from estimator.trace.kin import are_kin, kin_of
from estimator.trace.look import Look
from estimator.trace.nested import with_simpler
from estimator.trace.scan import Scan

_SET = THRESHOLDS.width


def hopeful(
    look: Look,
    gains: Mapping[str, float],
    refused: Collection[str],
    behind: Callable[[], Look],
    screened: Callable[[list[str], Collection[str]], list[str]],
    *,
    calm: bool,
) -> list[str]:
    """Whom to carry beside those that were tried in the round; nobody when that is enough.

    First the leaders of the scan, steady or not where it stands before much; then whoever is behind the best of them by
    no more than the scan may be wrong by; then those that look like the best that was carried, which need not be the
    scan's; then those akin to it.  Where the best leaves something, or the scan stood before much, or the best is a
    line, with which anything may be drawn, or the motion is one steady line, on which many act alike, a short part of
    the record is asked about every kind; where it leaves something, those of which the scan promises most may do less
    well there.
    gains: of those that were tried; refused: those of which there is no model; behind: what is seen behind the best of
    the tried; screened: those that a short part of the record speaks for, less for those that are spared; calm: whether
    the drive is of the resonance alone.
    """
    first = with_simpler(leaders(look), look.evidence)
    if not gains:
        return first
    asked = {*gains, *refused}
    best_leader = max(gains[name] for name in gains if name in first)
    near = with_simpler(within_reach(look.serious, first, best_leader), look.evidence)
    if names := [name for name in near if name not in asked]:
        return names
    near += with_simpler(looking_like(look, [*first, *near], gains), look.evidence)
    if names := [name for name in near if name not in asked]:
        return names
    best = max(gains, key=lambda name: gains[name])
    if names := kin_of(best, look.evidence, asked):
        return names
    if any(name not in (*first, *near) and not are_kin(best, name) for name in asked):
        return []
    # Would another have explained that, too?  Far from the truth, the scan is a rough guide.
    others = second_thoughts(look.evidence, asked)
    if not is_small(behind(), max(gains.values())):
        return screened(others, others[: _SET.batch])
    return screened(others, ()) if _stands_far(look) or calm or is_line(best) else []


def _stands_far(look: Look) -> bool:
    """Whether much more is seen than was predicted."""
    return look.seen.ratio**2 > 1.0 + _SET.power


def leaders(look: Look) -> list[str]:
    """Who is carried first: the leaders of those that are serious (`shortlist`); where nobody is, the best of each kind
    that promises more than chance gives, or of all where much is seen, by what it promises.

    Far from the truth the scan is a rough guide, and the true effect may scatter from part to part as the others do.
    """
    if serious := shortlist(look.seen, look.serious):
        return serious
    bar = -math.inf if _stands_far(look) else chance_gain(_SET.degrees, len(look.evidence))
    return [name for name in second_thoughts(look.evidence, ()) if look.evidence[name].gain > bar][: _SET.leaders]


def is_small(left: Look, gained: float) -> bool:
    """Whether what is seen behind a candidate that gained so much is as large as predicted, and holds no more than a
    second effect or chance: steadily or not, since what is rough is not small.
    """
    promised = max((item.gain for item in left.evidence.values()), default=0.0)
    matters = max(_SET.left * gained, chance_gain(_SET.degrees, len(left.evidence)))
    return left.seen.ratio**2 < 1.0 + _SET.power and promised <= matters


def within_reach(serious: list[Evidence], tried: Collection[str], gained: float) -> list[str]:
    """The best of each kind that was not tried and that may be no worse than one that gained so much: where the linear
    scan is rough, as far from the truth and while the observer settles, many; where it is exact, those that tie.
    """
    return _new_kinds((item for item in serious if item.gain + _SET.scan_deviations * item.error > gained - TIE), tried)


def looking_like(look: Look, tried: Collection[str], gains: Mapping[str, float]) -> list[str]:
    """The best of each kind that looks like the one of `tried` that gained most, is serious and of another kind than
    all of those: where the scan is rough, its leader may look like others than the best does.
    """
    best = max((name for name in tried if name in gains), key=lambda name: gains[name])
    alike = look.alike(best)
    return _new_kinds((item for item in look.serious if alike.get(item.name, 0.0) > _SET.alike), tried)


def shortlist(seen: Scan, serious: list[Evidence]) -> list[str]:
    """Those to be tried: the best, what looks like it, what explains much by itself and steadily; nobody
    where nothing is serious."""
    if not serious:
        return []
    best = serious[0]
    alike = likeness(seen, best.name)
    steady = sorted(serious, key=lambda item: -item.gain / max(item.scatter, 1.0))
    names = [best.name]
    for item in (*steady[:2], *serious[1:]):
        if item.name in names:
            continue
        if item in steady[:2] or alike[item.name] > _SET.alike or item.gain > _SET.as_good * best.gain:
            names.append(item.name)
    return names[: _SET.leaders]


def second_thoughts(found: Mapping[str, Evidence], tried: Collection[str]) -> list[str]:
    """The best of each kind that was not tried, sure or not, the most promising first."""
    return _new_kinds(found.values(), tried)


def _new_kinds(items: Iterable[Evidence], tried: Collection[str]) -> list[str]:
    """The first of each kind that none of the tried is of."""
    names: list[str] = []
    for item in items:
        if all(kind(item.name) != kind(name) for name in (*names, *tried)):
            names.append(item.name)
    return names


def worth_finishing(models: Mapping[str, Fitted], base: Fitted, tried: Mapping[str, float]) -> list[str]:
    """Of those that one pass was made of, the ones that another may matter for: with a good share of the best gain, or
    behind it by no more than a start may take off a likelihood.

    tried: gains over `base` of those that were carried before.
    """
    gains = {name: fitted.likelihood - base.likelihood for name, fitted in models.items()}
    best = max((*tried.values(), *gains.values()))
    bar = min(_SET.as_good * best, best - THRESHOLDS.parameters.rough_start)
    return [name for name in models if gains[name] > bar]


def worth_refining(
    models: Mapping[str, Fitted],
    base: Fitted,
    tried: Mapping[str, float],
    watched: Mapping[str, Parameters],
) -> list[str]:
    """Of those that come near the best, the ones with parameters; of two of a kind, or with the same parameters, the
    better.  Those akin to the best come near it when theirs are right.

    tried: gains over `base` of those that were carried before.
    """
    taken: list[str] = []
    for name in _near_the_best(models, base, tried):
        if watched[name] and all(watched[name] != watched[other] and kind(name) != kind(other) for other in taken):
            taken.append(name)
    return taken


def worth_following(
    models: Mapping[str, Fitted],
    base: Fitted,
    tried: Mapping[str, float],
    watched: Mapping[str, Parameters],
    refined: Collection[str],
) -> dict[str, str]:
    """Of those that come near the best, the ones with the parameters of another kind that is refined, and which: as a
    line in the sense channel and a vibration of the base, which come near each other at any frequency.

    tried: as of `worth_refining`.
    """
    found: dict[str, str] = {}
    for name in _near_the_best(models, base, tried):
        same = [other for other in refined if watched[other] == watched[name] and kind(other) != kind(name)]
        if same and name not in refined:
            found[name] = same[0]
    return found


def _near_the_best(models: Mapping[str, Fitted], base: Fitted, tried: Mapping[str, float]) -> list[str]:
    gains = dict(tried) | {name: fitted.likelihood - base.likelihood for name, fitted in models.items()}
    best = max(gains, key=lambda name: gains[name])
    share = {name: _SET.as_good if are_kin(best, name) else _SET.refined for name in models}
    near = [name for name in models if gains[name] > share[name] * gains[best]]
    return sorted(near, key=lambda name: -models[name].likelihood)
