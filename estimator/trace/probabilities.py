"""How probable each account of a record is."""

from collections.abc import Iterable, Mapping

import numpy as np

from estimator.diagnosis import Classes
from estimator.effects.labels import kind
from estimator.trace.ambiguity import Member
from estimator.trace.checks import OF_THE_REST, Evidence
from estimator.trace.likelihood import Check
from estimator.trace.search import Search


def probabilities(
    evidence: Evidence, checks: Iterable[Check], groups: Mapping[str, list[Member]], found: Search
) -> tuple[Classes, ...]:
    """How probable each account of the record is: likelihoods less what their coefficients cost (Schwarz, 1978).

    Something else than the catalogue has is a random force, where a check finds more of it than a complete model may
    leave.
    """
    quiet, disturbed = evidence.quiet, evidence.disturbed
    penalty = 2.0 * float(np.log(quiet.count.sum()))
    left = any(not check.passed and check.name in OF_THE_REST for check in checks)
    other = 2.0 * (disturbed.log_likelihood - quiet.log_likelihood) - penalty if left else -penalty
    if not evidence.without:
        last = found.rounds[-1]
        # That something is missing is as likely beforehand as that nothing is: the kinds share it.
        share = 2.0 * float(np.log(max(len({kind(score.name) for score in last.table}), 1)))
        gains = {kind(score.name): score.robust - penalty - share for score in reversed(last.table)}
        return (_classes(None, {"nothing": 0.0, "something else": other, **gains}),)
    classes = []
    for name, without in evidence.without.items():
        # Beside the named effect, as the model without it may be one that loses the motion: likelihood zero.
        weights = {"nothing": -evidence.model.gain_over(without, name), kind(name): 0.0, "something else": other}
        weights |= {kind(member.name): -member.deficit for member in groups[name]}
        classes.append(_classes(kind(name), weights))
    return tuple(classes)


def _classes(effect: str | None, gains: Mapping[str, float]) -> Classes:
    """Of an account that loses the motion the gain is no number: it is as improbable as can be.  Beside a model that
    loses it, one that does not gains without bound: it is certain.
    """
    gains = {name: -np.inf if np.isnan(gain) else gain for name, gain in gains.items()}
    top = max(gains.values())
    weights = {name: 1.0 if gain == top else float(np.exp(0.5 * (gain - top))) for name, gain in gains.items()}
    total = sum(weights.values())
    return Classes(effect, dict(sorted(((n, w / total) for n, w in weights.items()), key=lambda item: -item[1])))
