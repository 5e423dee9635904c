"""What no record can tell from something else, since the equations are the same in other words; who measured it
declares it.

*Clock.* One second of the board lasts 1 + δ seconds: t = (1 + δ) t′, d/dt′ = (1 + δ) d/dt.  The equation of motion (2),
written in the time t′ of the record,

    x″ = (1 + δ)² (u − K x) − (1 + δ) D x′ + 2 (1 + δ) Ω C x′ + …,    C = [[0, 1], [−1, 0]]

is that of a device with K and u larger by (1 + δ)², D by 1 + δ, and a rate Ω′ = (1 + δ) Ω.  The effect adds what K, u
and D make; they are then per second of true time.  The rate stays Ω′, radians per second of the board, like every other
time of the record: an angle has no unit of time, and ∫ Ω′ dt′ is the true one.

*Masses.* y moves 1 + m times the mass that x moves, as where a frame goes along.  Forces are the same, accelerations
are not: with M = diag(1, 1 + m), M ẍ = u − D ẋ − K x + 2 Ω C ẋ + Ω̇ C x + M Ω² x, everything over the mass of x.  The
Coriolis force comes from the mass that both axes share (Lagrange's equation: of the mass at (x, y) and a frame at
(0, y) only the mass has Ω (x ẏ − y ẋ) in its energy), so it is antisymmetric as a force and does no work; Ω² acts on
the frame, too.  A Coriolis force in proportion to each axis' own mass would do work, −2 m Ω ẋ ẏ, out of nothing.

*Polarity.* A channel with its two wires swapped: u → −u of an axis, or x → −x of what it shows.

None of them has a coefficient: nothing in a record could estimate it.
"""

from estimator.effects.declaration import Compensation, Effect, Parameter, Signal, Source
from estimator.model.formula import symbols
from estimator.model.symbols import dxx, dxy, dyy, kxx, kxy, kyy, rate, ux, uy, vx, vy, x, y

delta, m, px, py = symbols("delta m px py")

_STRETCH = (1 + delta) ** 2 - 1
_LIGHTER = -m / (1 + m)


_SWITCHES = (
    Parameter(px, "px", default=0.0, choices=(0.0, 1.0)),
    Parameter(py, "py", default=0.0, choices=(0.0, 1.0)),
)
_SWITCHED = (Signal(px, Source.PARAMETER), Signal(py, Source.PARAMETER))

CLOCK_RATE = Effect(
    name="clock_rate",
    number=32,
    title="A second of the board is not a second",
    coefficients=(),
    parameters=(Parameter(delta, "delta", above=-1.0),),
    signals=(Signal(delta, Source.PARAMETER),),
    force=(
        _STRETCH * (ux - kxx * x - kxy * y) - delta * (dxx * vx + dxy * vy),
        _STRETCH * (uy - kxy * x - kyy * y) - delta * (dxy * vx + dyy * vy),
    ),
    source="(2) with t = (1 + δ) t′, t′ the board's; the rate stays per second of the board: an angle has no unit",
    signature="none: a drive gain of both axes, (1 + δ)² − 1, with other stiffness and damping",
    compensation=Compensation.INVERT,
    look_alikes={"drive_gain": "a reference clock"},
)

UNEQUAL_MASSES = Effect(
    name="unequal_masses",
    number=33,
    title="The mass that moves along y is 1 + m times that along x",
    coefficients=(),
    parameters=(Parameter(m, "m", above=-1.0),),
    signals=(Signal(m, Source.PARAMETER),),
    force=(
        0,
        _LIGHTER * (uy - dxy * vx - dyy * vy - kxy * x - kyy * y - 2 * rate * vx),
    ),
    source="M ẍ = u − D ẋ − K x + 2 Ω C ẋ, M = diag(1, 1 + m): the Coriolis force is that of the mass both axes share",
    signature="none: drive gain and sense gain of y by (1 + m)^(−1/2), with another kxy and rate",
    compensation=Compensation.INVERT,
    look_alikes={"sense_gain": "tilts of each axis by the same angle", "drive_gain": "a varying rate"},
)

DRIVE_POLARITY = Effect(
    name="drive_polarity",
    number=34,
    title="The drive of an axis acts the wrong way round",
    coefficients=(),
    parameters=_SWITCHES,
    signals=_SWITCHED,
    force=(-2 * px * ux, -2 * py * uy),
    source="u → −u of an axis with 1; the bench file has no sign of one axis' drive",
    signature="none: the polarity of its sense, with kxy, dxy and the rate of the other sign",
    compensation=Compensation.INVERT,
    look_alikes={"sense_polarity": "tilting that axis: gravity tells the sign of its sense"},
)

SENSE_POLARITY = Effect(
    name="sense_polarity",
    number=35,
    title="The sense of an axis shows the wrong way round",
    coefficients=(),
    parameters=_SWITCHES,
    signals=_SWITCHED,
    sense=(-2 * px * x, -2 * py * y),
    source="x → −x of an axis with 1; the other sign of [device.sense] gain_V_per_m of that axis does the same",
    signature="none: the polarity of its drive, with kxy, dxy and the rate of the other sign",
    compensation=Compensation.MAP,
    look_alikes={"drive_polarity": "tilting that axis: gravity tells the sign of its sense"},
)
