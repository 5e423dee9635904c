"""What would let the constants of the model be what the bench file declares.

Where a record holds one state of motion only, a constant may take up an effect without leaving a residual: a drive that
is weaker than declared is a damping that is lower, as far as the record goes.  What is declared of that constant is
then all there is to tell.  In a first pass an observer begins with the declared constants and their spreads, so that
its likelihood has the declaration in it, and its covariance, too.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.candidates import kind
from estimator.trace.claims import constants_of
from estimator.trace.criterion import TIE, chance_gain, schwarz
from estimator.trace.engine import Round
from estimator.trace.fitting import Fitted, coefficients_of, fit, parameters_of
from estimator.trace.observer_model import degrees, numbers
from estimator.trace.probability import NOTHING as NO_EFFECT
from estimator.trace.probability import Account
from estimator.trace.problem import Problem
from estimator.trace.promises import Constant
from estimator.trace.rivals import Rival
from estimator.trace.searched import NOTHING
from estimator.trace.selection import Selection
from estimator.trace.symmetries import RING_DOWN


def reconciled(
    problem: Problem, selection: Selection, progress: Callable[[str, int, int], None]
) -> tuple[str, Selection] | None:
    """The effect with which no constant is in conflict, where one is that gains more than chance, and the selection
    with it; as near as it are those whose likelihoods are.

    problem: the part that was fitted; selection: without an effect that is named.
    """
    part = problem.part(slice(0, THRESHOLDS.choice.compared))
    look = selection.rounds[-1].look
    one_of_each: dict[str, str] = {}
    for name in look.watched:
        one_of_each.setdefault(kind(name), name)
    carried = [part.effects, *({**part.effects, name: look.watched[name]} for name in one_of_each.values())]
    base, *others = side_by_side(
        [partial(fit, part.carrying(effects), passes=1) for effects in carried],
        lambda done: progress("conflict", done, len(carried)),
    )
    models: dict[str, Fitted] = {}
    standing: dict[str, float] = {}
    for name, model in zip(one_of_each.values(), others, strict=True):
        gain = model.likelihood - base.likelihood
        if gain > chance_gain(degrees(name, part.device), len(one_of_each)) and not _conflicts(part, model):
            models[name] = model
            standing[name] = gain - schwarz(numbers(name, part.device), base.estimates.innovation.size)
    if not models:
        return None
    ranked = sorted(models, key=lambda name: -standing[name])
    best = ranked[0]
    behind = {name: standing[best] - standing[name] for name in ranked[1:]}
    return best, replace(
        selection,
        effects=coefficients_of(models[best].observer),
        rounds=(*selection.rounds, Round(look, (), best)),
        alike={best: {}},
        rivals={
            best: {
                name: Rival(less, TIE, parameters_of(models[name], name)) for name, less in behind.items() if less < TIE
            }
        },
        accounts={
            best: (
                Account(kind(best), 0.0),
                Account(NO_EFFECT, standing[best]),
                *(Account(kind(name), less) for name, less in behind.items()),
            )
        },
        after=models[best],
        gain={best: models[best].likelihood - base.likelihood},
        searched={best: NOTHING},
    )


def runs_backwards(constants: Iterable[Constant]) -> str | None:
    """What is said where both axes have the damping that is declared with the other sign: in reverse order a record has
    that, and a rate of the other sign (docs/explanation.md).
    """
    dampings = [one for one in constants if one.name in ("dxx", "dyy")]
    turned = [replace(one, declared=-one.declared, positive=False) for one in dampings]
    if len(dampings) < 2 or any(one.high >= 0.0 for one in dampings) or any(map(promises.conflict, turned)):
        return None
    return f"it may run backwards: the damping of both axes is the declared one with the other sign; {RING_DOWN}"


def _conflicts(problem: Problem, model: Fitted) -> bool:
    return any(promises.conflict(constant) for constant in constants_of(problem, model))
