"""What hidden effects do to the force on its way from the converter to the mass. Delay and slew are the chain's own."""

from typing import Any

from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.catalogue import Kind


@compiled
def drive(effects: NDArray[Any], ux: float, uy: float) -> tuple[float, float]:
    """Force per unit mass (m/s²) that reaches the mass when the converter puts out ux, uy."""
    for effect in effects:
        kind, c = effect.kind, effect.c
        if kind == Kind.DRIVE_GAIN:
            ux, uy = (1.0 + c[0]) * ux, (1.0 + c[1]) * uy
        elif kind == Kind.DRIVE_MISALIGNMENT:
            ux, uy = ux + c[0] * uy, uy + c[1] * ux
        elif kind == Kind.DRIVE_SATURATION:
            ux, uy = min(max(ux, -c[0]), c[0]), min(max(uy, -c[1]), c[1])
        elif kind == Kind.DRIVE_DEAD_BAND:
            ux, uy = ux - min(max(ux, -c[0]), c[0]), uy - min(max(uy, -c[1]), c[1])
        elif kind == Kind.DRIVE_POLARITY:
            ux, uy = -ux if c[0] == 1.0 else ux, -uy if c[1] == 1.0 else uy
        elif kind == Kind.ELECTROSTATIC_DRIVE:
            ux, uy = ux + c[0] * ux * ux, uy + c[1] * uy * uy
    return ux, uy
