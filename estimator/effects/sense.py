"""A sense chain that shows something else than the displacement."""

import sympy as sp

from estimator.effects.declaration import Coefficient, Effect, Undone
from estimator.model.gyro import ux, uy, x, y

gy, ey, ex, a2x, a2y, a3x, a3y, fdx, fdy = sp.symbols("gy ey ex a2x a2y a3x a3y fdx fdy")

SENSE_GAIN = Effect(
    name="sense_gain",
    title="Sense gain of y beside that of x",
    coefficients=(Coefficient(gy, "gy", 0.02),),
    sense=(sp.Integer(0), gy * y),
    source="Actuators 2025, 14, 275: detection-gain asymmetry",
    signature="error ½ g sin 2θ in the angle itself",
    undone=Undone.MAP,
    look_alikes={"damping mismatch": "its error grows with time"},
)

SENSE_CROSS_COUPLING = Effect(
    name="sense_cross_coupling",
    title="Each axis senses some of the other",
    coefficients=(Coefficient(ex, "ex", 0.02), Coefficient(ey, "ey", 0.02)),
    sense=(ex * y, ey * x),
    source="electrode misalignment; IEEE Std 1431",
    signature="error ½ ε (1 + cos 2θ) in the angle",
    undone=Undone.MAP,
)

SENSE_QUADRATIC = Effect(
    name="sense_quadratic",
    title="Quadratic sense characteristic",
    coefficients=(Coefficient(a2x, "a2x", 0.02, -1), Coefficient(a2y, "a2y", 0.02, -1)),
    sense=(a2x * x**2, a2y * y**2),
    source="parallel-plate capacitance to second order",
    signature="a shift and a line at 2ω that do not move with the drive",
    undone=Undone.MAP,
    look_alikes={"quadratic_stiffness": "amplitude steps"},
)

SENSE_CUBIC = Effect(
    name="sense_cubic",
    title="Cubic sense characteristic",
    coefficients=(Coefficient(a3x, "a3x", 0.02, -2), Coefficient(a3y, "a3y", 0.02, -2)),
    sense=(a3x * x**3, a3y * y**3),
    source="comb or parallel-plate capacitance to third order",
    signature="a line at 3ω without a pull of the frequency",
    undone=Undone.MAP,
    look_alikes={"cubic_stiffness": "pulls the frequency with the amplitude"},
)

DRIVE_FEEDTHROUGH = Effect(
    name="drive_feedthrough",
    title="Drive seen by the sense electrodes",
    coefficients=(Coefficient(fdx, "fdx", 0.05, 0, 2), Coefficient(fdy, "fdy", 0.05, 0, 2)),
    sense=(fdx * ux, fdy * uy),
    source="parasitic capacitance between drive and sense combs",
    signature="innovation follows the drive without delay",
    undone=Undone.MAP,
    look_alikes={"drive_gain": "dither off the resonance"},
)
