"""SI at every boundary, scaled inside: time by ω0 = √k target, length by the nominal amplitude.

In SI the stiffness is about 1e8 1/s² and the position 1e-6 m; scaled, everything the covariance holds is of order one.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.effects.declaration import Coefficient, Parameter
from estimator.model.declaration import Model, Quantity
from estimator.settings import Device

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scaling:
    """Factors from scaled to SI.

    omega0 [rad/s]; length [m]; sense_gain [V/m] per axis (signed); drive_gain: nominal m/s² per unit of the drive
    channel; angular_gain: rotation of the pattern over that of the board; a scaled rate is the pattern's, one in SI
    the board's.
    """

    omega0: float
    length: float
    sense_gain: tuple[float, ...]
    drive_gain: float = 1.0
    angular_gain: float = 1.0

    @classmethod
    def of(cls, device: Device) -> "Scaling":
        """That of a device, by what it declares."""
        omega0 = math.sqrt(device.target)
        return cls(omega0, device.amplitude, device.sense_gain, device.drive_gain, device.angular_gain)

    @property
    def force(self) -> float:
        """m/s² per scaled unit of force."""
        return self.length * self.omega0**2

    @property
    def drive(self) -> float:
        """Drive channel units (m/s², N or V) per scaled unit of force."""
        return self.force / self.drive_gain

    def sense(self, axis: int) -> float:
        """Volts per scaled unit of position."""
        return self.sense_gain[axis] * self.length

    def coefficient(self, coefficient: Coefficient | Parameter) -> float:
        """SI value of one scaled unit of an effect's coefficient or parameter."""
        volts = abs(self.sense(0)) ** coefficient.volt if coefficient.volt else 1.0
        return volts * self.length**coefficient.length * self.omega0**-coefficient.time

    def state(self, model: Model) -> Array:
        """SI value of one scaled unit of each entry of the state vector, (states + constants,)."""
        factors = {
            Quantity.POSITION: self.length,
            Quantity.VELOCITY: self.length * self.omega0,
            Quantity.RATE: self.omega0 / self.angular_gain,
            Quantity.STIFFNESS: self.omega0**2,
            Quantity.DAMPING: self.omega0,
            Quantity.DRIVE_GAIN: self.drive_gain,
        }
        offsets = iter(range(model.axes))
        return np.array(
            [
                self.sense(next(offsets)) if item.quantity is Quantity.OFFSET else factors[item.quantity]
                for item in model.entries
            ]
        )
