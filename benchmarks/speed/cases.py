"""What is timed: the variants, and the full one with effects, on one record of S-slow's closed form."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from estimator.observer import Observer
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, ObserverSettings, ProcessNoise, Spread, Variant

OMEGA0, AMPLITUDE, RATE_HZ, GAIN, NOISE = 2.0 * math.pi * 200.0, 1e-4, 4000.0, -890.0, 8.9e-5
SAMPLES = 5000
DEVICE = Device(
    sample_rate=RATE_HZ,
    stiffness=(OMEGA0**2, OMEGA0**2, 0.0),
    damping=(1.2, 1.2, 0.0),
    amplitude=AMPLITUDE,
    sense_gain=(GAIN, GAIN),
    noise=(NOISE, NOISE),
    target_stiffness=OMEGA0**2,
)
CONTROL = ControllerSettings(latency=1, force_quantum=3e-4, force_limit=10.0, sense_quantum=1e-5, virtual_rotation=3.0)


def record() -> tuple[Array, Array]:
    """Sense (n, 2) in volts and drive (n, 2) in m/s²: a vibration that is held, and noise."""
    rng = np.random.default_rng(0)
    t = np.arange(SAMPLES) / RATE_HZ
    z = np.exp(-1.5j * t) * np.cos(OMEGA0 * t)
    sense = GAIN * AMPLITUDE * np.column_stack([z.real, z.imag]) + NOISE * rng.standard_normal((SAMPLES, 2))
    speed = -OMEGA0 * AMPLITUDE * np.exp(-1.5j * t) * np.sin(OMEGA0 * t)
    drive = 1.2 * np.column_stack([speed.real, speed.imag]) + 0.01 * rng.standard_normal((SAMPLES, 2))
    return sense, drive


@dataclass(frozen=True)
class Case:
    """An observer with fading memory; against_slow: beside filterpy and NumPy."""

    name: str
    variant: Variant
    effects: tuple[str, ...] = ()
    against_slow: bool = False
    record: tuple[Array, Array] = field(default_factory=record)

    @property
    def settings(self) -> ObserverSettings:
        """As S-slow's, with no offset where none is estimated."""
        offset = 0.0 if self.variant is Variant.GYRO else 0.009
        return ObserverSettings(
            variant=self.variant,
            memory=1.0,
            spread=Spread(offset=offset, rate=2.0),
            process_noise=ProcessNoise(force=1e-6, rate=1.0),
            effects={name: {} for name in self.effects},
        )

    def observer(self) -> Observer:
        """A new one."""
        return Observer(DEVICE, self.settings, CONTROL)

    def runner(self, block: int) -> Callable[[int], float]:
        """Seconds that so many samples take in blocks of `block`, one observer going on over the record."""
        observer, (sense, drive) = self.observer(), self.record
        at = 0

        def run(samples: int) -> float:
            nonlocal at
            begun = time.thread_time()
            for _ in range(samples // block):
                if at + block > len(sense):
                    at = 0
                part = slice(at, at + block)
                observer.run(sense[part], drive[part], every=block)
                at += block
            return time.thread_time() - begun

        return run

    def ticker(self) -> Callable[[int], float]:
        """Seconds that so many samples of a closed loop take, control law included."""
        observer, (sense, drive) = self.observer(), self.record
        codes = np.column_stack(
            [np.rint(sense / CONTROL.sense_quantum), np.rint(drive / CONTROL.force_quantum)]
        ).tolist()
        at = 0

        def run(samples: int) -> float:
            nonlocal at
            begun = time.thread_time()
            for _ in range(samples):
                observer.tick(*codes[at])
                at = (at + 1) % len(codes)
            return time.thread_time() - begun

        return run


CASES = (
    Case("7 states", Variant.SENSE),
    Case("11 states", Variant.GYRO),
    Case("13 states", Variant.FULL, against_slow=True),
    Case("13 states, 1 effect", Variant.FULL, ("cubic_isotropic",)),
    Case("13 states, 2 effects", Variant.FULL, ("cubic_stiffness", "nonlinear_damping")),
    Case("13 states, 4 effects", Variant.FULL, ("cubic_stiffness", "nonlinear_damping", "drive_gain", "sense_gain")),
)
