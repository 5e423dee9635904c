"""What hidden effects do between the motion and the code: combs, amplifiers, converter."""

from device_emulator.effects.declaration import LINE, Declaration, HiddenCoefficient, given, limits, per_axis, switches

_RINGING = tuple(HiddenCoefficient(name, "V") for name in ("cmx", "smx", "cmy", "smy"))

DECLARATIONS: dict[str, Declaration] = {
    "sense_gain": Declaration("x -> (1 + gx) x, y -> (1 + gy) y", per_axis("g", "1")),
    "sense_cross_coupling": Declaration(
        "x -> x + ex y, y -> y + ey x", (HiddenCoefficient("ex", "1"), HiddenCoefficient("ey", "1"))
    ),
    "sense_quadratic": Declaration("x -> x + a2x x^2, y -> y + a2y y^2", per_axis("a2", "1/m")),
    "sense_cubic": Declaration("x -> x + a3x x^3, y -> y + a3y y^3", per_axis("a3", "1/m²")),
    "sense_delay": Declaration("x(t - tau)", (HiddenCoefficient("tsx", "s"), HiddenCoefficient("tsy", "s"))),
    "parasitic_mode": Declaration(
        "x -> x + px, px'' + 2 zeta w px' + w^2 px = rx ux, w = 2 pi f; y likewise",
        (given("frequency", "Hz"), given("zeta", "1"), *per_axis("r", "1")),
        states=4,
    ),
    "sense_polarity": Declaration(
        "x -> -x where px = 1, y -> -y where py = 1, after what stands before it", switches()
    ),
    "drive_feedthrough": Declaration("V + gamma u", per_axis("gamma_", "V·s²/m")),
    "interference": Declaration("V + a sin(2 pi f t + psi)", (*per_axis("a", "V"), *LINE)),
    "temperature_offset": Declaration("V + tc (T - T0)", per_axis("tc_", "V/K")),
    "telegraph_offset": Declaration(
        "V + a s, s = 1 or -1, changing at random `rate` times a second",
        (*per_axis("a", "V"), given("rate", "1/s")),
        states=2,
    ),
    "free_mode": Declaration(
        "V + p, p'' + dm p' + (wm^2 + dm^2/4) p = 0 from p = cm, p' = wm sm - dm cm / 2 on; an axis each",
        (given("wm", "1/s"), HiddenCoefficient("dm", "1/s"), *_RINGING),
        states=4,
    ),
    "sense_clipping": Declaration("V -> clip(V, -limit_x, limit_x), before noise and converter", limits("limit_", "V")),
    "missing_codes": Declaration(
        "codes n every ... n every + width - 1 all read n every", (given("every", "1"), given("width", "1"))
    ),
}
