"""Effects that a record cannot tell from the named ones, and what would separate them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

from estimator.diagnosis import Found, Rejected, Separation
from estimator.effects.labels import kind
from estimator.side_by_side import side_by_side
from estimator.trace.ambiguity import Member
from estimator.trace.angle import AngleReader
from estimator.trace.fit import FittedModel
from estimator.trace.named import called, constants_of, effects_of
from estimator.trace.problem import Problem
from estimator.trace.separations import separations
from estimator.trace.symmetries import Constants, equivalents, nonreciprocal_of

AXES = ("xx", "yy", "xy")


def pairs_of(
    problem: Problem, model: FittedModel, groups: Mapping[str, list[Member]], reader: AngleReader,
    effects: Sequence[Found], rejected: Iterable[Rejected], progress: Callable[[str, int, int], None],
) -> tuple[Separation, ...]:  # fmt: skip
    """Each named effect with the other members of its group: those that explain this record as well, each with the
    experiment that separates them; and those whose equations are the same, which no record separates.
    """
    if problem.device.axes != 2:
        return tuple(
            Separation(called(name, groups), kind(one.name), one.likeness, None, None)
            for name, members in groups.items()
            for one in members
        )
    found = _by_experiment(problem, model, groups, reader, progress)
    return tuple((found | _by_symmetry(problem, model, effects, rejected)).values())


def _by_experiment(
    problem: Problem, model: FittedModel, groups: Mapping[str, list[Member]], reader: AngleReader,
    progress: Callable[[str, int, int], None],
) -> dict[tuple[str, str], Separation]:  # fmt: skip
    advised = separations(problem, model, groups, constants_of(model), progress)
    carried = effects_of(model)
    pairs = [(name, one) for name, members in groups.items() for one in members]
    apart = side_by_side([partial(reader.moved, carried, effects_of(one.model)) for _, one in pairs])
    found = {}
    for (name, one), moved in zip(pairs, apart, strict=True):
        advice, effect, other = advised[name, one.name], called(name, groups), kind(one.name)
        experiment = None if advice.experiment is None else advice.experiment.name
        found[effect, other] = Separation(
            effect, other, one.likeness, advice.words, advice.expected, moved, experiment, advice.takes
        )
    return found


def _by_symmetry(
    problem: Problem, model: FittedModel, effects: Sequence[Found], rejected: Iterable[Rejected]
) -> dict[tuple[str, str], Separation]:
    if not effects:
        return {}
    device, found = problem.device, constants_of(model)
    stiffness = [found.get(f"k{axis}", value) for axis, value in zip(AXES, device.stiffness, strict=True)]
    damping = [found.get(f"d{axis}", value) for axis, value in zip(AXES, device.damping, strict=True)]
    constants = Constants(
        _three(stiffness), _three(damping), device.stiffness, problem.settings.spread.stiffness * device.target
    )
    intervals = {one.name: dict(one.coefficients) for one in effects}
    sizes = {one.name: one.coefficients for one in effects} | {one.name: one.bound for one in rejected}
    return {
        (same.effect, same.other): Separation(same.effect, same.other, 1.0, same.told_by, None, same.angle)
        for same in equivalents(intervals, constants, nonreciprocal_of(sizes))
    }


def _three(values: list[float]) -> tuple[float, float, float]:
    xx, yy, xy = values
    return xx, yy, xy
