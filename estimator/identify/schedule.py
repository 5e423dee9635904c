"""Drives that show an unknown oscillator: a search over all frequencies, then what its resonances need.

A table is rows of drive (n, 2) [m/s²] and the number of the piece to which each belongs: a piece in which the response
exceeds its limit is not driven to its end, and the ones behind it are.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.identify.model import Array

_LEVELS = (0.03, 0.6)  # of the largest drive, one after another
_FROM, _TO = 1.0 / 400.0, 0.42  # cycles a sample
_REACHED = 0.75  # of the limit, by a burst
_LASTS = 5.0  # times of decay after which nothing is left to see
_SEED = 20_260


class Lengths(NamedTuple):
    """Samples of each piece; free: decays between pieces, and ring_down: the last one, from the least that is played to
    the most, by how long the motion lasts.
    """

    quiet: int = 1500  # at rest, for the noise
    sweep: int = 6000
    decay: int = 2500
    burst: int = 2500
    pattern: int = 4000
    free: tuple[int, int] = (1500, 5000)
    ring_down: tuple[int, int] = (3000, 24_000)

    @property
    def search(self) -> int:
        """Rows of the table of a search."""
        return self.quiet + 2 * len(_LEVELS) * (self.sweep + self.decay)

    @property
    def measurement(self) -> int:
        """Rows of the table of a measurement, where the motion lasts longest."""
        bursts = 4 * (self.burst + self.free[1]) + self.burst + self.ring_down[1]
        return self.quiet + bursts + self.pattern + self.free[1]


LENGTHS = Lengths()


class Table(NamedTuple):
    """forces (n, 2) [m/s²]; pieces (n,); names of the pieces."""

    forces: Array
    pieces: NDArray[np.int32]
    names: tuple[str, ...]

    def rows_of(self, name: str) -> slice:
        """Where a piece stands."""
        rows = np.flatnonzero(self.pieces == self.names.index(name))
        return slice(int(rows[0]), int(rows[-1]) + 1)


@dataclass
class _Plan:
    parts: list[Array] = field(default_factory=list)
    names: list[str] = field(default_factory=list)

    def add(self, name: str, forces: Array) -> None:
        self.names.append(name)
        self.parts.append(forces)

    def rest(self, name: str, samples: int) -> None:
        self.add(name, np.zeros((samples, 2)))

    def table(self) -> Table:
        pieces = np.repeat(np.arange(len(self.parts)), [len(part) for part in self.parts]).astype(np.int32)
        return Table(np.concatenate(self.parts), pieces, tuple(self.names))


def search(largest: float, lengths: Lengths) -> Table:
    """Rest, then sweeps along x and along y over all frequencies, each with a free decay, harder and harder."""
    plan = _Plan()
    plan.rest("rest", lengths.quiet)
    rate, samples = np.log(_TO / _FROM), lengths.sweep
    at = np.arange(samples) / samples
    sweep = np.sin(2.0 * np.pi * _FROM * samples / rate * (np.exp(rate * at) - 1.0))
    for level in _LEVELS:
        for axis in range(2):
            forces = np.zeros((samples, 2))
            forces[:, axis] = level * largest * sweep
            plan.add(f"sweep {'xy'[axis]} {level:g}", forces)
            plan.rest(f"decay {'xy'[axis]} {level:g}", lengths.decay)
    return plan.table()


class Known(NamedTuple):
    """What a search has told, per sample: resonances (2,) [rad], decay rate of the amplitude [1/sample], gains (2,)
    [V per m/s²].
    """

    resonances: Array
    decay: float
    gains: Array


def measurement(known: Known, largest: float, limit_V: Array, lengths: Lengths) -> Table:
    """Bursts about the resonances along x and along y with free decays, a pseudo-random pattern on both axes, a small
    burst, and a long decay from as far as the limit lets the mass go.
    """
    plan, noise = _Plan(), np.random.default_rng(_SEED)
    lasting = int(_LASTS / max(known.decay, 1e-12))
    free = int(np.clip(lasting, *lengths.free))

    def burst(axis: int, reached: float) -> Array:
        return _burst(known, largest, limit_V, axis, reached, lengths.burst)

    plan.rest("rest", lengths.quiet)
    for axis in range(2):
        plan.add(f"burst {'xy'[axis]}", burst(axis, 0.5 * _REACHED))
        plan.rest(f"decay {'xy'[axis]}", free)
    pattern = np.sign(noise.standard_normal((lengths.pattern, 2)))
    # A random pattern moves a mass by √samples where a tone does by samples / 2.
    omega, steps = float(np.mean(known.resonances)), min(lengths.pattern, 1.0 / max(known.decay, 1e-12))
    most = 0.2 * limit_V * omega / (np.abs(known.gains) * np.sqrt(steps))
    plan.add("pattern", pattern * np.minimum(most, 0.9 * largest))
    plan.rest("decay of the pattern", free)
    for axis in range(2):
        plan.add(f"small burst {'xy'[axis]}", burst(axis, 0.15))
        plan.rest(f"small decay {'xy'[axis]}", free)
    both = burst(0, _REACHED) + burst(1, 0.6 * _REACHED)
    plan.add("large burst", np.clip(both, -largest, largest))
    plan.rest("ring-down", int(np.clip(lasting, *lengths.ring_down)))
    return plan.table()


def _burst(known: Known, largest: float, limit_V: Array, axis: int, reached: float, samples: int) -> Array:
    """A short sweep over both resonances along one axis, that would bring the mass to a share of the limit."""
    low, high = float(np.min(known.resonances)), float(np.max(known.resonances))
    steps = min(samples, 1.0 / max(known.decay, 1e-12))
    aside = np.pi / steps
    rate = (high - low + 2.0 * aside) / samples
    at = np.arange(samples)
    sweep = np.sin((low - aside) * at + 0.5 * rate * at**2)
    passing = min(np.sqrt(2.0 * np.pi / rate), steps)  # samples for which a resonance is driven in phase
    amplitude = 2.0 * np.mean((low, high)) * reached * limit_V[axis] / (abs(known.gains[axis]) * passing)
    forces = np.zeros((samples, 2))
    forces[:, axis] = min(float(amplitude), largest) * sweep
    return forces
