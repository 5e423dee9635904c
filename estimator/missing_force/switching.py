"""An offset of two levels, as of a trap that takes a charge and gives it back: when it is on which.

The path is found beside the vibration, by Viterbi, with levels, noise and frequency of changes from the path itself.
"""

from dataclasses import dataclass, replace

import numpy as np

from estimator.core.series import likeliest_path
from estimator.errors import ModelError
from estimator.missing_force.latent import Latent
from estimator.missing_force.linear import Linear
from estimator.missing_force.smoother import smooth
from estimator.scaling import Array

_NOTHING = 1e-14  # variance of a part that is not there
_AROUND = 3  # times that path and vibration are found beside one another
_TURNS = 12
_OFTEN = 2.0  # cycles on a level, in the mean, below which it is a vibration


@dataclass(frozen=True, eq=False)
class Levels:
    """path (n, axes): −1 or 1, 0 on an axis of a single level; half (axes,): half of what is between the two, scaled;
    flips (axes,): how often they change.
    """

    path: Array
    half: Array
    flips: tuple[int, ...]


def levels_of(linear: Linear, latent: Latent, known: Array, force_noise: float) -> Levels:
    """Levels of the readings; known (n, states): what is known to push besides the drive."""
    n, axes = linear.sense.shape
    path, half, flips = np.zeros((n, axes)), np.zeros(axes), [0] * axes
    # A force that wanders would follow a level: what is left of it keeps step with the vibration.
    stiff = replace(latent, variance=(_NOTHING, latent.variance[1], *(_NOTHING for _ in latent.variance[2:])))
    cycle = 2.0 * np.pi / linear.step
    for _ in range(_AROUND):
        try:
            seen = smooth(replace(linear, sense=linear.sense - half * path), stiff, known, force_noise)
        except ModelError:
            return Levels(np.zeros((n, axes)), np.zeros(axes), (0,) * axes)
        for axis in range(axes):
            left = linear.sense[:, axis] - linear.offset[axis] - seen.motion[:, 2 * axis]
            path[:, axis], half[axis], flips[axis] = _two_levels(left, cycle)
        if not any(flips):
            break
    return Levels(path, half, tuple(flips))


def _two_levels(left: Array, cycle: float) -> tuple[Array, float, int]:
    """Path (n,) of a series about two levels, half their distance, how often it changes; zeros where one level says as
    much.
    """
    nothing = np.zeros(len(left)), 0.0, 0
    there = np.isfinite(left)
    if not there.any():  # the smoother could not follow the axis
        return nothing
    values = np.where(there, left, 0.0)
    kernel = np.ones(max(round(2.0 * cycle), 1))
    weight = np.maximum(np.convolve(there.astype(float), kernel, "same"), 1.0)
    slow = np.convolve(values, kernel, "same") / weight
    middle, half = float(np.median(slow)), float(np.std(slow))
    variance = float(np.var((values - slow)[there]))
    if not half > 0.0 or not variance > 0.0:
        return nothing
    often = 1.0 / (20.0 * cycle)
    path = np.zeros(len(left), dtype=np.int64)
    for _ in range(_TURNS):
        before = path
        path = likeliest_path(values, there, (middle - half, middle + half), variance, often)
        upper = path == 1
        if min(np.count_nonzero(upper), np.count_nonzero(~upper)) < 2.0 * cycle:
            return nothing
        high, low = float(np.mean(values[there & upper])), float(np.mean(values[there & ~upper]))
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        variance = float(np.mean((values - np.where(upper, high, low))[there] ** 2))
        changes = int(np.count_nonzero(np.diff(path)))
        often = max(changes, 1) / len(path)
        if np.array_equal(before, path):
            break
    n = np.count_nonzero(there)
    gained = n * np.log(float(np.var(values[there])) / variance)
    if (
        not half > 0.0
        or not changes
        or len(path) < _OFTEN * cycle * changes
        or gained < 2.0 * (changes + 2) * np.log(n)
    ):
        return nothing
    return np.where(upper, 1.0, -1.0), half, changes
