"""The innovation seen from the vibration: its parts in step with the motion, along and across the ellipse.

A residual at the resonance is spread over sidebands by modulation and rotation.  In a frame that turns with the pattern
and swings with its phase it stands still, and what it depends on can be asked.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.observer import Estimates
from estimator.scaling import Array
from estimator.thresholds import THRESHOLDS

_SET = THRESHOLDS.residual


@dataclass(frozen=True)
class Motion:
    """Of the estimated vibration at every sample (n,): unit phasor, amplitude [m], pattern angle θ [rad]."""

    phasor: NDArray[np.complex128]
    amplitude: Array
    angle: Array


@dataclass(frozen=True)
class Demodulated:
    """Means over blocks (b,) of whole cycles.

    components: V, by name, of the innovation ("in phase", "in quadrature" with the motion, each "along" and, with two
    axes, "across" the ellipse); length: samples a block.
    """

    components: dict[str, Array]
    amplitude: Array
    angle: Array
    length: int

    def mean(self, series: Array) -> Array:
        """Means (b,) of series (n,) over the same blocks."""
        return _block_means(series, self.length)


def motion(estimates: Estimates, samples: int, samples_per_cycle: float) -> Motion:
    """From the states recorded every so many samples, joined by the resonance's own phase.

    Raises ModelError when the states are further apart than half a cycle.
    """
    index = np.asarray(estimates.index)
    turn = 2.0 * math.pi / samples_per_cycle  # a sample, in radians
    if len(index) < 2 or float(np.max(np.diff(index))) > samples_per_cycle / 2.0:
        raise ModelError("the residual's phase needs the state at least twice a cycle; estimate with a smaller `every`")
    velocity = _natural_rate(estimates)
    phasors = [estimates.of("x") - 1j * estimates.of("vx") / velocity]
    if "y" in estimates.names:
        phasors.append(estimates.of("y") - 1j * estimates.of("vy") / velocity)
    x, y = phasors[0], phasors[1] if len(phasors) == 2 else np.zeros_like(phasors[0])
    theta = 0.5 * np.unwrap(np.arctan2(2.0 * np.real(x * np.conj(y)), np.abs(x) ** 2 - np.abs(y) ** 2))
    major = x * np.cos(theta) + y * np.sin(theta)
    every = np.arange(samples)
    phase = np.unwrap(np.angle(major) - turn * index)
    phasor = np.exp(1j * (np.interp(every, index, phase) + turn * every))
    return Motion(phasor, np.interp(every, index, np.abs(major)), np.interp(every, index, theta))


def demodulate(series: Array, moving: Motion, samples_per_cycle: float) -> Demodulated:
    """Of series (n, axes) in volts; gaps (NaN) count as nothing.

    Raises ModelError for a record of fewer than 32 blocks of four cycles.
    """
    length = max(round(_SET.block_cycles * samples_per_cycle), 1)
    if len(series) < _SET.blocks * length:
        cycles = round(_SET.blocks * _SET.block_cycles)
        raise ModelError(f"fewer than {cycles} cycles of the resonance are too few to see what the residual depends on")
    filled = np.nan_to_num(series)
    carrier = 2.0 * np.conj(moving.phasor)
    sides = {"along": filled[:, 0]}
    if series.shape[1] == 2:
        cos, sin = np.cos(moving.angle), np.sin(moving.angle)
        sides = {
            "along": filled[:, 0] * cos + filled[:, 1] * sin,
            "across": filled[:, 1] * cos - filled[:, 0] * sin,
        }
    components: dict[str, Array] = {}
    for side, values in sides.items():
        components[f"in phase, {side}"] = _block_means(values * np.real(carrier), length)
        components[f"in quadrature, {side}"] = _block_means(values * np.imag(carrier), length)
    return Demodulated(components, _block_means(moving.amplitude, length), _block_means(moving.angle, length), length)


def _natural_rate(estimates: Estimates) -> float:
    """ω that makes position and velocity equally large, rad/s."""
    position = np.mean(estimates.of("x") ** 2)
    velocity = np.mean(estimates.of("vx") ** 2)
    if "y" in estimates.names:
        position += np.mean(estimates.of("y") ** 2)
        velocity += np.mean(estimates.of("vy") ** 2)
    return float(np.sqrt(velocity / position)) if position > 0.0 and velocity > 0.0 else 1.0


def _block_means(series: Array, length: int) -> Array:
    blocks = len(series) // length
    return np.asarray(np.mean(series[: blocks * length].reshape(blocks, length), axis=1))
