"""(b) The pattern angle by formula (11) on the raw signals, without an observer.

    tan 2θ = 2 (k x y + ẋẏ) / (k (x² − y²) + ẋ² − ẏ²)                   (11); Friedland & Hutton, IEEE TAC 23(4), 1978

x, y are the sense voltages over their gain.  The velocities are central differences; that a difference of a sine over
two samples is too small by sin(ω0 h)/ω0 h is put right.  With an offset Φ the angle ripples at the frequency of the
vibration by Φ over the amplitude.  `cycles` averages numerator and denominator over so many periods of the target
oscillator, which takes the ripple away but for Φ² over the amplitude squared, and makes up for the delay by the angle's
slope; 0 is the formula sample by sample.
"""

import math

import numpy as np

from estimator.errors import ModelError
from estimator.prior_art.reading import Reading, carried_on, displacement, rotation, samples_per_cycle
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device


def read(sense: Array, device: Device, control: ControllerSettings | None = None, *, cycles: int = 0) -> Reading:
    """Angle over a record: sense (n, 2) in volts, NaN where lost.  Raises ModelError for less than one window."""
    position = displacement(sense, device)
    k = device.target
    step = math.sqrt(k) / device.sample_rate
    x, y = position[1:-1].T
    vx, vy = (position[2:] - position[:-2]).T * (math.sqrt(k) / (2.0 * math.sin(step)))
    numerator, denominator = 2.0 * (k * x * y + vx * vy), k * (x**2 - y**2) + vx**2 - vy**2
    index = np.arange(1, len(sense) - 1)
    length = max(round(cycles * samples_per_cycle(device)), 1)
    if len(index) < length:
        raise ModelError(f"{len(sense)} samples are less than {cycles} cycles; give a longer record")
    window = np.full(length, 1.0 / length)
    numerator, denominator = (np.convolve(values, window, "valid") for values in (numerator, denominator))
    # The velocity in the middle of three samples is known after the third.
    index = index[length - 1 :] + 1
    known = np.isfinite(numerator)
    middle = index[known] - 1 - length // 2
    angle = rotation(np.arctan2(numerator[known], denominator[known]), middle, device, control)
    if cycles == 0:
        return Reading(index[known], angle)
    return carried_on(middle, angle, 1 + length // 2, length)


def read_components(streams: Array, device: Device, control: ControllerSettings | None = None) -> Reading:
    """The same of demodulated streams (n, 4): x and y in phase, then both in quadrature, in volts, NaN where lost;
    Lynch's S over R is the tangent of twice the angle.
    """
    x, y = ((streams[:, axis] + 1j * streams[:, 2 + axis]) / device.sense_gain[axis] for axis in range(2))
    double = np.arctan2(2.0 * (x * y.conj()).real, np.abs(x) ** 2 - np.abs(y) ** 2)
    index = np.flatnonzero(np.isfinite(double))
    return Reading(index, rotation(double[index], index, device, control))
