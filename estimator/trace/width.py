"""How many candidates are carried, and which: the one place that says so for two axes."""

from collections.abc import Callable, Collection, Mapping

from estimator.trace.candidates import Parameters, kind
from estimator.trace.evidence import Evidence, likeness
from estimator.trace.fitting import Fitted
from estimator.trace.look import Look
from estimator.trace.scan import Scan

_SAME = 0.97  # likeness above which a candidate is tried for itself beside the best
_SERIOUS = 0.5  # of the best gain: a candidate with that much is tried as well
_NEAR = 0.9  # of the best gain: parameters are improved before the choice
_TRIED = 5
_LEFT = 0.01  # of the best gain: less is a matter for a second effect
_WIDER = 8  # tried beside, where the best does not explain everything


def hopeful(look: Look, tried: Collection[str], number: int, gained: float, left: Callable[[], float]) -> list[str]:
    """Whom to carry in round `number`, beside those that were tried in it; nobody when that is enough.

    gained: by the best that was tried; left: the gain that a scan behind it still promises.
    """
    leaders = shortlist(look.seen, look.serious)
    if not tried:
        return leaders
    if number > 0 or set(tried) - set(leaders):
        return []
    # Where the best leaves something, would another have explained that, too?
    return second_thoughts(look.evidence, tried) if left() > _LEFT * gained else []


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
        if item in steady[:2] or alike[item.name] > _SAME or item.gain > _SERIOUS * best.gain:
            names.append(item.name)
    return names[:_TRIED]


def second_thoughts(found: Mapping[str, Evidence], tried: Collection[str]) -> list[str]:
    """The best of each kind that was not tried, sure or not: far from the truth, the scan is a rough guide."""
    names: list[str] = []
    for item in found.values():
        if all(kind(item.name) != kind(name) for name in (*names, *tried)):
            names.append(item.name)
    return names[:_WIDER]


def worth_refining(
    models: Mapping[str, Fitted], base: Fitted, reached: float, watched: Mapping[str, Parameters]
) -> list[str]:
    """Of those that come near the best, the ones with parameters; of two of a kind, or with the same parameters, the
    better.
    """
    leading = max(reached, *(fitted.likelihood - base.likelihood for fitted in models.values()))
    near = [name for name, fitted in models.items() if fitted.likelihood - base.likelihood > _NEAR * leading]
    near.sort(key=lambda name: -models[name].likelihood)
    taken: list[str] = []
    for name in near:
        if watched[name] and all(watched[name] != watched[other] and kind(name) != kind(other) for other in taken):
            taken.append(name)
    return taken
