"""Effects that a record cannot tell from the named ones, and what would separate them."""

from collections.abc import Iterable, Mapping, Sequence
from functools import partial

from estimator.diagnosis import Found, Rejected, Separation
from estimator.effects.labels import kind
from estimator.side_by_side import side_by_side
from estimator.trace.ambiguity import Member
from estimator.trace.angle import AngleReader
from estimator.trace.fit import FittedModel
from estimator.trace.named import called, constants_of, effects_of
from estimator.trace.pooled_layout import constant_of, of_records
from estimator.trace.problem import Problem, Progress
from estimator.trace.separations import separations
from estimator.trace.symmetries import Constants, equivalents, nonreciprocal_of

AXES = ("xx", "yy", "xy")


def pairs_of(
    problem: Problem, model: FittedModel, groups: Mapping[str, list[Member]], reader: AngleReader,
    effects: Sequence[Found], rejected: Iterable[Rejected], progress: Progress,
) -> tuple[Separation, ...]:  # fmt: skip
    """Each named effect with the other members of its group: those that explain this record as well, each with the
    experiment that separates them; and those whose equations are the same, which no record separates.  Nor does one
    record separate a constant that goes with the covariate of several.
    """
    alone: list[tuple[str, Member]] = []
    among: list[tuple[str, Member]] = []
    for name, members in groups.items():
        for one in members:
            (alone if constant_of(name) is None and constant_of(one.name) is None else among).append((name, one))

    def told(pairs: list[tuple[str, Member]]) -> list[Separation]:
        return [Separation(called(name, groups), kind(one.name), one.likeness, None, None) for name, one in pairs]

    if problem.device.axes != 2:
        return (*told(alone), *told(among))
    found = _by_experiment(problem, model, alone, groups, reader, progress)
    return (*(found | _by_symmetry(problem, model, effects, rejected)).values(), *told(among))


def _by_experiment(
    problem: Problem, model: FittedModel, pairs: list[tuple[str, Member]], named: Iterable[str], reader: AngleReader,
    progress: Progress,
) -> dict[tuple[str, str], Separation]:  # fmt: skip
    groups = {name: [one for other, one in pairs if other == name] for name, _ in pairs}
    advised = separations(problem, model, groups, constants_of(model), progress)
    carried = of_records(effects_of(model))
    apart = side_by_side([partial(reader.moved, carried, of_records(effects_of(one.model))) for _, one in pairs])
    found = {}
    for (name, one), moved in zip(pairs, apart, strict=True):
        advice, effect, other = advised[name, one.name], called(name, named), kind(one.name)
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
    constants = Constants(stiffness, damping, device.stiffness, problem.settings.spread.stiffness * device.target)
    intervals = {one.name: dict(one.coefficients) for one in effects}
    sizes = {one.name: one.coefficients for one in effects} | {one.name: one.bound for one in rejected}
    return {
        (same.effect, same.other): Separation(same.effect, same.other, 1.0, same.told_by, None, same.angle)
        for same in equivalents(intervals, constants, nonreciprocal_of(sizes))
    }
