"""A single-axis oscillator with an unknown drive gain, for devices that are not two-axis gyros (`[device] axes = 1`).

ẍ + d ẋ + k x = b u
"""

import sympy as sp

from estimator.model.declaration import Constant, Model, Quantity, State

x, vx = sp.symbols("x vx")
phi_x, k, d, b = sp.symbols("phi_x k d b")
ux = sp.Symbol("ux")

OSCILLATOR = Model(
    name="oscillator",
    axes=1,
    states=(State(x, "x", Quantity.POSITION), State(vx, "vx", Quantity.VELOCITY)),
    sense_constants=(Constant(phi_x, "phi_x", Quantity.OFFSET),),
    flow_constants=(
        Constant(k, "kxx", Quantity.STIFFNESS),
        Constant(d, "dxx", Quantity.DAMPING),
        Constant(b, "drive_gain_x", Quantity.DRIVE_GAIN),
    ),
    inputs=(ux,),
    field=(vx, -d * vx - k * x + b * ux),
    measurement=(x + phi_x,),
)
