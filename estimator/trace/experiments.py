"""Experiments that separate effects: what is done to a device on the bench, and the record that it would leave."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from estimator.core.experiment import Plan, experiment_block
from estimator.observer import Observer
from estimator.record import Record
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings

CYCLES, SETTLED = 400, 0.5
"""Of the vibration, that an experiment is played for, and the share of them after which it has settled."""
FIRM = 0.1
"""Gain of the holds of amplitude and quadrature, of ω0: settled within tens of cycles."""
VIRTUAL, TURNED = 2e-3, 1e-3
"""Of ω0: a virtual rotation that turns the pattern more than once, and the largest rate of a common table."""
STEP, DITHER, SWING = 0.02, 3e-3, 0.3
"""Of the target stiffness, of k A, of the amplitude: large enough to show, within what drive and sense allow."""
MODULATION, TURNING, STEPPING = 200.0, 150.0, 120.0
"""Radians of the vibration to one of the modulation, the rate, the steps: the holds follow, and none is another's
multiple.
"""
PERIODS, LONGEST_TURN = 3.0, 40_000
"""Of the rate in a record, and samples of a turn that are played at most."""
DEARER = 2.0
"""Times as long a simpler experiment may take before several at once, or a turn by hand, are advised."""


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
        return DEARER ** (together + self.turning)


EXPERIMENTS = (
    Experiment("virtual_rotation", "impose a virtual rotation", virtual=VIRTUAL),
    Experiment("amplitude", "modulate the amplitude by 30 %", virtual=VIRTUAL, modulation=SWING),
    Experiment("dither", "dither the drive off the resonance", virtual=VIRTUAL, dither=DITHER),
    Experiment("stiffness", "step the target stiffness by 2 %", virtual=VIRTUAL, stiffness=STEP),
    Experiment(
        "together", "modulate the amplitude, dither and step the target stiffness",
        virtual=VIRTUAL, modulation=SWING, dither=DITHER, stiffness=STEP,
    ),
    Experiment("rate", "turn the gyro at a varying rate", virtual=VIRTUAL, turning=True),
    Experiment(
        "all",
        "modulate the amplitude, dither, step the target stiffness and turn the gyro",
        virtual=VIRTUAL, modulation=SWING, dither=DITHER, stiffness=STEP, turning=True,
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
    frequency = min(2.0 * math.pi * PERIODS / span, omega0 / TURNING)
    return Turn(min(TURNED * omega0, 0.5 * wander * math.sqrt(math.pi / frequency)), 2.0 * math.pi / frequency)


def experiment_called(name: str) -> Experiment | None:
    """The experiment of that name, None where there is none."""
    return next((experiment for experiment in EXPERIMENTS if experiment.name == name), None)


def in_words(experiment: Experiment, turn: Turn) -> str:
    """What is to be done in an experiment, and how the gyro is turned where it is."""
    return f"{experiment.words}: {turn.text}" if experiment.turning else experiment.words


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
        force_quantum=1e-6 * scale,
        force_limit=10.0 * scale,
        sense_quantum=0.1 * min(device.noise),
        energy_gain=FIRM,
        quadrature_gain=FIRM,
        virtual_rotation=experiment.virtual * omega0,
        dither=experiment.dither * scale,
        modulation=experiment.modulation,
        modulation_rate=omega0 / MODULATION,
    )
    loop = Observer(device, replace(settings, gain=Gain.EKF, effects={}), law)
    samples = int(CYCLES * 2.0 * math.pi / loop.h)
    if experiment.turning:
        samples = max(samples, min(round(span * device.sample_rate), LONGEST_TURN))
    turn = turn or turn_for(omega0, math.inf, 1.0 / omega0)
    t = np.arange(samples) * loop.h
    truth = loop.x.copy()
    truth[:4] = loop.x[:4] = 1.0, 0.0, 0.0, 0.0
    random = np.random.default_rng(0)
    added = noise * random.standard_normal((samples, 2)) * np.sqrt(loop.sense_noise)
    rates = experiment.turning * turn.rate / omega0 * np.sin(2.0 * math.pi / (turn.period * omega0) * t)
    stiffness = 1.0 + experiment.stiffness * np.sign(np.sin(t / STEPPING))
    sensed, drive = np.zeros((samples, 2)), np.zeros((samples, 2))
    experiment_block(loop, truth, Plan(rates, stiffness, added), sensed, drive)
    volts = np.array([loop.scaling.sense(axis) for axis in range(2)])
    step = np.full(samples, 1.0 / device.sample_rate)
    return Record(sensed * volts, (drive * loop.scaling.drive)[:, :, None], step)
