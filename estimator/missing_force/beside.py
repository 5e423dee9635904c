"""A record beside a motion close to the true one, of which the observer's own step tells what the model makes.

What that motion lacks then follows a linear step, whatever effects the model has: δ' = A δ and what the missing force
adds.  Scaled as in the observer: time by 1/ω0, length by the nominal amplitude.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimator.observer import Estimates, Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.trace.filtered import Filtered
from estimator.trace.likelihood import observer_of
from estimator.trace.problem import Effects, Problem

_LEAST_NOISE = 1e-16
"""Intensity of a white force that every model has: with none, no gain settles."""


@dataclass(frozen=True, eq=False)
class Beside:
    """predicted (n, states): [x, ẋ, y, ẏ], one step on from the motion at the sample before; innovation (n, axes):
    measured less predicted, NaN where a sample is lost; moved (n, states): what the known motion's distance from its
    own prediction comes to one step later; step: between samples; transition (states, states): A; noise (axes,):
    deviation of a sample; force_noise: intensity of the white force that is declared.
    """

    predicted: Array
    innovation: Array
    moved: Array
    step: float
    transition: Array
    noise: Array
    force_noise: float

    @property
    def axes(self) -> int:
        """1 or 2."""
        return int(self.innovation.shape[1])

    @property
    def states(self) -> int:
        """Of the motion."""
        return 2 * self.axes


def beside(problem: Problem, effects: Effects, motion: Mapping[str, Array], start: Mapping[str, float]) -> Beside:
    """The record of a problem beside a motion, by the model with these effects (SI).

    motion: states, constants and coefficients at each sample (n,), SI, by name; start: one interval before the first.
    """
    record = problem.record
    observer = _idle(problem, effects)
    n, states = len(record), observer.states
    series = np.column_stack([np.broadcast_to(motion[name], n) for name in observer.names])
    before = np.concatenate([[[start[name] for name in observer.names]], series[:-1]])
    told = _stepped(observer, record, before)
    predicted = told.state[:, :states] / observer.factors[:states]
    transition = transition_of(problem, {name: float(np.mean(motion[name])) for name in observer.names})
    moved = np.zeros((n, states))
    moved[1:] = (predicted - series[:, :states] / observer.factors[:states])[:-1] @ transition.T
    declared = Observer(problem.device, replace(problem.settings, effects={}))
    return Beside(
        predicted, np.where(np.isfinite(record.sense), told.innovation, np.nan) / observer.volts, moved,
        float(np.mean(record.step)) * observer.scaling.omega0, transition,
        np.sqrt(declared.sense_noise), float(declared.force_noise[0]) + _LEAST_NOISE,
    )  # fmt: skip


def _idle(problem: Problem, effects: Effects) -> Observer:
    """A filter that corrects nothing."""
    observer = observer_of(problem, effects, Filtered(problem).no_disturbance())
    observer.assume(observer.estimated, np.zeros((len(observer.estimated),) * 2))
    observer.hold(observer.estimated[observer.states :])
    return observer


def _stepped(observer: Observer, record: Record, before: Array) -> Estimates:
    """Each sample as predicted from the row of `before` (n, states + constants), SI."""
    return observer.run(
        record.sense, record.drive, step=record.step, temperature=record.channels.get("temperature"), truth=before
    )


def transition_of(problem: Problem, constants: Mapping[str, float]) -> Array:
    """A (states, states) of the base model from one sample to the next, by constants in SI."""
    bare = problem.carrying({})
    observer = _idle(bare, {})
    states, record = observer.states, bare.record
    unit = np.concatenate([np.zeros((1, states)), np.eye(states)]) * observer.factors[:states]
    rest = np.tile([constants[name] for name in observer.names[states:]], (len(unit), 1))
    step = np.full(len(unit), np.mean(record.step))
    lost, still = np.full((len(unit), bare.device.axes), np.nan), np.zeros((len(unit), *record.drive.shape[1:]))
    moved = observer.run(lost, still, step=step, truth=np.hstack([unit, rest])).state[:, :states]
    return np.asarray(((moved[1:] - moved[0]) / observer.factors[:states]).T)
