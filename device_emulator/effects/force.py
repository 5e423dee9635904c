"""What hidden effects do to the mass and its suspension, and how their own states move."""

from enum import IntEnum

from device_emulator.effects.declaration import LINE, Declaration, HiddenCoefficient, given, per_axis


class ForceKind(IntEnum):
    """What acts on the mass, in no order that matters."""

    CUBIC_STIFFNESS = 1
    CUBIC_ISOTROPIC = 2
    QUADRATIC_STIFFNESS = 3
    NONLINEAR_DAMPING = 4
    DRY_FRICTION = 5
    CONSTANT_FORCE = 6
    BASE_VIBRATION = 7
    DRY_FRICTION_ASYMMETRIC = 8
    NONRECIPROCAL_STIFFNESS = 9
    ANGULAR_GAIN = 10
    TEMPERATURE_STIFFNESS = 11
    TEMPERATURE_DAMPING = 12
    BACKLASH = 13
    HYSTERETIC_STIFFNESS = 14
    STICK_SLIP_SUPPORT = 15
    PARAMETRIC_STIFFNESS = 16
    NONLINEAR_COUPLING = 17
    UNEQUAL_MASSES = 18
    STRIBECK_FRICTION = 81
    NONLINEAR_DAMPING_RADIAL = 82
    DRAG_RADIAL = 83
    CUBIC_DAMPING_RADIAL = 84
    DRY_FRICTION_RADIAL = 85
    DAMPING_ASYMMETRIC = 86
    DRAG = 87
    CUBIC_DAMPING = 88
    PLAY = 89
    QUINTIC_STIFFNESS = 90
    QUINTIC_ISOTROPIC = 91


_FRICTION = (*per_axis("f", "m/s²"), given("v0", "m/s"))

