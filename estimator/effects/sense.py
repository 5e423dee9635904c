"""A sense chain that shows something else than the displacement."""

from typing import Any

from estimator.effects.declaration import Coefficient, Compensation, Effect, Parameter, Signal, Source
from estimator.effects.search import Search
from estimator.model.formula import clipped, cos, exp, sin, symbols
from estimator.model.symbols import (
    b,
    d,
    dxx,
    dxy,
    dyy,
    k,
    kxx,
    kxy,
    kyy,
    phi_x,
    phi_y,
    rate,
    ux,
    uy,
    vx,
    vy,
    x,
    y,
)

gy, ey, ex, a2x, a2y, a3x, a3y, fdx, fdy = symbols("gy ey ex a2x a2y a3x a3y fdx fdy")
tlx, tly, hpx, hpy, clx, cly, level = symbols("tlx tly hpx hpy clx cly level")
odx, ody, wane_x, wane_y, leak_x, leak_y = symbols("odx ody wane_x wane_y leak_x leak_y")
time, wm, dm, cmx, smx, cmy, smy = symbols("time wm dm cmx smx cmy smy")
rx, ry, px, py, omega, zeta = symbols("rx ry px py omega_p zeta_p")
ux_behind_x, uy_behind_x, ux_behind_y, uy_behind_y = symbols("ux_behind_x uy_behind_x ux_behind_y uy_behind_y")
olx, oly, start_x, start_y = symbols("olx oly start_x start_y")
ux_over_x, uy_over_x, ux_over_y, uy_over_y = symbols("ux_over_x uy_over_x ux_over_y uy_over_y")


def smoothed_velocities(lag: Any, push_x: Any, push_y: Any) -> tuple[Any, Any]:
    """What a first-order lag leaves of ẋ and ẏ, its own start being over: exact for the base model.

    With ṡ = A s + B u, the lag q + T q̇ = s is q = (I + T A)⁻¹ (s − T B l), l the drive behind the same lag: at every
    frequency of the motion, that of each mode and its sidebands, and of a drive that steps from sample to sample.
    Solved for the velocities; behind the lag, a position is x − T times its velocity there.
    """
    own_x, own_y = kxx - rate**2, kyy - rate**2
    xx, yy = 1 + lag * (lag * own_x - dxx), 1 + lag * (lag * own_y - dyy)
    xy, yx = (lag * (lag * kxy - dxy + turn) for turn in (2 * rate, -2 * rate))
    of_x = vx + lag * (own_x * x + kxy * y - push_x)
    of_y = vy + lag * (kxy * x + own_y * y - push_y)
    determinant = xx * yy - xy * yx
    return (yy * of_x - xy * of_y) / determinant, (xx * of_y - yx * of_x) / determinant


def leaking_integrals(leak: Any, push_x: Any, push_y: Any) -> tuple[Any, Any]:
    """∫ x dt and ∫ y dt, leaking at that rate, their own start being over: exact for the base model.

    With ṡ = A s + B u, q̇ = s − a q is q = (a I + A)⁻¹ (s − B l), l the drive integrated with the same leak.  Solved for
    the positions; a velocity's integral is the position less a times its own.
    """
    own_x, own_y = kxx - rate**2, kyy - rate**2
    to_x, to_y = dxy - 2 * rate, dxy + 2 * rate
    xx, yy = leak**2 - leak * dxx + own_x, leak**2 - leak * dyy + own_y
    xy, yx = kxy - leak * to_x, kxy - leak * to_y
    of_x = (leak - dxx) * x - to_x * y + push_x - vx
    of_y = (leak - dyy) * y - to_y * x + push_y - vy
    determinant = xx * yy - xy * yx
    return (yy * of_x - xy * of_y) / determinant, (xx * of_y - yx * of_x) / determinant


SENSE_GAIN = Effect(
    name="sense_gain",
    number=6,
    title="Sense gain of y beside that of x",
    coefficients=(Coefficient(gy, "gy", 0.02),),
    sense=(0, gy * y),
    source="Actuators 2025, 14, 275: detection-gain asymmetry",
    signature="error ½ g sin 2θ in the angle itself",
    compensation=Compensation.MAP,
    look_alikes={"damping mismatch": "its error grows with time"},
    gain=True,
)

