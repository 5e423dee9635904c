"""What an observer and a controller of one's own are, in Python: `hil.Observer`, `hil.Controller`.

    class Mine:
        def __init__(self, device: hil.DeclaredDevice) -> None: ...
        def observe(self, sense, applied, imposed) -> hil.Estimate: ...
        def control(self, estimate, on) -> hil.Drive: ...

A class with the first method is an observer, with the second a controller; with both, and named in both places of the
bench file, it has one instance that does both.  All units are SI, the drive a force per mass.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

from estimator.settings import ControllerSettings, Device
from hil.wire.errors import WireError

Pair = tuple[float, float]
_UNSAID = (math.nan, math.nan)
_NOTHING: Mapping[str, float] = {}


@dataclass(frozen=True)
class DeclaredDevice:
    """The device as the bench file declares it, and what its board says of its codes.

    stiffness_per_s2 and damping_per_s are (xx, yy, xy) per unit mass; target_stiffness_per_s2 is that of the controlled
    oscillator, amplitude_m what is to be held; sense_gain_V_per_m (2,) is signed, V per m/s where sense_order is 1;
    noise_V the rms of a sense sample; latency: samples from one to the interval in which the drive computed from it
    acts; no drive may be larger than drive_limit_mps2 on either axis; angular_gain is the rotation of the pattern over
    that of the board; virtual_rotation_rad_s what [controller] asks a controller to impose, and to reverse every
    virtual_reversal_s, the first time after half of it, 0: never.
    """

    sample_rate_Hz: float
    latency: int
    mass_kg: float
    stiffness_per_s2: tuple[float, float, float]
    damping_per_s: tuple[float, float, float]
    target_stiffness_per_s2: float
    amplitude_m: float
    sense_gain_V_per_m: Pair
    sense_order: int
    noise_V: float
    sense_scale_V: float
    drive_scale_mps2: float
    drive_limit_mps2: float
    angular_gain: float
    virtual_rotation_rad_s: float
    virtual_reversal_s: float

    @classmethod
    def of(cls, device: Device, control: ControllerSettings) -> "DeclaredDevice":
        """The device as an estimator has it, of two axes."""
        (kxx, kyy, kxy), (dxx, dyy, dxy) = device.stiffness, device.damping
        order = device.sensed[0].value if device.sensed else 0
        gain_x, gain_y = (gain / math.sqrt(device.target) ** order for gain in device.sense_gain)
        return cls(
            sample_rate_Hz=device.sample_rate,
            latency=control.latency,
            mass_kg=device.mass,
            stiffness_per_s2=(kxx, kyy, kxy),
            damping_per_s=(dxx, dyy, dxy),
            target_stiffness_per_s2=device.target,
            amplitude_m=device.amplitude,
            sense_gain_V_per_m=(gain_x, gain_y),
            sense_order=order,
            noise_V=device.noise[0],
            sense_scale_V=control.sense_quantum,
            drive_scale_mps2=control.force_quantum,
            drive_limit_mps2=control.force_limit,
            angular_gain=device.angular_gain,
            virtual_rotation_rad_s=control.virtual_rotation,
            virtual_reversal_s=control.virtual_reversal,
        )


class Estimate(NamedTuple):
    """What an observer makes of a sample.

    x, vx, y, vy: displacement and velocity, m and m/s; rate [rad/s]; angle [rad]: rotation since the first sample,
    +∫ rate dt, unwrapped, with what the drive turned taken off.

    The rest may be left out.  angle_u: standard uncertainty of the angle; constants: by the names of the bench's own
    observer (phi_x, phi_y [V], kxx, kyy, kxy [1/s²], dxx, dyy, dxy [1/s], coefficients of effects), the declared ones
    where they are left out; deviation: standard deviations, by the same names and x, vx, y, vy, rate; innovation [V]:
    measured less predicted from the samples before, innovation_deviation what it is expected to be; energy_ratio: of
    the vibration over its set point; quadrature_ratio: √k (x vy - y vx) over the energy.
    """

    x: float
    vx: float
    y: float
    vy: float
    rate: float
    angle: float
    angle_u: float = math.nan
    constants: Mapping[str, float] = _NOTHING
    deviation: Mapping[str, float] = _NOTHING
    innovation: Pair = _UNSAID
    innovation_deviation: Pair = _UNSAID
    energy_ratio: float = math.nan
    quadrature_ratio: float = math.nan


class TrimVoltages(NamedTuple):
    """Trim electrodes that the bench file declares, one entry each, and the voltages that act: known input.

    volts: in the middle of the interval that ends at the sample, as they settle; softening and softening_u
    [1/s²/V²]: what V² takes off of (kxx, kyy, kxy), as declared, and its standard uncertainty; settling_s: time
    constant by which a voltage follows its output; softened [1/s²]: what all of them take off of (kxx, kyy, kxy) now.
    """

    volts: tuple[float, ...]
    softening: tuple[tuple[float, float, float], ...]
    softening_u: tuple[tuple[float, float, float], ...]
    settling_s: tuple[float, ...]
    softened: tuple[float, float, float]


class Drive(NamedTuple):
    """Force per mass [m/s²] for the interval that begins `latency` samples on, and the rotation [rad/s] of the pattern
    that it imposes, for the bench's own observer to take off.
    """

    ux: float
    uy: float
    virtual_rotation: float = 0.0


@runtime_checkable
class Observer(Protocol):
    """Made with a `DeclaredDevice`; called at every sample, in order.

    One that has a method `trimmed(trims: TrimVoltages)` too is told of trim voltages, before `observe`: at the first
    sample, and wherever one has changed.  Without it a bench file with [trim] electrodes is refused.
    """

    def observe(self, sense: Pair, applied: Pair, imposed: float) -> Estimate:
        """sense (2,) [V], NaN where the sample was lost; applied (2,) [m/s²]: the drive over the interval that ends at
        the sample; imposed [rad/s]: the virtual rotation of the pattern by it, which is no turn of the board; it has
        the sign of a rate, which turns the azimuth of the pattern by minus as much.
        """
        ...


@runtime_checkable
class Controller(Protocol):
    """Made with a `DeclaredDevice`; called behind the observer, its own or the bench's, at every sample."""

    def control(self, estimate: Estimate, on: bool) -> Drive | Sequence[float]:
        """The drive: a `Drive`, or two numbers, within drive_limit_mps2.  on: whether it will be applied."""
        ...


class PluginError(WireError):
    """A plug-in did what it must not: raised, said what is no number, drove beyond the limit, took too long.

    The message is one line that names it.
    """
