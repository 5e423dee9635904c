"""What hidden effects do to the force on its way from the converter to the mass. Delay and slew are the chain's own."""

from device_emulator.effects.declaration import Declaration, HiddenCoefficient, limits, per_axis, switches

DECLARATIONS: dict[str, Declaration] = {
    "drive_gain": Declaration("ux -> (1 + hx) ux, uy -> (1 + hy) uy", per_axis("h", "1")),
    "drive_misalignment": Declaration(
        "ux -> ux + mx uy, uy -> uy + my ux", (HiddenCoefficient("mx", "1"), HiddenCoefficient("my", "1"))
    ),
    "drive_delay": Declaration("u(t - tau)", (HiddenCoefficient("tux", "s"), HiddenCoefficient("tuy", "s"))),
    "drive_saturation": Declaration("ux -> clip(ux, -limit_x, limit_x)", limits("limit_", "m/s²")),
    "drive_dead_band": Declaration("ux -> ux - clip(ux, -width_x, width_x)", per_axis("width_", "m/s²")),
    "drive_slew": Declaration("|du/dt| <= slew, after every delay", limits("slew_", "m/s³")),
    "electrostatic_drive": Declaration("ux -> ux + qx ux^2, uy -> uy + qy uy^2", per_axis("q", "s²/m")),
    "drive_polarity": Declaration("ux -> -ux where px = 1, uy -> -uy where py = 1", switches()),
}
