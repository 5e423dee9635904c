"""What a method makes of a record, and what every method is told of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.errors import ModelError
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Sensed


@dataclass(frozen=True)
class Reading:
    """Estimates after the samples `index` (rows,), SI, each from what has been sensed by then.

    angle (rows,) [rad], the rotation φ of the board, of which only changes mean something; rate (rows,) [rad/s], None
    where the method has none; parameters (rows,) by name, [1/s²] and [1/s].
    """

    index: NDArray[np.int64]
    angle: Array
    rate: Array | None = None
    parameters: Mapping[str, Array] = field(default_factory=dict)


def require_displacement(device: Device) -> None:
    """ModelError for a device whose channels show something else."""
    if any(sensed is not Sensed.DISPLACEMENT for sensed in device.sensed):
        raise ModelError("reads a displacement, the channels of this device show its velocity")


def displacement(sense: Array, device: Device) -> Array:
    """Raw signals as displacement (n, 2) [m]: volts over the known gain, offset and noise still in them; a velocity as
    the displacement a quarter of a cycle earlier, whose ellipse is the same.  Raises ModelError for a device of one
    axis, which has no angle.
    """
    if device.axes != 2:
        raise ModelError("an angle needs two axes, the device has one")
    shown = np.asarray(sense / np.array(device.sense_gain))
    if device.interface is None:
        return shown
    return np.column_stack([device.interface.inverse(axis, shown[:, axis]) for axis in range(2)])


def virtual_angle(index: NDArray[np.int64], device: Device, control: ControllerSettings | None) -> Array:
    """∫Ωv dt (rows,) [rad] up to the samples `index`: the rotation that the control law itself imposes, which every
    method may know.  Reversed every `virtual_reversal` seconds, first after half of that.
    """
    if control is None:
        return np.zeros(len(index))
    seconds = (index + 1) / device.sample_rate
    imposed, period = control.virtual_rotation, control.virtual_reversal
    if period == 0.0:
        return np.asarray(imposed * seconds)
    folded = (seconds + 0.5 * period) % (2.0 * period)
    return np.asarray(imposed * (np.minimum(folded, 2.0 * period - folded) - 0.5 * period))


def rotation(double: Array, index: NDArray[np.int64], device: Device, control: ControllerSettings | None) -> Array:
    """φ (rows,) [rad] from twice the pattern angle θ: the pattern lags the board, and what the control imposed on it
    is taken off.
    """
    theta = 0.5 * np.unwrap(double, period=2.0 * math.pi)
    return np.asarray((-theta - virtual_angle(index, device, control)) / device.angular_gain)


def carried_on(index: NDArray[np.int64], angle: Array, delay: int, over: int) -> Reading:
    """Angle of the samples `index` (rows,), each known `delay` samples late: carried on to then by its slope over the
    last `over` samples, where that is known.
    """
    earlier = np.searchsorted(index, index - over)
    known = index[earlier] == index - over
    slope = (angle[known] - angle[earlier[known]]) / over
    return Reading(index[known] + delay, angle[known] + delay * slope)


def samples_per_cycle(device: Device) -> float:
    """Samples in a period of the target oscillator."""
    return 2.0 * math.pi * device.sample_rate / math.sqrt(device.target)
