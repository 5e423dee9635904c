"""Which experiment separates the members of an ambiguity group: each is played with the fitted model, and the score
signatures of the members are compared in it.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from estimator.scaling import Array
from estimator.settings import Device, Gain
from estimator.side_by_side import side_by_side
from estimator.trace.ambiguity import Member
from estimator.trace.experiments import EXPERIMENTS, SETTLED, Experiment, in_words, loop_record, turn_for
from estimator.trace.filtered import Filtered
from estimator.trace.fit import FittedModel, beside
from estimator.trace.likelihood import BLOCKS, TIE, Model
from estimator.trace.problem import Effects, Problem, Progress
from estimator.trace.score_test import projected

SURE = 1.645
"""Standard deviations: an experiment so long separates two effects 95 times in 100."""
LONGEST = 100.0
"""Times the record: an hour, for a record of half a minute."""


class Advice(NamedTuple):
    """An experiment, the likeness of two effects in it, how long it has to last to separate them [s], and what is done
    in words; empty where none separates them.
    """

    experiment: Experiment | None = None
    expected: float | None = None
    takes: float | None = None
    words: str | None = None


class Shown(NamedTuple):
    """Of an effect's signature in an experiment: its size in twice the log-likelihood, and of that, what another effect
    does not explain: its value, and the form (c, c) of the effect's coefficients that it is.
    """

    size: float
    left: float
    form: Array

    @property
    def likeness(self) -> float:
        """Correlation of the signature with what the other effect makes of it."""
        return float(np.sqrt(np.clip(1.0 - self.left / self.size, 0.0, 1.0)))


def separations(
    problem: Problem, model: FittedModel, groups: Mapping[str, list[Member]], constants: Mapping[str, float],
    progress: Progress,
) -> dict[tuple[str, str], Advice]:  # fmt: skip
    """For each effect of a model and each other member of its group: the experiment that separates them, the simplest
    that does not take much longer.  constants: of the fitted base model, SI.
    """
    groups = {name: members for name, members in groups.items() if members}
    if not groups:
        return {}
    device, controller, span = problem.device, problem.controller, problem.span
    settings = replace(problem.settings, gain=Gain.EKF, effects={}, initial=_oscillating(constants, device))
    latency = controller.latency if controller is not None else 1
    turn = turn_for(math.sqrt(device.target), settings.process_noise.rate, span)
    able = [one for one in EXPERIMENTS if not one.turning or turn.rate > 0.0]

    def played(experiment: Experiment) -> dict[tuple[str, str], Advice]:
        record = loop_record(experiment, device, settings, latency=latency, turn=turn, span=span)
        of = Filtered(Problem(record, device, settings))
        length = of.problem.span * (1.0 - SETTLED)
        found = {}
        for name, members in groups.items():
            for other, shown in _shown(of, model, name, members).items():
                own = model.layout.of(name)[: len(shown.form)]
                takes = _takes(shown, model.covariance[np.ix_(own, own)], length, LONGEST * span)
                if takes < math.inf:
                    found[name, other] = Advice(experiment, shown.likeness, takes, in_words(experiment, turn))
        return found

    tried = side_by_side(
        [partial(played, experiment) for experiment in able], lambda done: progress("experiments", done, len(able))
    )
    pairs = [(name, member.name) for name, members in groups.items() for member in members]
    return {pair: _simplest([found[pair] for found in tried if pair in found], span) for pair in pairs}


def _shown(of: Filtered, model: FittedModel, name: str, members: list[Member]) -> dict[str, Shown]:
    """By member, what an experiment shows of the effect `name` beside it."""
    parameters: Effects = {
        name: model.layout.effects_of(model.model)[name],
        **{one.name: one.model.layout.effects_of(one.model.model)[one.name] for one in members},
    }
    layout = of.layout({})
    seen = of.evaluate(layout, Model({}, layout.mean, of.declared_noise()), tested=parameters)
    if not seen.sound:
        return {}
    own = len(layout.names)
    settled = slice(round(SETTLED * BLOCKS), None)  # what only a filter's start tells depends on how it was begun
    information, _ = projected(seen.information[settled], seen.score[settled], layout.deviation)
    whole = information.sum(axis=0)
    columns = {one: [k for k, owner in enumerate(seen.names[own:]) if owner == one] for one in parameters}
    rows = columns[name]
    size = model.model.theta[model.layout.of(name)[: len(rows)]]
    total = whole[np.ix_(rows, rows)]
    shown = {}
    for member in members:
        form, _ = beside(whole, rows, columns[member.name])
        shown[member.name] = Shown(float(size @ total @ size), float(size @ form @ size), form)
    return {other: one for other, one in shown.items() if one.size > 0.0}


def _simplest(able: list[Advice], span: float) -> Advice:
    """Of what separates a pair that a record of `span` [s] did not, the simplest that does not take much longer."""

    def effort(one: Advice) -> float:
        assert one.experiment is not None
        assert one.takes is not None
        return one.experiment.effort * max(one.takes, span)

    return min(able, key=effort, default=Advice())


def _takes(shown: Shown, spread: Array, length: float, longest: float) -> float:
    """How long [s] an experiment has to last in which two effects differ as shown in `length` [s]; infinity where that
    is longer than `longest`.

    A difference of d² in twice the log-likelihood is known to 2 d, and must exceed a tie all the same.  The mean of a
    quadratic form is its value at the mean and the trace of form and covariance: so much of it may be there because
    the coefficients are not known exactly.  Where that is all, an experiment may take as long as any that is advised.
    """
    needed = (SURE + math.sqrt(SURE**2 + TIE)) ** 2 * length
    if needed >= longest * shown.left:
        return math.inf
    sure = shown.left - float(np.trace(shown.form @ spread))
    return longest if needed >= longest * sure else needed / sure


def _oscillating(constants: Mapping[str, float], device: Device) -> dict[str, float]:
    """The constants, where their springs hold the mass; else none: an experiment is played as the bench declares."""
    kxx, kyy, kxy = (
        constants.get(name, declared) for name, declared in zip(("kxx", "kyy", "kxy"), device.stiffness, strict=True)
    )
    return dict(constants) if kxx > 0.0 and kxx * kyy > kxy**2 else {}
