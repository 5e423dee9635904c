"""An unknown force as a random process: what is expected of it before the record is asked.

On each axis the sum of a slow part, of parts at the resonance, twice and three times it, whose amplitude and phase
wander within some cycles, and of a broad part.  A vibration makes any law of motion into such a force; the broad part
is for what does not follow the vibration.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag, expm, logm

from estimator.scaling import Array

HARMONICS = (1.0, 2.0, 3.0)
PARTS = 2 + len(HARMONICS)
_MEMBERS = 2 + 2 * len(HARMONICS)  # states of an axis


@dataclass(frozen=True)
class Latent:
    """variance (PARTS,) of the slow part, of each harmonic, of the broad part, scaled, alike on both axes; cycles: of
    the resonance, over which all but the broad part stay alike; frequency: of the resonance, scaled.
    """

    variance: tuple[float, ...]
    cycles: float
    frequency: float = 1.0

    def with_variance(self, part: int, value: float) -> "Latent":
        """The same with another variance of one part."""
        changed = tuple(value if index == part else old for index, old in enumerate(self.variance))
        return replace(self, variance=changed)


def _axis(latent: Latent) -> tuple[Array, Array, Array]:
    """Field, output and stationary covariance of the states of one axis."""
    decay = latent.frequency / (2.0 * np.pi * latent.cycles)
    slow, *middle, broad = latent.variance
    blocks, output, variance = [np.array([[-decay]])], [1.0], [slow]
    for harmonic, own in zip(HARMONICS, middle, strict=True):
        turn = harmonic * latent.frequency
        blocks.append(np.array([[-decay, turn], [-turn, -decay]]))
        output += [1.0, 0.0]
        variance += [own, own]
    blocks.append(np.array([[-latent.frequency]]))
    return block_diag(*blocks), np.array([*output, 1.0]), np.diag([*variance, broad])


@dataclass(frozen=True, eq=False)
class Augmented:
    """Motion and latent states together: the step, the covariance that it adds, what of the states is the force
    (axes, states) and what is seen (axes, states).
    """

    transition: Array
    noise: Array
    force: Array
    seen: Array


def augmented(latent: Latent, moved: Array, step: float, force_noise: float) -> Augmented:
    """With the motion's own step (states, states).  force_noise: density of a white force, scaled, on each axis."""
    matrix = np.real(logm(moved)) / step
    size = len(matrix)
    axes = size // 2
    total = size + axes * _MEMBERS
    whole = np.zeros((total, total))
    whole[:size, :size] = matrix
    density = np.zeros((total, total))
    force = np.zeros((axes, total))
    own, output, stationary = _axis(latent)
    for axis in range(axes):
        rows = slice(size + axis * _MEMBERS, size + (axis + 1) * _MEMBERS)
        whole[rows, rows] = own
        force[axis, rows] = output
        whole[2 * axis + 1, rows] = output
        density[rows, rows] = -(own @ stationary + stationary @ own.T)
        density[2 * axis + 1, 2 * axis + 1] = force_noise
    # Van Loan (IEEE Trans. Automatic Control 23(3), 1978).
    both = expm(np.block([[-whole, density], [np.zeros_like(whole), whole.T]]) * step)
    transition = both[total:, total:].T
    noise = transition @ both[:total, total:]
    seen = np.zeros((axes, total))
    seen[np.arange(axes), 2 * np.arange(axes)] = 1.0
    return Augmented(transition, 0.5 * (noise + noise.T), force, seen)
