"""What the page of a trace is made of."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimator import diagnosis as traced
from estimator.missing_force.result import MissingForce
from estimator.record import Record
from estimator.residual.spectrum import density
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from hil.records.diagnosis import Diagnosis


@dataclass(frozen=True)
class Material:
    """The engine's answer with its arrays, the same as written, and what it is an answer to."""

    found: traced.Diagnosis
    diagnosis: Diagnosis
    record: Record
    device: Device
    settings: ObserverSettings
    missing_force: MissingForce | None = None

    @property
    def sample_rate_Hz(self) -> float:
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
        frequency, before = density(self.found.residual_before[rows], self.sample_rate_Hz)
        _, after = density(self.found.residual_after[rows], self.sample_rate_Hz)
        return frequency, before, after