SENSE_CROSS_COUPLING = Effect(
    name="sense_cross_coupling",
    number=7,
    title="Each axis senses some of the other",
    coefficients=(Coefficient(ex, "ex", 0.02), Coefficient(ey, "ey", 0.02)),
    sense=(ex * y, ey * x),
    source="electrode misalignment; IEEE Std 1431",
    signature="error ½ ε (1 + cos 2θ) in the angle",
    compensation=Compensation.MAP,
)

SENSE_QUADRATIC = Effect(
    name="sense_quadratic",
    number=8,
    title="Quadratic sense characteristic",
    coefficients=(Coefficient(a2x, "a2x", 0.02, -1), Coefficient(a2y, "a2y", 0.02, -1)),
    sense=(a2x * x**2, a2y * y**2),
    source="parallel-plate capacitance to second order",
    signature="a shift and a line at 2ω that do not move with the drive",
    compensation=Compensation.MAP,
    look_alikes={"quadratic_stiffness": "amplitude steps"},
)

SENSE_CUBIC = Effect(
    name="sense_cubic",
    number=9,
    title="Cubic sense characteristic",
    coefficients=(Coefficient(a3x, "a3x", 0.02, -2), Coefficient(a3y, "a3y", 0.02, -2)),
    sense=(a3x * x**3, a3y * y**3),
    source="comb or parallel-plate capacitance to third order",
    signature="a line at 3ω without a pull of the frequency",
    compensation=Compensation.MAP,
    look_alikes={"cubic_stiffness": "pulls the frequency with the amplitude"},
)

DRIVE_FEEDTHROUGH = Effect(
    name="drive_feedthrough",
    number=10,
    title="Drive seen by the sense electrodes",
    coefficients=(Coefficient(fdx, "fdx", 0.05, 0, 2), Coefficient(fdy, "fdy", 0.05, 0, 2)),
    sense=(fdx * ux, fdy * uy),
    source="parasitic capacitance between drive and sense combs",
    signature="innovation follows the drive without delay",
    compensation=Compensation.MAP,
    look_alikes={"drive_gain": "dither off the resonance"},
)

SENSE_LOW_PASS = Effect(
    name="sense_low_pass",
    number=20,
    title="A low-pass pole in the sense path",
    coefficients=(
        Coefficient(tlx, "tlx", 0.1, 0, 1, positive=True, bent=True),
        Coefficient(tly, "tly", 0.1, 0, 1, positive=True, bent=True),
        Coefficient(olx, "olx", 1.0, 1),
        Coefficient(oly, "oly", 1.0, 1),
    ),
    signals=(
        Signal(ux_behind_x, Source.LAG, 0, tlx),
        Signal(uy_behind_x, Source.LAG, 1, tlx),
        Signal(ux_behind_y, Source.LAG, 0, tly),
        Signal(uy_behind_y, Source.LAG, 1, tly),
        Signal(start_x, Source.WANE, 0, tlx),
        Signal(start_y, Source.WANE, 1, tly),
    ),
    sense=(
        -tlx * smoothed_velocities(tlx, ux_behind_x, uy_behind_x)[0] + olx * start_x,
        -tly * smoothed_velocities(tly, ux_behind_y, uy_behind_y)[1] + oly * start_y,
    ),
    shown=(
        "sensed x = q + phi_x, tlx*q̇ + q = x, at first off by olx",
        "sensed y = q + phi_y, tly*q̇ + q = y, at first off by oly",
    ),
    alone=-tlx * (vx + tlx * x) / (1 + tlx**2),
    source="1/(1 + sT) of the motion that the base model has, from a start of its own; on a single axis at s² = −ω0²",
    signature="a delay T and a gain 1 − (ωT)²/2",
    compensation=Compensation.MAP,
    look_alikes={"sense_delay": "nothing, far above the resonance"},
    search=Search.LAGS,
)

