"""Which experiment would tell two effects apart: each is played through with the model, and the signatures compared."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from estimator.core.experiment import Plan, experiment_block
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings
from estimator.side_by_side import side_by_side
from estimator.thresholds import THRESHOLDS
from estimator.trace.certainty import covariance_of
from estimator.trace.criterion import TIE
from estimator.trace.evidence import Imitation, imitations
from estimator.trace.fitting import constants_of
from estimator.trace.problem import Problem
from estimator.trace.scan import PARTS, scan
from estimator.trace.selection import Selection

_SET = THRESHOLDS.separation
_BEGIN = round(_SET.settled * PARTS)  # the first part of an experiment that counts


@dataclass(frozen=True)
class Experiment:
    """What is done to a device on the bench, beside holding its amplitude: all in relative size, 0 where it is not;
    turning: whether the gyro is to be turned as well, as `Turn` says.
    """

    name: str
    words: str
    virtual: float = 0.0
    modulation: float = 0.0
    dither: float = 0.0
    stiffness: float = 0.0
    turning: bool = False

    @property
    def effort(self) -> float:
        """How many times as long a plain experiment may take before this one is made."""
        together = sum(size > 0.0 for size in (self.modulation, self.dither, self.stiffness)) > 1
        return _SET.dearer ** (together + self.turning)


EXPERIMENTS = (
    Experiment("virtual_rotation", "impose a virtual rotation", virtual=_SET.virtual),
    Experiment("amplitude", "modulate the amplitude by 30 %", virtual=_SET.virtual, modulation=_SET.swing),
    Experiment("dither", "dither the drive off the resonance", virtual=_SET.virtual, dither=_SET.dither),
    Experiment("stiffness", "step the target stiffness by 2 %", virtual=_SET.virtual, stiffness=_SET.step),
    Experiment(
        "together", "modulate the amplitude, dither and step the target stiffness",
        virtual=_SET.virtual, modulation=_SET.swing, dither=_SET.dither, stiffness=_SET.step,
    ),
    Experiment("rate", "turn the gyro at a varying rate", virtual=_SET.virtual, turning=True),
    Experiment(
        "all",
        "modulate the amplitude, dither, step the target stiffness and turn the gyro",
        virtual=_SET.virtual, modulation=_SET.swing, dither=_SET.dither, stiffness=_SET.step, turning=True,
    ),
)  # fmt: skip


def amplitude_held(experiment: Experiment) -> Experiment:
    """The same without a modulation of the amplitude, for which a converter may have no room."""
    return replace(experiment, words=experiment.words.replace("modulate the amplitude, ", ""), modulation=0.0)


class Turn(NamedTuple):
    """How the gyro is turned to and fro in an experiment: largest rate [rad/s], and what one period takes [s]."""

    rate: float
    period: float

    @property
    def text(self) -> str:
        """In words."""
        fast = f"{self.rate:.2g} rad/s ({math.degrees(self.rate):.3g} °/s)"
        return f"to and fro in {self.period:.2g} s, at most at {fast}"


def turn_for(omega0: float, wander: float, span: float) -> Turn:
    """How to turn a gyro of target frequency omega0 [rad/s] in an experiment of `span` [s], no faster than an observer
    follows that lets the rate wander by so many rad/s per √s; rate 0 where it is a constant to it.

    From one side to the other, half a period, the rate goes as far as it wanders in that time.
    """
    frequency = min(2.0 * math.pi * _SET.periods / span, omega0 / _SET.turning)
    return Turn(min(_SET.turned * omega0, 0.5 * wander * math.sqrt(math.pi / frequency)), 2.0 * math.pi / frequency)


class Advice(NamedTuple):
    """An experiment, how alike a pair would be in it, how long it has to last to tell the two apart [s], and what is to
    be done in words; nothing where none tells them apart.
    """

    experiment: Experiment | None = None
    expected: float | None = None
    takes: float | None = None
    words: str | None = None


def experiment_called(name: str) -> Experiment | None:
    """The experiment of that name, None where there is none."""
    return next((experiment for experiment in EXPERIMENTS if experiment.name == name), None)


def in_words(experiment: Experiment, turn: Turn) -> str:
    """What is to be done in an experiment, and how the gyro is turned where it is."""
    return f"{experiment.words}: {turn.text}" if experiment.turning else experiment.words


def separations(
    pairs: list[tuple[str, str]],
    selection: Selection,
    problem: Problem,
    progress: Callable[[str, int, int], None],
) -> list[Advice]:
    """For each pair (named, other): the experiment that separates them, the simplest that is not much longer.

    A pair that is listed for its signatures, as the other was not carried, needs one in which they differ by more than
    what lists it. A single axis has no controller to experiment with.
    """
    device, controller = problem.device, problem.controller
    if not pairs or device.axes != 2:
        return [Advice()] * len(pairs)
    watched = {name: _parameters(name, selection) for pair in pairs for name in pair}
    settings = replace(problem.settings, gain=Gain.EKF, effects={}, initial=_constants(selection, device))
    latency = controller.latency if controller is not None else 1
    span = problem.span
    turn = turn_for(math.sqrt(device.target), settings.process_noise.rate, span)
    known = {name for name, _ in pairs if name in selection.effects}
    unsure = {name: covariance_of(name, selection.after, selection.searched[name]) for name in known}
    able = [experiment for experiment in EXPERIMENTS if not experiment.turning or turn.rate > 0.0]

    def played(experiment: Experiment) -> dict[str, dict[str, Advice]]:
        record = loop_record(experiment, device, settings, latency=latency, turn=turn, span=span)
        seen = scan(Problem(record, device, settings), watched)
        length = float(record.step.sum()) * (1.0 - _BEGIN / PARTS)
        words = in_words(experiment, turn)
        found: dict[str, dict[str, Advice]] = {}
        for name, _ in pairs:
            shown = imitations(seen, name, _coefficients(name, selection, seen.columns), begin=_BEGIN)
            takes = {other: _takes(one, unsure.get(name), length, _SET.longest * span) for other, one in shown.items()}
            carried = selection.rivals.get(name, {})
            found[name] = {
                other: Advice(experiment, one.likeness, takes[other], words)
                for other, one in shown.items()
                if takes[other] < math.inf and (other in carried or one.likeness <= THRESHOLDS.scan.same)
            }
        return found

    shown = side_by_side(
        [partial(played, experiment) for experiment in able], lambda done: progress("experiments", done, len(able))
    )
    return [_simplest([found[name][other] for found in shown if other in found[name]], span) for name, other in pairs]


def _simplest(able: list[Advice], span: float) -> Advice:
    """Of what tells a pair apart that a record of `span` [s] did not, the simplest that does not take much longer."""

    def effort(one: Advice) -> float:
        assert one.experiment is not None
        assert one.takes is not None
        return one.experiment.effort * max(one.takes, span)

    return min(able, key=effort, default=Advice())


def _takes(shown: Imitation, covariance: Array | None, length: float, longest: float) -> float:
    """How long [s] an experiment has to last in which two effects differ as shown in `length` [s]; infinity where that
    is longer than `longest`.

    A difference of d² is known to 2 d; it has to be a tie's bound or more all the same.  The mean of a quadratic form
    is its value at the mean and the trace of form and covariance: so much of it may be there because the coefficients
    are not known exactly.  Where that is all, an experiment may take as long as any that is advised.
    """
    needed = (_SET.sure + math.sqrt(_SET.sure**2 + TIE)) ** 2 * length
    if needed >= longest * shown.left:
        return math.inf
    sure = shown.left - (0.0 if covariance is None else float(np.trace(shown.form @ covariance)))
    return longest if needed >= longest * sure else needed / sure


def _constants(selection: Selection, device: Device) -> dict[str, float]:
    """Of the device that is played: with the effects, or as they were without, or none, by which it still oscillates.

    Without its effect an observer takes a delay for a damping; then experiments tell what is not there.
    """
    before = dict(selection.before.settings.initial)
    candidates = ({**before, **constants_of(selection.after.observer)}, before)
    return next((one for one in candidates if _oscillates(one, device)), {})


def _oscillates(constants: Mapping[str, float], device: Device) -> bool:
    """Whether the springs hold the mass: without the effects, the observer may have ended at some that do not."""
    kxx, kyy, kxy = (
        constants.get(name, declared) for name, declared in zip(("kxx", "kyy", "kxy"), device.stiffness, strict=True)
    )
    return kxx > 0.0 and kxx * kyy > kxy**2


def loop_record(
    experiment: Experiment,
    device: Device,
    settings: ObserverSettings,
    *,
    latency: int,
    noise: float = 1.0,
    turn: Turn | None = None,
    span: float = 0.0,
) -> Record:
    """A record of the experiment on a device with the constants of `settings` and no effect.

    noise: times what the device declares; turn: how it turns, where it does, else as fast as any is turned; span: how
    long it turns at least [s], as far as that is worth its time.
    """
    omega0 = math.sqrt(device.target)
    scale = device.amplitude * device.target
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
    if experiment.turning:
        samples = max(samples, min(round(span * device.sample_rate), _SET.samples))
    turn = turn or turn_for(omega0, math.inf, 1.0 / omega0)
    t = np.arange(samples) * loop.h
    truth = loop.x.copy()
    truth[:4] = loop.x[:4] = 1.0, 0.0, 0.0, 0.0
    random = np.random.default_rng(0)
    added = noise * random.standard_normal((samples, 2)) * np.sqrt(loop.sense_noise)
    rates = experiment.turning * turn.rate / omega0 * np.sin(2.0 * math.pi / (turn.period * omega0) * t)
    stiffness = 1.0 + experiment.stiffness * np.sign(np.sin(t / _SET.stepping))
    sensed, drive = np.zeros((samples, 2)), np.zeros((samples, 2))
    experiment_block(loop, truth, Plan(rates, stiffness, added), sensed, drive)
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
