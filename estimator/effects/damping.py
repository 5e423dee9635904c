"""Damping that is not proportional to the velocity."""

import sympy as sp

from estimator.effects.declaration import Coefficient, Effect, Parameter, Signal, Source, Undone
from estimator.effects.search import EVEN, ODD, Kin, Search, Sign
from estimator.model.gyro import vx, vy, x, y

d3x, d3y, d3, fx, fy, fax, fay = sp.symbols("d3x d3y d3 fx fy fax fay")
dax, day, dqx, dqy, dcx, dcy = sp.symbols("dax day dqx dqy dcx dcy")
SMOOTHING = sp.Float(0.01)  # of A ω0: below this velocity asymmetric damping turns over smoothly
directionx, directiony, v0 = sp.symbols("directionx directiony v0")

_REST = (Parameter(v0, "v0", 1, -1, default=0.01),)  # about as slow, friction turns over
_DIRECTIONS = (Signal(directionx, Source.DIRECTION, 0), Signal(directiony, Source.DIRECTION, 1))

NONLINEAR_DAMPING = Effect(
    name="nonlinear_damping",
    number=4,
    title="Damping that grows with the displacement",
    coefficients=(Coefficient(d3x, "d3x", 0.01, -2, -1), Coefficient(d3y, "d3y", 0.01, -2, -1)),
    force=(-d3x * x**2 * vx, -d3y * y**2 * vy),
    source="Van der Pol term; squeeze film at large displacement; Nayfeh & Mook 1979",
    signature="ring-down that is not exponential, fast at first",
    undone=Undone.CANCEL,
    look_alikes={"dry_friction": "steps of amplitude"},
    signs=(*ODD, Sign.ALWAYS, Sign.AMPLITUDE, Sign.SIN_4, Sign.COS_4),
    kin=Kin.DAMPING,
)

DRY_FRICTION = Effect(
    name="dry_friction",
    number=5,
    title="Dry friction",
    coefficients=(
        Coefficient(fx, "fx", 0.01, 1, -2, positive=True),
        Coefficient(fy, "fy", 0.01, 1, -2, positive=True),
    ),
    parameters=_REST,
    signals=_DIRECTIONS,
    force=(-fx * directionx, -fy * directiony),
    source="Coulomb's law, direction = tanh(v/v0); Nayfeh & Mook 1979",
    signature="ring-down that is linear in time and ends",
    undone=Undone.CANCEL,
    look_alikes={"nonlinear_damping": "steps of amplitude"},
    signs=(*ODD, Sign.ALWAYS, Sign.AMPLITUDE),
    search=Search.SPEEDS,
    kin=Kin.DAMPING,
)

DAMPING_ASYMMETRIC = Effect(
    name="damping_asymmetric",
    number=13,
    title="Damping that is larger one way than the other",
    coefficients=(Coefficient(dax, "dax", 0.01, 0, -1), Coefficient(day, "day", 0.01, 0, -1)),
    force=(-dax * vx * sp.tanh(vx / SMOOTHING), -day * vy * sp.tanh(vy / SMOOTHING)),
    source="half the difference of viscous friction there and back, as of ball screws; Janot, Gautier & Brunot 2019",
    signature="a shift while it moves, in proportion to the speed",
    undone=Undone.CANCEL,
    look_alikes={"quadratic_stiffness": "moves at other frequencies"},
    signs=EVEN,
)

DRAG = Effect(
    name="drag",
    number=14,
    title="Drag that grows with the square of the speed",
    coefficients=(Coefficient(dqx, "dqx", 0.01, -1, positive=True), Coefficient(dqy, "dqy", 0.01, -1, positive=True)),
    force=(-dqx * vx**2 * sp.tanh(vx / SMOOTHING), -dqy * vy**2 * sp.tanh(vy / SMOOTHING)),
    source="turbulent drag, ½ ρ c A v²; Nayfeh & Mook 1979, ch. 3",
    signature="ring-down faster than exponential at first",
    undone=Undone.CANCEL,
    look_alikes={"cubic_damping": "steps of amplitude"},
    signs=ODD,
    kin=Kin.DAMPING,
)

CUBIC_DAMPING = Effect(
    name="cubic_damping",
    number=15,
    title="Damping that grows with the square of the speed",
    coefficients=(Coefficient(dcx, "dcx", 0.01, -2, 1), Coefficient(dcy, "dcy", 0.01, -2, 1)),
    force=(-dcx * vx**3, -dcy * vy**3),
    source="Rayleigh's damping term; Nayfeh & Mook 1979, ch. 3",
    signature="ring-down faster than exponential at first",
    undone=Undone.CANCEL,
    look_alikes={"nonlinear_damping": "forces off the resonance", "drag": "steps of amplitude"},
    signs=ODD,
    kin=Kin.DAMPING,
)

DRY_FRICTION_ASYMMETRIC = Effect(
    name="dry_friction_asymmetric",
    number=18,
    title="Dry friction that is larger one way than the other",
    coefficients=(Coefficient(fax, "fax", 0.01, 1, -2), Coefficient(fay, "fay", 0.01, 1, -2)),
    parameters=_REST,
    signals=_DIRECTIONS,
    force=(-fax * directionx**2, -fay * directiony**2),
    source="half the difference of Coulomb friction there and back; Janot, Gautier & Brunot 2019",
    signature="a shift while it moves, none at rest",
    undone=Undone.CANCEL,
    look_alikes={"constant_force": "standing still"},
    signs=EVEN,
    search=Search.SPEEDS,
)
