"""What hidden effects do to the mass and its suspension, and how their own states move."""

from device_emulator.effects.declaration import LINE, Declaration, HiddenCoefficient, given, per_axis

_FRICTION = (*per_axis("f", "m/s²"), given("v0", "m/s"))

DECLARATIONS: dict[str, Declaration] = {
    "cubic_stiffness": Declaration("-k3x x^3, -k3y y^3", per_axis("k3", "1/(m²·s²)")),
    "cubic_isotropic": Declaration("-k3 r^2 (x, y)", (HiddenCoefficient("k3", "1/(m²·s²)"),)),
    "quintic_stiffness": Declaration("-k5x x^5, -k5y y^5", per_axis("k5", "1/(m⁴·s²)")),
    "quintic_isotropic": Declaration("-k5r r^4 (x, y)", (HiddenCoefficient("k5r", "1/(m⁴·s²)"),)),
    "quadratic_stiffness": Declaration("-k2x x^2, -k2y y^2", per_axis("k2", "1/(m·s²)")),
    "nonlinear_damping": Declaration("-d3x x^2 x', -d3y y^2 y'", per_axis("d3", "1/(m²·s)")),
    "dry_friction": Declaration("-fx tanh(x'/v0), -fy tanh(y'/v0)", _FRICTION),
    "stribeck_friction": Declaration(
        "-stx tanh(x'/v0) exp(-(x'/vs)^2), -sty (...): what friction at rest has beside that of motion",
        (*per_axis("st", "m/s²"), given("v0", "m/s"), given("vs", "m/s")),
    ),
    "nonlinear_damping_radial": Declaration("-d3r r^2 (x', y')", (HiddenCoefficient("d3r", "1/(m²·s)"),)),
    "drag": Declaration("-dqx |x'| x', -dqy |y'| y'", per_axis("dq", "1/m")),
    "drag_radial": Declaration("-dqr |v| (x', y')", (HiddenCoefficient("dqr", "1/m"),)),
    "cubic_damping": Declaration("-dcx x'^3, -dcy y'^3", per_axis("dc", "s/m²")),
    "cubic_damping_radial": Declaration("-dcr |v|^2 (x', y')", (HiddenCoefficient("dcr", "s/m²"),)),
    "damping_asymmetric": Declaration("-dax |x'|, -day |y'|", per_axis("da", "1/s")),
    "dry_friction_radial": Declaration(
        "-fr (x', y') / sqrt(|v|^2 + v0^2): against the motion, whatever its direction",
        (HiddenCoefficient("fr", "m/s²"), given("v0", "m/s")),
    ),
    "constant_force": Declaration("+ax, +ay", per_axis("a", "m/s²")),
    "base_vibration": Declaration("+ax sin(2 pi f t + psi_x), +ay sin(...)", (*per_axis("a", "m/s²"), *LINE)),
    "dry_friction_asymmetric": Declaration(
        "-fx (T + ax T^2) with T = tanh(x'/v0), -fy (...): f (1 + a) forth, f (1 - a) back",
        (*_FRICTION, *per_axis("a", "1")),
    ),
    "nonreciprocal_stiffness": Declaration("-kn y, +kn x", (HiddenCoefficient("kn", "1/s²"),)),
    "angular_gain": Declaration(
        "Coriolis and Euler force times 1 + kappa: +kappa (2 W y' + W' y), -kappa (2 W x' + W' x)",
        (HiddenCoefficient("kappa", "1"),),
    ),
    "temperature_stiffness": Declaration("K (1 + tc (T - T0))", (HiddenCoefficient("tc", "1/K"),)),
    "temperature_damping": Declaration("D (1 + tc (T - T0))", (HiddenCoefficient("tc", "1/K"),)),
    "backlash": Declaration(
        "-kbx (x - clip(x, -gap, gap)), -kby (...): a spring with play",
        (*per_axis("kb", "1/s²"), given("gap", "m")),
    ),
    "hysteretic_stiffness": Declaration(
        "-khx zx, zx' = x' - (|x'| zx + x' |zx|) / (2 reach); y likewise (Bouc and Wen, exponent 1)",
        (*per_axis("kh", "1/s²"), given("reach", "m")),
        states=2,
    ),
    "play": Declaration(
        "-kpx (x - zx), a spring to a foot that the mass takes along once it is half_width away: "
        "zx = max(x - half_width, min(x + half_width, zx)), from 0; y likewise",
        (*per_axis("kp", "1/s²"), given("half_width", "m")),
        states=4,
    ),
    "stick_slip_support": Declaration(
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
    "parametric_stiffness": Declaration(
        "K (1 + depth sin(2 pi f t + psi))",
        (HiddenCoefficient("depth", "1"), given("frequency", "Hz"), HiddenCoefficient("phase", "rad")),
    ),
    "nonlinear_coupling": Declaration("-3 c x^2 y, -c x^3: potential c x^3 y", (HiddenCoefficient("c", "1/(m²·s²)"),)),
    "unequal_masses": Declaration(
        "y moves 1 + m times the mass of x: all of y'' but W^2 y over 1 + m, Coriolis and Euler force being "
        "of the mass that both move",
        (HiddenCoefficient("m", "1", None, above=-1.0),),
    ),
}
