"""Which experiment would tell two effects apart: each is played through with the model, and the signatures compared."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from estimator.kernel.experiment import Plan, experiment_block
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.evidence import likeness
from estimator.trace.problem import Problem
from estimator.trace.scan import scan
from estimator.trace.selection import Selection

_SET = THRESHOLDS.separation


@dataclass(frozen=True)
class Experiment:
    """What is done to a device on the bench, beside holding its amplitude: all in relative size, 0 where it is not."""

    name: str
    words: str
    virtual: float = 0.0
    modulation: float = 0.0
    dither: float = 0.0
    turning: float = 0.0
    stiffness: float = 0.0


EXPERIMENTS = (
    Experiment("virtual_rotation", "impose a virtual rotation", virtual=_SET.virtual),
    Experiment("amplitude", "modulate the amplitude by 30 %", virtual=_SET.virtual, modulation=_SET.swing),
    Experiment("dither", "dither the drive off the resonance", virtual=_SET.virtual, dither=_SET.dither),
    Experiment("stiffness", "step the target stiffness by 2 %", virtual=_SET.virtual, stiffness=_SET.step),
    Experiment("rate", "turn the gyro at a varying rate", virtual=_SET.virtual, turning=_SET.turned),
    Experiment(
        "all",
        "modulate the amplitude, dither, step the target stiffness and turn the gyro",
        virtual=_SET.virtual, modulation=_SET.swing, dither=_SET.dither, turning=_SET.turned, stiffness=_SET.step,
    ),
)  # fmt: skip


class Advice(NamedTuple):
    """An experiment and what it would show of a pair; nothing where none tells the two apart."""

    experiment: Experiment | None = None
    expected: float | None = None


def experiment_called(name: str) -> Experiment | None:
    """The experiment of that name, None where there is none."""
    return next((experiment for experiment in EXPERIMENTS if experiment.name == name), None)


def separations(
    pairs: list[tuple[str, str]],
    selection: Selection,
    problem: Problem,
    progress: Callable[[str, int, int], None],
) -> list[Advice]:
    """For each pair (named, other): the simplest experiment that separates them, and their likeness in it.

    A single axis has no controller to experiment with.
    """
    device, controller = problem.device, problem.controller
    if not pairs or device.axes != 2:
        return [Advice()] * len(pairs)
    watched = {name: _parameters(name, selection) for pair in pairs for name in pair}
    found = dict(selection.before.settings.initial)
    settings = replace(problem.settings, gain=Gain.EKF, effects={}, initial=found if _oscillates(found, device) else {})
    latency = controller.latency if controller is not None else 1

    def played(experiment: Experiment) -> dict[str, dict[str, float]]:
        record = loop_record(experiment, device, settings, latency=latency)
        seen = scan(Problem(record, device, settings), watched)
        return {name: likeness(seen, name, _coefficients(name, selection, seen.columns)) for name, _ in pairs}

    likenesses = side_by_side(
        [partial(played, experiment) for experiment in EXPERIMENTS],
        lambda done: progress("experiments", done, len(EXPERIMENTS)),
    )
    alike = {experiment.name: found for experiment, found in zip(EXPERIMENTS, likenesses, strict=True)}
    return [_advice(name, other, alike) for name, other in pairs]


def _oscillates(constants: Mapping[str, float], device: Device) -> bool:
    """Whether the springs hold the mass: without the effects, the observer may have ended at some that do not."""
    kxx, kyy, kxy = (
        constants.get(name, declared) for name, declared in zip(("kxx", "kyy", "kxy"), device.stiffness, strict=True)
    )
    return kxx > 0.0 and kxx * kyy > kxy**2


def _advice(name: str, other: str, alike: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Advice:
    # An experiment that could not be followed tells nothing.
    values = {experiment.name: alike[experiment.name][name].get(other, 1.0) for experiment in EXPERIMENTS}
    able = [experiment for experiment in EXPERIMENTS if values[experiment.name] < THRESHOLDS.scan.same]
    if not able:
        return Advice()
    dearer = {"all": _SET.dearer}
    single = min(able, key=lambda experiment: values[experiment.name] + dearer.get(experiment.name, 0.0))
    return Advice(single, values[single.name])


def loop_record(
    experiment: Experiment, device: Device, settings: ObserverSettings, *, latency: int, noise: float = 1.0
) -> Record:
    """A record of the experiment on a device with the constants of `settings` and no effect.

    noise: times what the device declares.
    """
    omega0 = math.sqrt(device.target)
    scale = device.amplitude * device.target / device.drive_gain
    law = ControllerSettings(
        latency=latency,
        force_quantum=_SET.force_quantum * scale,
        force_limit=_SET.force_limit * scale,
        sense_quantum=_SET.sense_quantum * min(device.noise),
        energy_gain=_SET.firm,
        quadrature_gain=_SET.firm,
        virtual_rotation=experiment.virtual * omega0,
        dither=experiment.dither * scale,
        modulation=experiment.modulation,
        modulation_rate=omega0 / _SET.modulation,
    )
    loop = Observer(device, replace(settings, gain=Gain.EKF, effects={}), law)
    samples = int(_SET.cycles * 2.0 * math.pi / loop.h)
    t = np.arange(samples) * loop.h
    truth = loop.x.copy()
    truth[:4] = loop.x[:4] = 1.0, 0.0, 0.0, 0.0
    random = np.random.default_rng(0)
    added = noise * random.standard_normal((samples, 2)) * np.sqrt(loop.sense_noise)
    rates = experiment.turning * np.sin(t / _SET.turning)
    stiffness = 1.0 + experiment.stiffness * np.sign(np.sin(t / _SET.stepping))
    sensed, drive = np.zeros((samples, 2)), np.zeros((samples, 2))
    experiment_block(loop.arrays, truth, Plan(rates, stiffness, added), sensed, drive)
    volts = np.array([loop.scaling.sense(axis) for axis in range(2)])
    step = np.full(samples, 1.0 / device.sample_rate)
    return Record(sensed * volts, (drive * loop.scaling.drive)[:, :, None], step)


def _parameters(name: str, selection: Selection) -> dict[str, float]:
    for step in selection.rounds:
        if name in step.look.watched:
            return dict(step.look.watched[name])
    return {}


def _coefficients(name: str, selection: Selection, columns: Mapping[str, slice]) -> Array | None:
    """What was found of the effect, in the order of the scan's columns."""
    found = selection.effects.get(name)
    if found is None:
        return None
    values = list(found.values())
    size = columns[name].stop - columns[name].start
    return np.array(values[:size])
