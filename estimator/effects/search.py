"""How a trace looks for an effect, as its declaration says it."""

from enum import Enum, StrEnum


class Sign(StrEnum):
    """What a residual may show (`estimator.residual`), and with it which effects are suspected.  Lines are named by
    their order: multiples of the resonance.
    """

    LINE_0 = "line at 0"
    LINE_1 = "line at 1"
    LINE_2 = "line at 2"
    LINE_3 = "line at 3"
    LINE_4 = "line at 4"
    LINE_5 = "line at 5"
    LINE_ELSEWHERE = "line elsewhere"
    ALWAYS = "always"
    AMPLITUDE = "amplitude"
    SIN_2 = "sin 2θ"
    COS_2 = "cos 2θ"
    SIN_4 = "sin 4θ"
    COS_4 = "cos 4θ"
    RATE = "rate"
    DRIVE = "drive"
    TEMPERATURE = "temperature"
    FLOOR = "floor"


EVEN = (Sign.LINE_0, Sign.LINE_2, Sign.LINE_4)
ODD = (Sign.LINE_3, Sign.LINE_5)
LINEAR = (Sign.LINE_1, Sign.ALWAYS)


class Search(Enum):
    """Where a trace takes the values at which it watches an effect that has parameters; how many of them, and which
    shares, its thresholds say (`estimator.thresholds`).
    """

    CORNERS = "shares of the resonance, the same in every parameter"
    SPEEDS = "shares of the largest velocity at the declared amplitude"
    LINES = "the strongest lines of the residual"
    LIMITS = "shares of the largest drive"
    BANDS = "shares of the rms drive"
    LEVELS = "shares of the largest displacement that is sensed"
    RINGS = "the lines that a free run leaves: the first two coefficients, a frequency and how fast it dies away"
    MODES = "where the residual follows the drive: a frequency, and the damping ratio seen there"


class Kin(Enum):
    """Effects that a scan cannot choose between: who is akin to the best is tried beside it."""

    DAMPING = "laws of a damping that depends on the amplitude and not on the direction"
    STIFFNESS = "laws of a spring whose stiffness depends on the amplitude"
    EVEN = "laws of even order, of which a vibration shows a shift and its second harmonic"
