"""How probable each account of a record is: nothing missing, an effect of the catalogue, or something else.

Likelihoods of all that was carried, less the price of what was fitted, times prior odds.  Differences of likelihoods
count as much less as they are less sure than white innovations would make them (`trace/dispersion`).  Something else is
what the nameless force stands for, in place of the effects or beside them, where it does more than a residual may hold
that counts as explained.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from estimator.diagnosis import Classes
from estimator.thresholds import THRESHOLDS
from estimator.trace.criterion import TIE
from estimator.trace.engine import Look, Round
from estimator.trace.nameless import Contest

NOTHING = "nothing"
OTHER = "something else"

_PRIOR = THRESHOLDS.prior
_PREDICTABLE = THRESHOLDS.judgement.predictable


@dataclass(frozen=True)
class Account:
    """One account of what a round of the choice asked: a kind of effect, or nothing.

    deficit: by how much less its likelihood is than that of the one that was taken, prices included, in twice the
    log-likelihood; dispersion: by how much that is less sure than white innovations would make it.
    """

    name: str
    deficit: float
    dispersion: float = 1.0

    @property
    def weight(self) -> float:
        """Its likelihood over that of the one taken, as far as the record is sure of it."""
        return math.exp(min(-0.5 * self.deficit / max(self.dispersion, 1.0), 300.0))


def of_rounds(
    rounds: Iterable[Round[Look]], promised: Callable[[Look], Mapping[str, float]]
) -> dict[str | None, tuple[Account, ...]]:
    """By who was taken, all that was asked there: gains of those that were carried less their prices, those that others
    promise, and nothing; where nobody ever was, the same of the first round, by none.
    """
    found: dict[str | None, tuple[Account, ...]] = {}
    for one in rounds:
        if one.taken is None and found:
            continue
        worth = dict(promised(one.look))
        worth |= {tried.name: tried.score.gain - tried.score.price for tried in one.tried if tried.score is not None}
        reached = worth[one.taken] if one.taken is not None else 0.0
        found[one.taken] = (Account(NOTHING, reached), *(Account(name, reached - own) for name, own in worth.items()))
    return found


def doubted(accounts: Iterable[Account], names: Collection[str]) -> tuple[Account, ...]:
    """The same, where a part of the record without a vote, or a promise, speaks against these kinds: they are behind by
    what two accounts differ by that are told apart, at least.
    """
    return tuple(
        replace(one, deficit=max(one.deficit, TIE * max(one.dispersion, 1.0))) if one.name in names else one
        for one in accounts
    )


def beside_nothing(accounts: Iterable[Account]) -> tuple[Account, ...]:
    """The same where nothing is named in the end, whatever was taken on the way: a promise speaks against it all."""
    all_of_them = tuple(accounts)
    base = next(one.deficit for one in all_of_them if one.name == NOTHING)
    shifted = tuple(replace(one, deficit=one.deficit - base) for one in all_of_them)
    return doubted(shifted, {one.name for one in shifted if one.name != NOTHING})


def classes(effect: str | None, accounts: Iterable[Account], contest: Contest | None, *, is_open: bool) -> Classes:
    """Probabilities of these accounts and of something else, the largest first.

    effect: which of those that are named it is about, None where nothing is; accounts: of each kind one, and nothing;
    contest: what the nameless force makes of the part held out, None where that was not asked; is_open: whether
    something is left, or a promise does not hold.
    """
    all_of_them = tuple(accounts)
    effects = max(sum(one.name != NOTHING for one in all_of_them), 1)
    weights = {
        one.name: one.weight * (_PRIOR.nothing if one.name == NOTHING else _PRIOR.effect / effects)
        for one in all_of_them
    }
    known = sum(weights.values())
    other = _PRIOR.other / (_PRIOR.effect + _PRIOR.nothing) * (0.0 if contest is None else _ahead(contest))
    if is_open:
        other = max(other, THRESHOLDS.criterion.odds)
    share = 1.0 / (1.0 + other)
    found = {name: share * weight / known for name, weight in weights.items()} if known > 0.0 else {}
    found[OTHER] = max(1.0 - sum(found.values()), 0.0) if found else 1.0  # rounding may pass 1
    return Classes(effect, dict(sorted(found.items(), key=lambda item: -item[1])))


def stated(
    accounts: Mapping[str | None, tuple[Account, ...]],
    named: Mapping[str, str],
    against: Collection[str],
    contest: Contest | None,
    *,
    is_open: bool,
) -> tuple[Classes, ...]:
    """Of each effect that is named, else once of the record.

    accounts: by who was taken; named: as they were taken, and how each is called; against: kinds that a promise speaks
    against; contest, is_open: as of `classes`.
    """
    if not named:
        first = next(iter(accounts.values()), None)
        return () if first is None else (classes(None, beside_nothing(first), contest, is_open=is_open),)
    return tuple(
        classes(called, doubted(accounts[name], against), contest, is_open=is_open)
        for name, called in named.items()
        if name in accounts
    )


def _ahead(contest: Contest) -> float:
    """Likelihood of something nameless over that of what was named: beside it, where that does more than may be left,
    or in its place.
    """
    instead, beside = (max(dispersion, 1.0) for dispersion in contest.dispersions)
    may_be_left = -contest.samples * math.log1p(-_PREDICTABLE)
    leads = [contest.left / beside - may_be_left]
    if contest.named != 0.0:
        leads.append(-contest.lead / instead)
    return sum(math.exp(min(0.5 * lead, 300.0)) for lead in leads if not math.isnan(lead))
