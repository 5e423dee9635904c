"""What hidden effects do between the motion and the code: combs, amplifiers, converter."""

from enum import IntEnum

from device_emulator.effects.declaration import LINE, Declaration, HiddenCoefficient, given, limits, per_axis, switches


class SenseKind(IntEnum):
    """What acts between the motion and the code, in no order that matters."""

    SENSE_GAIN = 40
    SENSE_CROSS_COUPLING = 41
    SENSE_QUADRATIC = 42
    SENSE_CUBIC = 43
    SENSE_DELAY = 44
    PARASITIC_MODE = 45
    SENSE_POLARITY = 46
    DRIVE_FEEDTHROUGH = 60
    INTERFERENCE = 61
    TEMPERATURE_OFFSET = 62
    TELEGRAPH_OFFSET = 63
    SENSE_CLIPPING = 64
    MISSING_CODES = 65
    FREE_MODE = 66


_RINGING = tuple(HiddenCoefficient(name, "V") for name in ("cmx", "smx", "cmy", "smy"))

DECLARATIONS: dict[IntEnum, Declaration] = {
    SenseKind.SENSE_GAIN: Declaration("x -> (1 + gx) x, y -> (1 + gy) y", per_axis("g", "1")),
    SenseKind.SENSE_CROSS_COUPLING: Declaration(
        "x -> x + ex y, y -> y + ey x", (HiddenCoefficient("ex", "1"), HiddenCoefficient("ey", "1"))
    ),
    SenseKind.SENSE_QUADRATIC: Declaration("x -> x + a2x x^2, y -> y + a2y y^2", per_axis("a2", "1/m")),
    SenseKind.SENSE_CUBIC: Declaration("x -> x + a3x x^3, y -> y + a3y y^3", per_axis("a3", "1/m²")),
    SenseKind.SENSE_DELAY: Declaration("x(t - tau)", (HiddenCoefficient("tsx", "s"), HiddenCoefficient("tsy", "s"))),
    SenseKind.PARASITIC_MODE: Declaration(
        "x -> x + px, px'' + 2 zeta w px' + w^2 px = rx ux, w = 2 pi f; y likewise",
        (given("frequency", "Hz"), given("zeta", "1"), *per_axis("r", "1")),
        states=4,
    ),
    SenseKind.SENSE_POLARITY: Declaration(
        "x -> -x where px = 1, y -> -y where py = 1, after what stands before it", switches()
    ),
    SenseKind.DRIVE_FEEDTHROUGH: Declaration("V + gamma u", per_axis("gamma_", "V·s²/m")),
    SenseKind.INTERFERENCE: Declaration("V + a sin(2 pi f t + psi)", (*per_axis("a", "V"), *LINE)),
    SenseKind.TEMPERATURE_OFFSET: Declaration("V + tc (T - T0)", per_axis("tc_", "V/K")),
    SenseKind.TELEGRAPH_OFFSET: Declaration(
        "V + a s, s = 1 or -1, changing at random `rate` times a second",
        (*per_axis("a", "V"), given("rate", "1/s")),
        states=2,
    ),
    SenseKind.FREE_MODE: Declaration(
        "V + p, p'' + dm p' + (wm^2 + dm^2/4) p = 0 from p = cm, p' = wm sm - dm cm / 2 on; an axis each",
        (given("wm", "1/s"), HiddenCoefficient("dm", "1/s"), *_RINGING),
        states=4,
    ),
    SenseKind.SENSE_CLIPPING: Declaration(
        "V -> clip(V, -limit_x, limit_x), before noise and converter", limits("limit_", "V")
    ),
    SenseKind.MISSING_CODES: Declaration(
        "codes n every ... n every + width - 1 all read n every", (given("every", "1"), given("width", "1"))
    ),
}
