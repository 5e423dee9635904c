"""Damping that is not proportional to the velocity."""

from estimator.effects.declaration import Coefficient, Compensation, Effect, Parameter, Signal, Source
from estimator.effects.search import Search
from estimator.model.formula import exp, sqrt, symbols, tanh
from estimator.model.symbols import vx, vy, x, y

d3x, d3y, fx, fy, fax, fay = symbols("d3x d3y fx fy fax fay")
dax, day, dqx, dqy, dcx, dcy = symbols("dax day dqx dqy dcx dcy")
SMOOTHING = 0.01  # of A ω0: below this velocity asymmetric damping turns over smoothly
directionx, directiony, v0 = symbols("directionx directiony v0")
stx, sty, vs, d3r, fr, dqr, dcr = symbols("stx sty vs d3r fr dqr dcr")

_RADIUS2 = x**2 + y**2
_SPEED2 = vx**2 + vy**2

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
    compensation=Compensation.CANCEL,
    look_alikes={"dry_friction": "steps of amplitude"},
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
    compensation=Compensation.CANCEL,
    look_alikes={"nonlinear_damping": "steps of amplitude"},
    search=Search.SPEEDS,
)

DAMPING_ASYMMETRIC = Effect(
    name="damping_asymmetric",
    number=13,
    title="Damping that is larger one way than the other",
    coefficients=(Coefficient(dax, "dax", 0.01, 0, -1), Coefficient(day, "day", 0.01, 0, -1)),
    force=(-dax * vx * tanh(vx / SMOOTHING), -day * vy * tanh(vy / SMOOTHING)),
    shown=("ẍ += -dax*vx*tanh(100*vx/(A*omega0))", "ÿ += -day*vy*tanh(100*vy/(A*omega0))"),
    source="half the difference of viscous friction there and back, as of ball screws; Janot, Gautier & Brunot 2019",
    signature="a shift while it moves, in proportion to the speed",
    compensation=Compensation.CANCEL,
    look_alikes={"quadratic_stiffness": "moves at other frequencies"},
)

DRAG = Effect(
    name="drag",
    number=14,
    title="Drag that grows with the square of the speed",
    coefficients=(Coefficient(dqx, "dqx", 0.01, -1, positive=True), Coefficient(dqy, "dqy", 0.01, -1, positive=True)),
    force=(-dqx * vx**2 * tanh(vx / SMOOTHING), -dqy * vy**2 * tanh(vy / SMOOTHING)),
    shown=("ẍ += -dqx*vx**2*tanh(100*vx/(A*omega0))", "ÿ += -dqy*vy**2*tanh(100*vy/(A*omega0))"),
    source="turbulent drag, ½ ρ c A v²; Nayfeh & Mook 1979, ch. 3",
    signature="ring-down faster than exponential at first",
    compensation=Compensation.CANCEL,
    look_alikes={"cubic_damping": "steps of amplitude"},
)

CUBIC_DAMPING = Effect(
    name="cubic_damping",
    number=15,
    title="Damping that grows with the square of the speed",
    coefficients=(Coefficient(dcx, "dcx", 0.01, -2, 1), Coefficient(dcy, "dcy", 0.01, -2, 1)),
    force=(-dcx * vx**3, -dcy * vy**3),
    source="Rayleigh's damping term; Nayfeh & Mook 1979, ch. 3",
    signature="ring-down faster than exponential at first",
    compensation=Compensation.CANCEL,
    look_alikes={"nonlinear_damping": "forces off the resonance", "drag": "steps of amplitude"},
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
    compensation=Compensation.CANCEL,
    look_alikes={"constant_force": "standing still"},
    search=Search.SPEEDS,
)