SENSE_HIGH_PASS = Effect(
    name="sense_high_pass",
    number=21,
    title="A high-pass corner in the sense path",
    coefficients=(
        Coefficient(hpx, "hpx", 0.05, 0, -1, positive=True),
        Coefficient(hpy, "hpy", 0.05, 0, -1, positive=True),
        Coefficient(odx, "odx", 0.1, 1),
        Coefficient(ody, "ody", 0.1, 1),
    ),
    parameters=(
        Parameter(leak_x, "leak_x", 0, -1, found_as=hpx),
        Parameter(leak_y, "leak_y", 0, -1, found_as=hpy),
    ),
    signals=(
        Signal(leak_x, Source.PARAMETER),
        Signal(leak_y, Source.PARAMETER),
        Signal(ux_over_x, Source.INTEGRAL, 0, leak_x),
        Signal(uy_over_x, Source.INTEGRAL, 1, leak_x),
        Signal(ux_over_y, Source.INTEGRAL, 0, leak_y),
        Signal(uy_over_y, Source.INTEGRAL, 1, leak_y),
        Signal(wane_x, Source.DECAY, 0),
        Signal(wane_y, Source.DECAY, 1),
    ),
    sense=(
        -hpx * leaking_integrals(leak_x, ux_over_x, uy_over_x)[0] + odx * wane_x,
        -hpy * leaking_integrals(leak_y, ux_over_y, uy_over_y)[1] + ody * wane_y,
    ),
    shown=(
        "sensed x = x - hpx*q + phi_x, q̇ + leak_x*q = x, at first off by odx",
        "sensed y = y - hpy*q + phi_y, q̇ + leak_y*q = y, at first off by ody",
    ),
    alone=-hpx * ((leak_x - d) * x + b * ux_over_x - vx) / (leak_x**2 - leak_x * d + k) + odx * wane_x,
    source="charge amplifier with feedback resistor, sRC/(1 + sRC), of the motion that the base model has; what it and "
    "its mismatch show at first wanes",
    signature="phase lead atan(1/ωRC), constants blocked",
    compensation=Compensation.MAP,
    look_alikes={"sense_delay": "a slow motion"},
    search=Search.CORNERS,
)

SENSE_CLIPPING = Effect(
    name="sense_clipping",
    number=22,
    title="The sense chain saturates inside its range",
    coefficients=(Coefficient(clx, "clx", 0.5), Coefficient(cly, "cly", 0.5)),
    parameters=(Parameter(level, "level", 1),),
    signals=(Signal(level, Source.PARAMETER),),
    sense=(
        clx * (clipped(x + phi_x, level) - x - phi_x),
        cly * (clipped(y + phi_y, level) - y - phi_y),
    ),
    source="V → clip(V), share of what goes over the level is lost",
    signature="flat tops, odd harmonics",
    compensation=Compensation.MAP,
    look_alikes={"sense_cubic": "larger amplitude"},
    search=Search.LEVELS,
)

PARASITIC_MODE = Effect(
    name="parasitic_mode",
    number=23,
    title="Another mode, driven and seen",
    coefficients=(Coefficient(rx, "rx", 1.0), Coefficient(ry, "ry", 1.0)),
    parameters=(Parameter(omega, "omega", 0, -1), Parameter(zeta, "zeta")),
    signals=(Signal(px, Source.RESONATOR, 0), Signal(py, Source.RESONATOR, 1)),
    sense=(rx * px, ry * py),
    source="p̈ + 2ζωp ṗ + ωp² p = γ u, sensed as + c p; only γc is seen",
    signature="a resonant peak of the innovation, its phase that of the drive",
    compensation=Compensation.MAP,
    look_alikes={"interference": "its phase follows the drive"},
    search=Search.MODES,
)

FREE_MODE = Effect(
    name="free_mode",
    number=42,
    rare=True,
    title="Another mode that rings freely",
    coefficients=(
        Coefficient(wm, "wm", 1e-3, 0, -1, positive=True, start=3.0, least=0.01),
        Coefficient(dm, "dm", 1e-3, 0, -1, positive=True, start=0.01),
        Coefficient(cmx, "cmx", 0.1, volt=1, own=True),
        Coefficient(smx, "smx", 0.1, volt=1, own=True),
        Coefficient(cmy, "cmy", 0.1, volt=1, own=True),
        Coefficient(smy, "smy", 0.1, volt=1, own=True),
    ),
    signals=(Signal(time, Source.TIME),),
    sense=(
        exp(-dm * time / 2) * (cmx * cos(wm * time) + smx * sin(wm * time)),
        exp(-dm * time / 2) * (cmy * cos(wm * time) + smy * sin(wm * time)),
    ),
    source="p̈ + dm ṗ + (wm² + dm²/4) p = 0, a mode beside the one that is modelled; displacement, velocity and "
    "acceleration of it are all of that form; Ewins, Modal Testing, 2000",
    signature="another line that dies away at a rate of its own",
    compensation=Compensation.MAP,
    look_alikes={"interference": "a longer record: a line does not die away", "parasitic_mode": "a drive"},
    search=Search.RINGS,
)
