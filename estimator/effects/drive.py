"""A drive chain that pushes otherwise than commanded.  As forces: what is applied beyond the command."""

import sympy as sp

from estimator.effects.declaration import Coefficient, Effect, Undone
from estimator.model.gyro import ux, uy

hx, hy, mx, my = sp.symbols("hx hy mx my")

DRIVE_GAIN = Effect(
    name="drive_gain",
    title="Drive gain of each axis",
    coefficients=(Coefficient(hx, "hx", 0.05), Coefficient(hy, "hy", 0.05)),
    force=(hx * ux, hy * uy),
    source="u → G u; IEEE Std 1431",
    signature="scales with the drive only",
    undone=Undone.INVERT,
    look_alikes={"stiffness and damping": "steps of the target stiffness"},
)

DRIVE_MISALIGNMENT = Effect(
    name="drive_misalignment",
    title="Each drive pushes the other axis too",
    coefficients=(Coefficient(mx, "mx", 0.05), Coefficient(my, "my", 0.05)),
    force=(mx * uy, my * ux),
    source="forcer misalignment; IEEE Std 1431",
    signature="scales with the other axis' drive",
    undone=Undone.INVERT,
)
