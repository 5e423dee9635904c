"""Stiffness that is not a constant symmetric matrix."""

from estimator.effects.declaration import Coefficient, Compensation, Effect
from estimator.model.formula import symbols
from estimator.model.symbols import x, y

k3x, k3y, k3, k5x, k5y, k5r, k2x, k2y, kn, ax, ay = symbols("k3x k3y k3 k5x k5y k5r k2x k2y kn ax ay")

CUBIC_STIFFNESS = Effect(
    name="cubic_stiffness",
    number=0,
    title="Cubic stiffness of each axis",
    coefficients=(Coefficient(k3x, "k3x", 0.05, -2, -2), Coefficient(k3y, "k3y", 0.05, -2, -2)),
    force=(-k3x * x**3, -k3y * y**3),
    source="Duffing oscillator; Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 4",
    signature="frequency pulled by 3/8 k3 A²/k, a line at 3ω, quadrature growing with sin 4θ",
    compensation=Compensation.CANCEL,
    look_alikes={"sense_cubic": "pulls no frequency"},
)

CUBIC_ISOTROPIC = Effect(
    name="cubic_isotropic",
    number=1,
    title="Cubic stiffness along the radius",
    coefficients=(Coefficient(k3, "k3", 0.05, -2, -2),),
    force=(-k3 * (x**2 + y**2) * x, -k3 * (x**2 + y**2) * y),
    source="Lynch, Coriolis angular velocity sensors, IEEE Std 1431 annex B",
    signature="frequency pulled with the amplitude; a rate bias −k3 a b/4ω with quadrature",
    compensation=Compensation.CANCEL,
    plane=True,
)

QUADRATIC_STIFFNESS = Effect(
    name="quadratic_stiffness",
    number=2,
    title="Quadratic stiffness of each axis",
    coefficients=(Coefficient(k2x, "k2x", 0.05, -1, -2), Coefficient(k2y, "k2y", 0.05, -1, -2)),
    force=(-k2x * x**2, -k2y * y**2),
    source="asymmetric electrostatic spring; Senturia, Microsystem Design, 2001, ch. 6",
    signature="a shift and a line at 2ω",
    compensation=Compensation.CANCEL,
    look_alikes={"sense_quadratic": "moves with the bias, not with the drive"},
)

NONRECIPROCAL_STIFFNESS = Effect(
    name="nonreciprocal_stiffness",
    number=3,
    title="Stiffness that is not symmetric, kxy ≠ kyx",
    coefficients=(Coefficient(kn, "kn", 0.01, 0, -2),),
    force=(-kn * y, kn * x),
    source="antisymmetric part of the stiffness matrix, as from a drive misaligned by feedback",
    signature="quadrature of one sign at every angle",
    compensation=Compensation.CANCEL,
    look_alikes={"rotation (Euler term)": "vanishes at a constant rate"},
)

CONSTANT_FORCE = Effect(
    name="constant_force",
    number=19,
    title="A constant force",
    coefficients=(Coefficient(ax, "ax", 0.01, 1, -2), Coefficient(ay, "ay", 0.01, 1, -2)),
    force=(ax, ay),
    source="gravity on a tilted bench",
    signature="none beside the sense offset",
    compensation=Compensation.CANCEL,
    look_alikes={"sense offset": "nothing on one bench; tilt it"},
)

QUINTIC_STIFFNESS = Effect(
    name="quintic_stiffness",
    number=44,
    title="Stiffness of the fifth order of each axis",
    coefficients=(Coefficient(k5x, "k5x", 0.05, -4, -2), Coefficient(k5y, "k5y", 0.05, -4, -2)),
    force=(-k5x * x**5, -k5y * y**5),
    source="Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 2: averaged over a cycle, x⁵ is 5/8 A⁴ x",
    signature="frequency pulled by 5/16 k5 A⁴/k, lines at 3ω and 5ω",
    compensation=Compensation.CANCEL,
    look_alikes={"cubic_stiffness": "another amplitude"},
)

QUINTIC_ISOTROPIC = Effect(
    name="quintic_isotropic",
    number=45,
    title="Stiffness of the fifth order along the radius",
    coefficients=(Coefficient(k5r, "k5r", 0.05, -4, -2),),
    force=(-k5r * (x**2 + y**2) ** 2 * x, -k5r * (x**2 + y**2) ** 2 * y),
    source="next term after the cubic one of a potential that depends on the radius only",
    signature="frequency pulled with the fourth power of the amplitude",
    compensation=Compensation.CANCEL,
    look_alikes={"cubic_isotropic": "another amplitude"},
    plane=True,
)
