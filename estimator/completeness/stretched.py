"""The likelihood of the stretches of a run, judged as one record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

from estimator.effects.declaration import Coefficient
from estimator.record import Record
from estimator.scaling import Scaling
from estimator.side_by_side import side_by_side
from estimator.trace.filtered import Filtered
from estimator.trace.fit import FittedModel, advanced, at, fit, maximise
from estimator.trace.likelihood import Evaluation, Layout, Model, ObserverLayout
from estimator.trace.problem import Effects, Problem
from estimator.trace.search import QUICK, with_effects


@dataclass(frozen=True)
class Stretched(Filtered):
    """`Likelihood` of a run of which some stretches are looked at: each begins with the motion that its first cycles
    show, and all have the same parameters.

    The problem has the first stretch, `later` the others; known: standard deviations of coefficients, SI, by symbol,
    that take the place of their plausible sizes.
    """

    later: tuple[Filtered, ...] = ()
    known: Mapping[str, float] = field(default_factory=dict)

    def part(self, rows: slice) -> "Stretched":
        first = Filtered.part(self, rows)
        if first is self and not self.later:
            return self
        return replace(self, problem=first.problem, beginning=first.beginning, later=())

    def layout(self, effects: Effects) -> ObserverLayout:
        """The parameters of the model with these effects, as well known as they are."""
        layout = ObserverLayout(self.problem, effects)
        for k, owner in enumerate(layout.owner):
            if owner and (known := self.known.get(layout.names[k].partition(":")[0], 0.0)) > 0.0:
                layout.deviation[k] = known / abs(layout.factor[k])
        return layout

    def freeing(self, effect: str) -> "Stretched":
        """The same with nothing known of an effect's coefficients but their plausible sizes."""
        symbols = {one.name.partition(":")[0] for one in self.effect(effect).coefficients}
        return replace(self, known={symbol: sd for symbol, sd in self.known.items() if symbol not in symbols})

    def unit(self, coefficient: Coefficient) -> float:
        """SI of a scaled unit of a coefficient."""
        return Scaling.of(self.problem.device).coefficient(coefficient)

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        """A pass over all stretches.  Raises ModelError as `Observer` does."""

        def over(one: Filtered) -> Evaluation:
            return Filtered.evaluate(one, layout, model, derivatives=derivatives, tested=tested)

        return Evaluation.of_parts(side_by_side([partial(over, one) for one in (self, *self.later)]))


def likelihood_of(problem: Problem, records: Sequence[Record]) -> Stretched:
    """Of the stretches of a run; the observer of the problem is the bench's."""
    first, *others = (Filtered(problem.on(record)) for record in records)
    return Stretched(first.problem, later=tuple(others))


def fitted(of: Stretched, effects: Effects, most: float) -> FittedModel:
    """The model with these effects where the likelihood is largest, begun from a fit to its beginning.

    A model whose innovation is above `most` times what is predicted of it, rms, lacks something: it has a random force
    in its place, so that the filter follows the motion.
    """
    begun = fit(of.part(slice(0, QUICK)), effects)
    found = maximise(of, at(of, begun.layout, replace(begun.model, noise=of.declared_noise())))
    return found if _accounts(found, most) else maximise(of, advanced(of, at(of, begun.layout, begun.model)))


def beside(of: Stretched, base: FittedModel, more: Effects, most: float) -> FittedModel:
    """The model with these effects more, all of their coefficients near nothing at first.

    With them it may need no random force in place of what it lacked: that of the base model is for one that leaves more
    than `most` times the noise without.
    """
    layout, model = with_effects(of, base, {**base.layout.effects_of(base.model), **more})
    quiet = maximise(of, at(of, layout, replace(model, noise=of.declared_noise())))
    if base.model.noise == of.declared_noise() or _accounts(quiet, most):
        return quiet
    return maximise(of, at(of, layout, model))


def _accounts(found: FittedModel, most: float) -> bool:
    """Whether a model leaves no more than `most` times the noise, rms."""
    return found.evaluation.sound and found.evaluation.scale <= most**2
