"""What time does to a rate on its way: lags, delays, and a reference that is itself a sensor."""

import math

import numpy as np
from scipy.signal import butter, cont2discrete, filtfilt, lfilter, ss2tf

from estimator.rate_sensor.declaration import Coefficient, Effect, Range, Stage
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array

_LONGEST = 0.1  # s, the slowest response that is searched


def _step(record: SensorRecord) -> float:
    assert record.step is not None  # effects of this page need time
    return record.step


def _filtered(rate: Array, a: Array, b: Array, c: Array, step: float) -> Array:
    """Response of ẋ = A x + b u, y = c x, of unit gain at rest, to a rate that is straight between its samples."""
    ad, bd, cd, dd, _ = cont2discrete((a, b, c, np.zeros((1, 1))), step, "foh")
    numerator, denominator = ss2tf(ad, bd, cd, dd)
    return np.asarray(rate[0] + lfilter(numerator[0], denominator, rate - rate[0]))


def first_order(rate: Array, tau: float, step: float) -> Array:
    """Rate behind τ ẏ + y = Ω, started at rest with the first sample."""
    if tau < 1e-3 * step:
        return rate
    return _filtered(rate, np.array([[-1.0 / tau]]), np.array([[1.0 / tau]]), np.array([[1.0]]), step)


def second_order(rate: Array, frequency: float, damping: float, step: float) -> Array:
    """Rate behind ÿ + 2ζω ẏ + ω² y = ω² Ω, frequency in Hz."""
    w = 2.0 * math.pi * frequency
    a = np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])
    return _filtered(rate, a, np.array([[0.0], [w * w]]), np.array([[1.0, 0.0]]), step)


def _quickest(record: SensorRecord) -> float:
    return 0.5 * _step(record)


LAG = Effect(
    name="lag",
    title="First-order lag",
    equation="τ ẏ + y = Ω",
    coefficients=(Coefficient("tau", "s"),),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: first_order(rate, float(c[0]), _step(record)),
    starts=lambda record, declared: ((2.0 * _step(record),), (10.0 * _step(record),)),
    bounds=lambda record, declared: ((0.0, _LONGEST),),
    source="output filter of one pole",
    undone="the lag is inverted, at the cost of noise",
    needs="time",
    look_alikes={"delay": "faster changes of the rate", "second_order": "faster changes of the rate"},
)

SECOND_ORDER = Effect(
    name="second_order",
    title="Second-order low-pass",
    equation="ÿ + 2ζω ẏ + ω² y = ω² Ω",
    coefficients=(Coefficient("f", "Hz"), Coefficient("zeta", "1")),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: second_order(rate, float(c[0]), float(c[1]), _step(record)),
    starts=lambda record, declared: ((0.03 / _step(record), 0.7), (0.1 / _step(record), 0.7)),
    bounds=lambda record, declared: ((0.5 / _LONGEST, 0.5 / _step(record)), (0.05, 5.0)),
    source="bandwidth of a vibrating sensor, its demodulator and filter; IEEE Std 1431",
    undone="the filter is inverted, at the cost of noise",
    needs="time",
    look_alikes={"lag": "faster changes of the rate"},
)


def _delayed(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    rows = np.arange(len(rate))
    return np.asarray(np.interp(rows - c[0] / _step(record), rows, rate))


DELAY = Effect(
    name="delay",
    title="Delay",
    equation="Ω(t) → Ω(t − τ)",
    coefficients=(Coefficient("delay", "s"),),
    stage=Stage.RATE,
    act=_delayed,
    starts=lambda record, declared: ((_quickest(record),), (5.0 * _step(record),)),
    bounds=lambda record, declared: ((0.0, _LONGEST),),
    source="transport through a digital output",
    undone="the estimate is predicted over it",
    needs="time",
    look_alikes={"lag": "faster changes of the rate"},
)


def moving_mean(rate: Array, window: float, step: float) -> Array:
    """Mean of the rate over the last `window` seconds, the rate straight between its samples and at rest before."""
    times = np.arange(len(rate)) * step
    turned = np.concatenate([[0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))])
    if window < 1e-3 * step:
        return rate
    before = times - window
    row = np.clip(np.floor(before / step).astype(int), 0, max(len(rate) - 2, 0))
    into = np.maximum(before - row * step, 0.0)
    slope = (rate[row + 1] - rate[row]) / step
    then = np.where(before < 0.0, rate[0] * before, turned[row] + into * (rate[row] + 0.5 * slope * into))
    return np.asarray((turned - then) / window)


MOVING_MEAN = Effect(
    name="moving_mean",
    title="Moving mean",
    equation="Ω → (1/T) ∫ Ω dt over the last T",
    coefficients=(Coefficient("T", "s"),),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: moving_mean(rate, float(c[0]), _step(record)),
    starts=lambda record, declared: ((3.0 * _step(record),), (15.0 * _step(record),)),
    bounds=lambda record, declared: ((0.0, _LONGEST),),
    source="digital output that averages: a comb filter of first order; Hogenauer 1981",
    undone="nothing: its zeros take rates at multiples of 1/T out of the record",
    needs="time",
    look_alikes={"lag": "faster changes of the rate", "delay": "faster changes of the rate"},
)


def _lead(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    return np.asarray(rate + c[0] * np.gradient(rate, _step(record)))


REFERENCE_LAG = Effect(
    name="reference_lag",
    title="First-order lag of the reference",
    equation="Ω = r + τr ṙ of the reference's reading r",
    coefficients=(Coefficient("tau_r", "s"),),
    stage=Stage.REFERENCE,
    act=_lead,
    starts=lambda record, declared: ((_step(record),),),
    bounds=lambda record, declared: ((0.0, _LONGEST),),
    source="a reference that is a sensor has a bandwidth of its own",
    undone="nothing to undo in the sensor",
    needs="time",
    look_alikes={"lag": "a faster reference"},
)


def _quiet(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    numerator, denominator = butter(2, min(2.0 * float(c[0]) * _step(record), 0.99))
    return np.asarray(filtfilt(numerator, denominator, rate))


REFERENCE_NOISE = Effect(
    name="reference_noise",
    title="Noise of the reference",
    equation="Ω = the part of the reading below f_r, without phase",
    coefficients=(Coefficient("f_r", "Hz"),),
    stage=Stage.REFERENCE,
    act=_quiet,
    starts=lambda record, declared: ((0.1 / _step(record),), (0.2 / _step(record),)),
    bounds=lambda record, declared: ((0.01 / _step(record), 0.49 / _step(record)),),
    source="errors in variables: what the reference reads above f_r is not rotation",
    undone="nothing to undo in the sensor",
    needs="time",
    look_alikes={},
)
