"""What a law may speak of, beside its own coefficients and parameters."""

from typing import NamedTuple

from estimator.custom.unit import FORCE, KELVIN, METRE, NUMBER, PER_SECOND, SECOND, SPEED, Unit


class Quantity(NamedTuple):
    """Its unit, what it is, and whether a single axis has it."""

    unit: Unit
    meaning: str
    single: bool = True


QUANTITIES = {
    "x": Quantity(METRE, "displacement along x"),
    "y": Quantity(METRE, "displacement along y", single=False),
    "vx": Quantity(SPEED, "velocity along x"),
    "vy": Quantity(SPEED, "velocity along y", single=False),
    "ux": Quantity(FORCE, "drive along x, per unit mass"),
    "uy": Quantity(FORCE, "drive along y, per unit mass", single=False),
    "r": Quantity(METRE, "distance from rest, √(x² + y²)"),
    "v": Quantity(SPEED, "speed, √(vx² + vy²)"),
    "rate": Quantity(PER_SECOND, "rate of rotation", single=False),
    "t": Quantity(SECOND, "time since the first sample"),
    "T": Quantity(KELVIN, "measured temperature, less its first reading"),
    "amplitude": Quantity(METRE, "[device] amplitude_m, a constant"),
    "omega0": Quantity(PER_SECOND, "target frequency in rad/s, a constant"),
    "orientation": Quantity(NUMBER, "angle of the line of vibration; as sin or cos of an even multiple", single=False),
    "phase": Quantity(NUMBER, "phase of the vibration, 0 where it turns; as sin or cos of an even multiple"),
}
"""By name."""

ANGLES = ("orientation", "phase")
"""Known but for half a turn, so that only their even multiples mean anything."""
