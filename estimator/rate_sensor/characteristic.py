"""The static curve: what a steady rate gives beside the straight line."""

import numpy as np

from estimator.core.series import play
from estimator.rate_sensor.declaration import Effect, Range, Stage
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array
from estimator.trace.likelihood import Size

_LARGEST = 0.5  # of the range, the largest deviation at full scale that is still a sensor


def _fraction(record: SensorRecord, declared: Range) -> tuple[tuple[float, float], ...]:
    return ((-_LARGEST, _LARGEST),)


QUADRATIC = Effect(
    name="quadratic",
    title="Quadratic characteristic",
    equations=("Ω → Ω + q Ω²/R",),
    coefficients=(Size("q", "1"),),
    stage=Stage.CHARACTERISTIC,
    act=lambda rate, c, record, declared: c[0] * rate**2 / declared.rate,
    bounds=_fraction,
    source="IEEE Std 1431, even-order nonlinearity of the scale factor",
    compensation="the curve is inverted",
    look_alikes={"scale_asymmetry": "more rates between zero and full scale"},
)

CUBIC = Effect(
    name="cubic",
    title="Cubic characteristic",
    equations=("Ω → Ω + c Ω³/R²",),
    coefficients=(Size("c", "1"),),
    stage=Stage.CHARACTERISTIC,
    act=lambda rate, c, record, declared: c[0] * rate**3 / declared.rate**2,
    bounds=_fraction,
    source="IEEE Std 1431, odd-order nonlinearity of the scale factor",
    compensation="the curve is inverted",
    look_alikes={"saturation": "rates beyond the range: a limit is flat, a cubic turns over"},
)

SCALE_ASYMMETRY = Effect(
    name="scale_asymmetry",
    title="Scale factor that depends on the sense of rotation",
    equations=("Ω → Ω + a |Ω|",),
    coefficients=(Size("a", "1"),),
    stage=Stage.CHARACTERISTIC,
    act=lambda rate, c, record, declared: c[0] * np.abs(rate),
    bounds=_fraction,
    source="IEEE Std 1431, asymmetry error",
    compensation="the curve is inverted",
    look_alikes={"quadratic": "more rates between zero and full scale"},
)


def _dead(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    return np.asarray(-np.clip(rate, -c[0], c[0]))


DEAD_BAND = Effect(
    name="dead_band",
    title="Dead band around zero",
    equations=("Ω → 0 within ±b, Ω ∓ b outside",),
    coefficients=(Size("b", "rad/s", positive=True),),
    stage=Stage.CHARACTERISTIC,
    act=_dead,
    starts=lambda record, declared: ((0.01 * declared.rate,), (0.1 * declared.rate,)),
    bounds=lambda record, declared: ((0.0, 0.5 * declared.rate),),
    source="IEEE Std 1431, dead band",
    compensation="nothing: within the band the rate is not in the record",
    look_alikes={"hysteresis": "approach the same rate from both sides"},
)


HYSTERESIS = Effect(
    name="hysteresis",
    title="Hysteresis",
    equations=("Ω → play(Ω, w): follows at a distance of at most w",),
    coefficients=(Size("w", "rad/s", positive=True),),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: play(rate, float(c[0])),
    starts=lambda record, declared: ((0.02 * declared.rate,),),
    bounds=lambda record, declared: ((0.0, 0.5 * declared.rate),),
    path_dependent=True,
    source="IEEE Std 1431, hysteresis error; the play operator of Krasnosel'skii & Pokrovskii, 1989",
    compensation="nothing: depends on the past of the rate",
    look_alikes={"dead_band": "approach the same rate from both sides"},
)


def _limits(record: SensorRecord, declared: Range) -> tuple[tuple[float, ...], ...]:
    low, high = float(np.min(record.voltage)), float(np.max(record.voltage))
    inside = 0.05 * (high - low)
    return ((low, high), (low + inside, high - inside))


def _limit_bounds(record: SensorRecord, declared: Range, beyond: float = 0.02) -> tuple[tuple[float, float], ...]:
    """Up to `beyond` of the span of what was read outside of it."""
    low, high = float(np.min(record.voltage)), float(np.max(record.voltage))
    middle, reach = 0.5 * (low + high), beyond * (high - low)
    return ((low - reach, middle), (middle, high + reach))


SATURATION = Effect(
    name="saturation",
    title="Saturation of the output",
    equations=("V → lo below lo, hi above hi",),
    coefficients=(Size("lo", "V"), Size("hi", "V")),
    stage=Stage.LIMIT,
    act=lambda volts, c, record, declared: np.clip(volts, c[0], c[1]),
    starts=_limits,
    bounds=_limit_bounds,
    source="output stage at its limits; the data sheet's range ends before",
    compensation="nothing: beyond the limits the rate is not in the record; samples there are to be flagged",
    look_alikes={"cubic": "rates beyond the range: a limit is flat, a cubic turns over"},
)


def _soft(volts: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    low, high, knee_low, knee_high = c
    above = knee_high * np.logaddexp(0.0, (volts - high) / knee_high)
    below = knee_low * np.logaddexp(0.0, (low - volts) / knee_low)
    return np.asarray(volts - above + below)


SOFT_SATURATION = Effect(
    name="soft_saturation",
    title="Saturation of the output with a knee",
    equations=("V → V − w_hi ln(1 + e^((V − hi)/w_hi)) + w_lo ln(1 + e^((lo − V)/w_lo))",),
    coefficients=(
        Size("lo", "V"),
        Size("hi", "V"),
        Size("knee_lo", "V", positive=True),
        Size("knee_hi", "V", positive=True),
    ),
    stage=Stage.LIMIT,
    act=_soft,
    starts=lambda record, declared: tuple(
        (*limits, *(share * declared.volts for share in knees))
        for limits in _limits(record, declared)[:1]
        for knees in ((0.05, 0.05), (0.05, 0.005), (0.005, 0.05))
    ),
    bounds=lambda record, declared: (
        *_limit_bounds(record, declared),
        (1e-3 * declared.volts, 0.3 * declared.volts),
        (1e-3 * declared.volts, 0.3 * declared.volts),
    ),
    source="output stage whose transistors leave their linear range one after the other",
    compensation="the curve is inverted up to its limits; beyond them the rate is not in the record",
    generalises=("saturation",),
    look_alikes={"saturation": "rates close to the limit", "cubic": "rates beyond the range"},
)


def _folded(volts: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    low, high, slope = c
    return np.asarray(volts - (1.0 + slope) * (np.maximum(volts - high, 0.0) - np.maximum(low - volts, 0.0)))


FOLD_BACK = Effect(
    name="fold_back",
    title="An output that comes back beyond its limits",
    equations=("V → hi − s (V − hi) above hi, lo + s (lo − V) below lo",),
    coefficients=(Size("lo", "V"), Size("hi", "V"), Size("s", "1", positive=True)),
    stage=Stage.LIMIT,
    act=_folded,
    starts=lambda record, declared: tuple(
        (*limits, slope) for limits in _limits(record, declared) for slope in (0.2, 1.0)
    ),
    # Its turning point may lie between the rates of a record.
    bounds=lambda record, declared: (*_limit_bounds(record, declared, 0.25), (0.0, 3.0)),
    source="overload of the demodulator or of the closed loop: the gain changes its sign; IEEE Std 1431, input limits",
    compensation="nothing: one voltage is that of two rates",
    generalises=("saturation",),
    look_alikes={"saturation": "rates far beyond the limit", "cubic": "rates far beyond the limit"},
)