STRIBECK_FRICTION = Effect(
    name="stribeck_friction",
    number=36,
    rare=True,
    title="Dry friction that falls with the speed",
    coefficients=(
        Coefficient(stx, "stx", 0.01, 1, -2, positive=True),
        Coefficient(sty, "sty", 0.01, 1, -2, positive=True),
    ),
    parameters=(*_REST, Parameter(vs, "vs", 1, -1, tried=(0.03, 0.12, 0.5))),
    signals=(*_DIRECTIONS, Signal(vs, Source.PARAMETER)),
    force=(-stx * directionx * exp(-((vx / vs) ** 2)), -sty * directiony * exp(-((vy / vs) ** 2))),
    source="what static friction has beside Coulomb's, f exp(−(v/vs)²); Stribeck 1902; Armstrong-Hélouvry, Dupont & "
    "Canudas de Wit, Automatica 30(7), 1994",
    signature="more force at creeping speed than at full",
    compensation=Compensation.CANCEL,
    look_alikes={"dry_friction": "steps of speed"},
)

NONLINEAR_DAMPING_RADIAL = Effect(
    name="nonlinear_damping_radial",
    number=37,
    plane=True,
    rare=True,
    title="Damping that grows with the distance from the centre",
    coefficients=(Coefficient(d3r, "d3r", 0.01, -2, -1),),
    force=(-d3r * _RADIUS2 * vx, -d3r * _RADIUS2 * vy),
    source="Van der Pol term in the plane, r² v: squeeze film under a mass that both axes move",
    signature="ring-down that is not exponential, as fast on a line as on a circle",
    compensation=Compensation.CANCEL,
    look_alikes={"nonlinear_damping": "orbits of different shape"},
)

DRAG_RADIAL = Effect(
    name="drag_radial",
    number=38,
    plane=True,
    rare=True,
    title="Drag against the motion, with the square of the speed",
    coefficients=(Coefficient(dqr, "dqr", 0.01, -1, positive=True),),
    force=(-dqr * sqrt(_SPEED2 + SMOOTHING**2) * vx, -dqr * sqrt(_SPEED2 + SMOOTHING**2) * vy),
    shown=(
        "ẍ += -dqr*vx*sqrt(vx**2 + vy**2 + (A*omega0/100)**2)",
        "ÿ += -dqr*vy*sqrt(vx**2 + vy**2 + (A*omega0/100)**2)",
    ),
    source="turbulent drag of a body that moves in the plane, ½ ρ c A |v| v; Nayfeh & Mook 1979, ch. 3",
    signature="ring-down faster than exponential at first",
    compensation=Compensation.CANCEL,
    look_alikes={"drag": "orbits of different shape", "cubic_damping_radial": "steps of amplitude"},
)

CUBIC_DAMPING_RADIAL = Effect(
    name="cubic_damping_radial",
    number=39,
    plane=True,
    rare=True,
    title="Damping against the motion, with the cube of the speed",
    coefficients=(Coefficient(dcr, "dcr", 0.01, -2, 1),),
    force=(-dcr * _SPEED2 * vx, -dcr * _SPEED2 * vy),
    source="Rayleigh's damping term in the plane, |v|² v; Nayfeh & Mook 1979, ch. 3",
    signature="ring-down faster than exponential at first",
    compensation=Compensation.CANCEL,
    look_alikes={"nonlinear_damping_radial": "forces off the resonance", "cubic_damping": "orbits of different shape"},
)

DRY_FRICTION_RADIAL = Effect(
    name="dry_friction_radial",
    number=40,
    plane=True,
    rare=True,
    title="Dry friction against the motion",
    coefficients=(Coefficient(fr, "fr", 0.01, 1, -2, positive=True),),
    parameters=_REST,
    signals=(*_DIRECTIONS, Signal(v0, Source.PARAMETER)),  # directions: the flow stops where the mass turns
    force=(-fr * vx / sqrt(_SPEED2 + v0**2), -fr * vy / sqrt(_SPEED2 + v0**2)),
    source="Coulomb's law of a body that slides in the plane, v/|v|, |v| taken as √(v² + v0²)",
    signature="ring-down that is linear in time and ends, on a circle as on a line",
    compensation=Compensation.CANCEL,
    look_alikes={"dry_friction": "orbits of different shape"},
    search=Search.SPEEDS,
)
