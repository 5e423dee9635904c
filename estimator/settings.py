"""What an observer and a controller are told: the declared device, the variant, the gain, the initial spread, the
holds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from estimator.effects.declaration import Effect
from estimator.errors import ModelError
from estimator.interface import Interface


class Variant(Enum):
    """The observers of TW I384198 B1 by what they estimate beside the motion."""

    SENSE = "sense"  # x ẋ y ẏ Φx Φy Ω: gyro parameters known (claims 1–10)
    GYRO = "gyro"  # x ẋ y ẏ Ω k d: sense offsets taken as zero (claims 11, 18)
    FULL = "full"  # all 13 (claims 12, 21)


class Gain(Enum):
    """Where the observer gain comes from."""

    STATIONARY = "stationary"  # derived once from the dynamics (claims 1, 5, 11, 18)
    EKF = "ekf"  # claims 3, 9, 14, 23
    FADING = "fading"  # EKF with fading memory (claims 4, 10, 15, 24)


class Sensed(Enum):
    """What a sense channel shows; the value is the number of times that the displacement is differentiated."""

    DISPLACEMENT = 0
    VELOCITY = 1
    ACCELERATION = 2


@dataclass(frozen=True)
class Device:
    """What the data sheet declares, normalised by the mass.

    sensed: what each channel shows, displacement where it is empty; the sense_gain of a channel that shows velocity or
    acceleration is in V/m all the same, of a vibration at ω0: its own gain times ω0 or ω0².  sense_unit: what a "volt"
    is called, where the sensor has another unit.

    stiffness [1/s²] and damping [1/s] are (xx, yy, xy), or one number for a single axis; sense_gain [V/m] and noise [V
    rms per sample] per axis; drive_gain [m/s² per drive unit] is 1 where the drive is given in m/s²; angular_gain is
    the rotation of the pattern over that of the board; own are effects beside the catalogue, which an observer may
    carry and a trace name like those in it; interface is the map of the sense channels, whose effect is the first of
    own.
    """

    sample_rate: float
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    amplitude: float
    sense_gain: tuple[float, ...]
    noise: tuple[float, ...]
    mass: float = 1.0
    drive_gain: float = 1.0
    target_stiffness: float | None = None
    angular_gain: float = 1.0
    sensed: tuple["Sensed", ...] = ()
    sense_unit: str = "V"
    own: tuple[Effect, ...] = ()
    interface: Interface | None = None

    @property
    def axes(self) -> int:
        """1 or 2."""
        return len(self.sense_gain)

    @property
    def target(self) -> float:
        """Target stiffness k [1/s²]: the one given, else the mean of the axes'."""
        if self.target_stiffness is not None:
            return self.target_stiffness
        return sum(self.stiffness[: self.axes]) / self.axes


@dataclass(frozen=True)
class Spread:
    """Standard deviations of the initial value.

    position, velocity: of the nominal amplitude; stiffness: of the target; damping: of the mean nominal damping;
    drive_gain: of the nominal; offset [V]; rate [rad/s].
    """

    position: float = 1.0
    velocity: float = 1.0
    offset: float = 0.02
    rate: float = 1.0
    stiffness: float = 0.05
    damping: float = 1.0
    drive_gain: float = 0.2


@dataclass(frozen=True)
class ProcessNoise:
    """How fast things wander: force [m/s²/√Hz]; the rest per √s, rate [rad/s], offset [V], stiffness and damping
    relative.
    """

    force: float = 0.0
    rate: float = 0.0
    offset: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    drive_gain: float = 0.0


@dataclass(frozen=True)
class ObserverSettings:
    """Variant, gain, memory [s] of the fading, initial values by name in SI (the rest from the device), spread, noise.

    effects: what the base model lacks and this observer carries, by name (`estimator.effects`), each with first
    initial values of its coefficients in SI (0 where not given); they are estimated with the rest.

    open_loop: nothing makes an ideal oscillator of the device, so that the angle is the integrated rate.
    by_loops: the run's angle is by the classic loops, to which a damping between the axes is a rate.
    reference: time [s] from which on the angle's uncertainty counts; what it was there is zero by definition.

    A stationary gain takes over from an EKF with fading memory one memory after `acquisition` [s]: it corrects by a
    constant share of what it sees, and would carry the errors of the initial value on for many memories.
    """

    variant: Variant = Variant.FULL
    gain: Gain = Gain.FADING
    memory: float = 0.5
    acquisition: float = 0.1
    initial: dict[str, float] = field(default_factory=dict)
    spread: Spread = field(default_factory=Spread)
    process_noise: ProcessNoise = field(default_factory=ProcessNoise)
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    reference: float = 0.0
    open_loop: bool = False
    by_loops: bool = False

    def __post_init__(self) -> None:
        if self.memory <= 0.0:
            raise ModelError(f"memory must be positive, got {self.memory} s")

    @property
    def takeover(self) -> float:
        """When a stationary gain takes over, s."""
        return self.acquisition + self.memory


@dataclass(frozen=True)
class ControllerSettings:
    """The holds around (9), all gains in units of ω0; rates in rad/s, forces in m/s².

    latency is in samples, force_quantum the force of one drive code, sense_quantum [V] of one sense code.  The virtual
    rotation is reversed every `virtual_reversal` seconds, 0: never.  dither_seed chooses the sequence of the dither;
    without one it is always the same.
    """

    latency: int
    force_quantum: float
    force_limit: float
    sense_quantum: float
    energy_gain: float = 0.01
    quadrature_gain: float = 0.01
    virtual_rotation: float = 0.0
    virtual_reversal: float = 0.0
    dither: float = 0.0
    dither_seed: int | None = None
    modulation: float = 0.0
    modulation_rate: float = 0.0
