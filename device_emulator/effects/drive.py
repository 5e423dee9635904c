"""What hidden effects do to the force on its way from the converter to the mass. Delay and slew are the chain's own."""

from enum import IntEnum

from device_emulator.effects.declaration import Declaration, HiddenCoefficient, limits, per_axis, switches


class DriveKind(IntEnum):
    """What acts on the drive, in no order that matters."""

    DRIVE_GAIN = 20
    DRIVE_MISALIGNMENT = 21
    DRIVE_DELAY = 22
    DRIVE_SATURATION = 23
    DRIVE_DEAD_BAND = 24
    DRIVE_SLEW = 25
    ELECTROSTATIC_DRIVE = 26
    DRIVE_POLARITY = 27


DECLARATIONS: dict[IntEnum, Declaration] = {
    DriveKind.DRIVE_GAIN: Declaration("ux -> (1 + hx) ux, uy -> (1 + hy) uy", per_axis("h", "1")),
    DriveKind.DRIVE_MISALIGNMENT: Declaration(
        "ux -> ux + mx uy, uy -> uy + my ux", (HiddenCoefficient("mx", "1"), HiddenCoefficient("my", "1"))
    ),
    DriveKind.DRIVE_DELAY: Declaration("u(t - tau)", (HiddenCoefficient("tux", "s"), HiddenCoefficient("tuy", "s"))),
    DriveKind.DRIVE_SATURATION: Declaration("ux -> clip(ux, -limit_x, limit_x)", limits("limit_", "m/s²")),
    DriveKind.DRIVE_DEAD_BAND: Declaration("ux -> ux - clip(ux, -width_x, width_x)", per_axis("width_", "m/s²")),
    DriveKind.DRIVE_SLEW: Declaration("|du/dt| <= slew, after every delay", limits("slew_", "m/s³")),
    DriveKind.ELECTROSTATIC_DRIVE: Declaration("ux -> ux + qx ux^2, uy -> uy + qy uy^2", per_axis("q", "s²/m")),
    DriveKind.DRIVE_POLARITY: Declaration("ux -> -ux where px = 1, uy -> -uy where py = 1", switches()),
}