DECLARATIONS: dict[IntEnum, Declaration] = {
    ForceKind.CUBIC_STIFFNESS: Declaration("-k3x x^3, -k3y y^3", per_axis("k3", "1/(m²·s²)")),
    ForceKind.CUBIC_ISOTROPIC: Declaration("-k3 r^2 (x, y)", (HiddenCoefficient("k3", "1/(m²·s²)"),)),
    ForceKind.QUINTIC_STIFFNESS: Declaration("-k5x x^5, -k5y y^5", per_axis("k5", "1/(m⁴·s²)")),
    ForceKind.QUINTIC_ISOTROPIC: Declaration("-k5r r^4 (x, y)", (HiddenCoefficient("k5r", "1/(m⁴·s²)"),)),
    ForceKind.QUADRATIC_STIFFNESS: Declaration("-k2x x^2, -k2y y^2", per_axis("k2", "1/(m·s²)")),
    ForceKind.NONLINEAR_DAMPING: Declaration("-d3x x^2 x', -d3y y^2 y'", per_axis("d3", "1/(m²·s)")),
    ForceKind.DRY_FRICTION: Declaration("-fx tanh(x'/v0), -fy tanh(y'/v0)", _FRICTION),
    ForceKind.STRIBECK_FRICTION: Declaration(
        "-stx tanh(x'/v0) exp(-(x'/vs)^2), -sty (...): what friction at rest has beside that of motion",
        (*per_axis("st", "m/s²"), given("v0", "m/s"), given("vs", "m/s")),
    ),
    ForceKind.NONLINEAR_DAMPING_RADIAL: Declaration("-d3r r^2 (x', y')", (HiddenCoefficient("d3r", "1/(m²·s)"),)),
    ForceKind.DRAG: Declaration("-dqx |x'| x', -dqy |y'| y'", per_axis("dq", "1/m")),
    ForceKind.DRAG_RADIAL: Declaration("-dqr |v| (x', y')", (HiddenCoefficient("dqr", "1/m"),)),
    ForceKind.CUBIC_DAMPING: Declaration("-dcx x'^3, -dcy y'^3", per_axis("dc", "s/m²")),
    ForceKind.CUBIC_DAMPING_RADIAL: Declaration("-dcr |v|^2 (x', y')", (HiddenCoefficient("dcr", "s/m²"),)),
    ForceKind.DAMPING_ASYMMETRIC: Declaration("-dax |x'|, -day |y'|", per_axis("da", "1/s")),
    ForceKind.DRY_FRICTION_RADIAL: Declaration(
        "-fr (x', y') / sqrt(|v|^2 + v0^2): against the motion, whatever its direction",
        (HiddenCoefficient("fr", "m/s²"), given("v0", "m/s")),
    ),
    ForceKind.CONSTANT_FORCE: Declaration("+ax, +ay", per_axis("a", "m/s²")),
    ForceKind.BASE_VIBRATION: Declaration("+ax sin(2 pi f t + psi_x), +ay sin(...)", (*per_axis("a", "m/s²"), *LINE)),
    ForceKind.DRY_FRICTION_ASYMMETRIC: Declaration(
        "-fx (T + ax T^2) with T = tanh(x'/v0), -fy (...): f (1 + a) forth, f (1 - a) back",
        (*_FRICTION, *per_axis("a", "1")),
    ),
    ForceKind.NONRECIPROCAL_STIFFNESS: Declaration("-kn y, +kn x", (HiddenCoefficient("kn", "1/s²"),)),
    ForceKind.ANGULAR_GAIN: Declaration(
        "Coriolis and Euler force times 1 + kappa: +kappa (2 W y' + W' y), -kappa (2 W x' + W' x)",
        (HiddenCoefficient("kappa", "1"),),
    ),
    ForceKind.TEMPERATURE_STIFFNESS: Declaration("K (1 + tc (T - T0))", (HiddenCoefficient("tc", "1/K"),)),
    ForceKind.TEMPERATURE_DAMPING: Declaration("D (1 + tc (T - T0))", (HiddenCoefficient("tc", "1/K"),)),
    ForceKind.BACKLASH: Declaration(
        "-kbx (x - clip(x, -gap, gap)), -kby (...): a spring with play",
        (*per_axis("kb", "1/s²"), given("gap", "m")),
    ),
    ForceKind.HYSTERETIC_STIFFNESS: Declaration(
        "-khx zx, zx' = x' - (|x'| zx + x' |zx|) / (2 reach); y likewise (Bouc and Wen, exponent 1)",
        (*per_axis("kh", "1/s²"), given("reach", "m")),
        states=2,
    ),
    ForceKind.PLAY: Declaration(
        "-kpx (x - zx), a spring to a foot that the mass takes along once it is half_width away: "
        "zx = max(x - half_width, min(x + half_width, zx)), from 0; y likewise",
        (*per_axis("kp", "1/s²"), given("half_width", "m")),
        states=4,
    ),
    ForceKind.STICK_SLIP_SUPPORT: Declaration(
        "the package, 1/ratio as heavy as the mass, rests on springs and friction (LuGre): -X'', "
        "X'' = ratio r - (2 pi f)^2 X - s z - sqrt(s) z', z' = X' - s |X'| z / g, "
        "g = Fc + (Fs - Fc) exp(-(X'/vs)^2), r = K x + D x' - u; Y likewise",
        (
            given("ratio", "1"),
            given("frequency", "Hz"),
            given("Fs", "m/s²"),
            given("Fc", "m/s²"),
            given("vs", "m/s"),
            given("s", "1/s²"),
        ),
        states=6,
    ),
    ForceKind.PARAMETRIC_STIFFNESS: Declaration(
        "K (1 + depth sin(2 pi f t + psi))",
        (HiddenCoefficient("depth", "1"), given("frequency", "Hz"), HiddenCoefficient("phase", "rad")),
    ),
    ForceKind.NONLINEAR_COUPLING: Declaration(
        "-3 c x^2 y, -c x^3: potential c x^3 y", (HiddenCoefficient("c", "1/(m²·s²)"),)
    ),
    ForceKind.UNEQUAL_MASSES: Declaration(
        "y moves 1 + m times the mass of x: all of y'' but W^2 y over 1 + m, Coriolis and Euler force being "
        "of the mass that both move",
        (HiddenCoefficient("m", "1", None, above=-1.0),),
    ),
}
