"""A path that is late.  Exact: the flow carries state and drive over the delay."""

from estimator.effects.declaration import Coefficient, Compensation, Delayed, Effect
from estimator.model.formula import symbols

tsx, tsy, tux, tuy = symbols("tsx tsy tux tuy")

SENSE_DELAY = Effect(
    name="sense_delay",
    number=16,
    title="What is sensed is late",
    coefficients=(Coefficient(tsx, "tsx", 0.1, 0, 1), Coefficient(tsy, "tsy", 0.1, 0, 1)),
    delayed=Delayed.SENSE,
    source="V(t) = S x(t − τ): demodulator and filter delay; Actuators 2025, 14, 275",
    signature="false quadrature τ ω sin 2θ where the axes differ",
    compensation=Compensation.MAP,
    look_alikes={"drive_delay": "a varying rate"},
)

DRIVE_DELAY = Effect(
    name="drive_delay",
    number=17,
    title="The drive acts late",
    coefficients=(Coefficient(tux, "tux", 0.1, 0, 1), Coefficient(tuy, "tuy", 0.1, 0, 1)),
    delayed=Delayed.DRIVE,
    source="u(t − τ): drive chain and transport delay; Actuators 2025, 14, 275",
    signature="a damping that is not there, in proportion to the force",
    compensation=Compensation.PREDICT,
    look_alikes={"damping": "steps of the target stiffness"},
)
