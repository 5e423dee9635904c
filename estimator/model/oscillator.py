"""A single-axis oscillator with an unknown drive gain, for devices that are not two-axis gyros (`[device] axes = 1`).

ẍ + d ẋ + k x = b u
"""

from estimator.model.declaration import Constant, Model, Quantity, State
from estimator.model.symbols import b, d, k, phi_x, ux, vx, x

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
