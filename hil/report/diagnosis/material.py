"""What the page of a trace is made of."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimator import diagnosis as traced
from estimator.missing_force.result import MissingForce
from estimator.observer import Observer
from estimator.record import Record
from estimator.residual.demodulation import Demodulated, Motion, demodulate, motion
from estimator.residual.spectrum import density
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from hil.records.diagnosis import Diagnosis

_FEWEST_CYCLES = 160.0  # of a record whose residual is shown against the motion


@dataclass(frozen=True)
class Material:
    """The engine's answer with its arrays, the same as written, and what it is an answer to."""

    found: traced.Diagnosis
    diagnosis: Diagnosis
    record: Record
    device: Device
    settings: ObserverSettings
    bench_text: str
    missing_force: MissingForce | None = None

    @property
    def sample_rate_Hz(self) -> float:
        """Mean sampling rate."""
        return 1.0 / float(np.mean(self.record.step))

    @property
    def resonance_Hz(self) -> float:
        """Of the target, or the declared one."""
        return math.sqrt(self.device.target) / (2.0 * math.pi)

    @property
    def changed(self) -> bool:
        """Whether there is an after that differs from the before."""
        return bool(self.found.effects)

    @property
    def fits(self) -> tuple[traced.Fit, traced.Fit, traced.Fit, traced.Fit]:
        """Fitted part before and after, held-out part before and after."""
        found = self.found
        return found.before, found.after, found.held_out_before, found.held_out_after

    @cached_property
    def settled(self) -> int:
        """First sample that counts: a fifth of the fitted part, at most two memories, is left to the observer."""
        memory = 2.0 * self.settings.memory * self.sample_rate_Hz
        return int(min(memory, self.found.split / 5))

    @cached_property
    def held_out_densities(self) -> tuple[Array, Array, Array]:
        """Frequency (m,), density (m, axes) V²/Hz before and after, of the part that the choice never saw."""
        rows = slice(self.found.split, None)
        frequency, before = density(self.found.residual_before.innovation[rows], self.sample_rate_Hz)
        _, after = density(self.found.residual_after.innovation[rows], self.sample_rate_Hz)
        return frequency, before, after

    @cached_property
    def moving(self) -> Motion | None:
        """The vibration as the model as it was sees it; None where there is too little of it, or nothing moves."""
        cycle = self.sample_rate_Hz / self.resonance_Hz
        if (len(self.record) - self.settled) < _FEWEST_CYCLES * cycle:
            return None
        record = self.record
        every = max(int(cycle / 4.0), 1)
        estimates = Observer(self.device, self.settings).run(record.sense, record.drive, step=record.step, every=every)
        if not np.all(np.isfinite(estimates.state)):
            return None
        return motion(estimates, len(record), cycle)

    def demodulated(self, residual: traced.Residual) -> Demodulated | None:
        """A residual in step with the vibration, from where the observer has settled."""
        if self.moving is None:
            return None
        rows = slice(self.settled, None)
        seen = Motion(self.moving.phasor[rows], self.moving.amplitude[rows], self.moving.angle[rows])
        return demodulate(residual.innovation[rows], seen, self.sample_rate_Hz / self.resonance_Hz)
