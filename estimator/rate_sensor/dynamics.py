"""What time does to a rate on its way: lags, delays, and a reference that is itself a sensor."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, cont2discrete, filtfilt, lfilter, ss2tf

from estimator.rate_sensor.declaration import Effect, Range, Stage
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array
from estimator.trace.likelihood import Size

_SHARE = 0.1  # of the record, the slowest response that it tells of
_SAMPLES = 4.0  # the same at least, of a record of few samples
_DIES = 1e-3  # of an interval: a response as quick as that is none
_WIDEST = 100.0  # longest over shortest start, from which on one between them is tried too


def _step(record: SensorRecord) -> float:
    assert record.step is not None  # effects of this page need time
    return record.step


class Response(NamedTuple):
    """A response of unit gain at rest from one sample to the next: ẋ = A x + b u, y = c x, with u straight between."""

    numerator: Array
    denominator: Array

    @classmethod
    def of(cls, a: Array, b: Array, c: Array, step: float) -> "Response":
        """Of the system in time."""
        ad, bd, cd, dd, _ = cont2discrete((a, b, c, np.zeros((1, 1))), step, "foh")
        numerator, denominator = ss2tf(ad, bd, cd, dd)
        return cls(numerator[0], denominator)

    def to(self, rate: Array) -> Array:
        """Of a rate (n,), started at rest with the first sample."""
        return np.asarray(rate[0] + lfilter(self.numerator, self.denominator, rate - rate[0]))

    def free(self, record: SensorRecord) -> Array:
        """What a start that was not at rest may add (n, k), a column for each stretch and number that is unknown."""
        columns = []
        for stretch in record.stretches:
            for late in range(len(self.denominator) - 1):
                column, kick = np.zeros(len(record)), np.zeros(stretch.stop - stretch.start)
                kick[late : late + 1] = 1.0
                column[stretch] = lfilter([1.0], self.denominator, kick)
                columns.append(column)
        return np.array(columns).T


def first_order(tau: float, step: float) -> Response:
    """τ ẏ + y = Ω; one that is over within a small part of a step is none."""
    tau = max(tau, _DIES * step)
    return Response.of(np.array([[-1.0 / tau]]), np.array([[1.0 / tau]]), np.array([[1.0]]), step)


def second_order(frequency: float, damping: float, step: float) -> Response:
    """ÿ + 2ζω ẏ + ω² y = ω² Ω, frequency in Hz."""
    w = 2.0 * math.pi * frequency
    a = np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])
    return Response.of(a, np.array([[0.0], [w * w]]), np.array([[1.0, 0.0]]), step)


def _longest(record: SensorRecord) -> float:
    """The slowest response that a record tells of, s."""
    return max(_SHARE * float(record.time[-1]), _SAMPLES * _step(record))


def _times(record: SensorRecord, first: float, *others: float) -> tuple[tuple[float, ...], ...]:
    """Starts of a time, in steps; of a long record one that is far longer, too."""
    step, longest = _step(record), _longest(record)
    last = max(first, *others) if others else first
    far = (math.sqrt(last * step * longest),) if longest > _WIDEST * last * step else ()
    return tuple((min(value, longest),) for value in (*(one * step for one in (first, *others)), *far))


def _up_to_longest(record: SensorRecord, declared: Range) -> tuple[tuple[float, float], ...]:
    return ((0.0, _longest(record)),)


def _each(record: SensorRecord, rate: Array, act: Callable[[Array], Array]) -> Array:
    """What acts on a rate with a memory, on each stretch by itself."""
    return np.concatenate([act(rate[stretch]) for stretch in record.stretches])


def _lag(c: Array, record: SensorRecord) -> Response:
    return first_order(float(c[0]), _step(record))


def _low_pass(c: Array, record: SensorRecord) -> Response:
    return second_order(float(c[0]), float(c[1]), _step(record))


LAG = Effect(
    name="lag",
    title="First-order lag",
    equations=("τ ẏ + y = Ω",),
    coefficients=(Size("tau", "s", positive=True),),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: _each(record, rate, _lag(c, record).to),
    starts=lambda record, declared: _times(record, 2.0, 10.0),
    bounds=_up_to_longest,
    transient=lambda c, record: _lag(c, record).free(record),
    source="output filter of one pole",
    compensation="the lag is inverted, at the cost of noise",
    needs="time",
    look_alikes={"delay": "faster changes of the rate", "second_order": "faster changes of the rate"},
)

SECOND_ORDER = Effect(
    name="second_order",
    title="Second-order low-pass",
    equations=("ÿ + 2ζω ẏ + ω² y = ω² Ω",),
    coefficients=(Size("f", "Hz", positive=True), Size("zeta", "1", positive=True)),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: _each(record, rate, _low_pass(c, record).to),
    starts=lambda record, declared: tuple((0.3 / time, 0.7) for (time,) in _times(record, 10.0, 3.0)),
    bounds=lambda record, declared: ((0.1 / _longest(record), 0.5 / _step(record)), (0.05, 5.0)),
    transient=lambda c, record: _low_pass(c, record).free(record),
    source="bandwidth of a vibrating sensor, its demodulator and filter; IEEE Std 1431",
    compensation="the filter is inverted, at the cost of noise",
    needs="time",
    generalises=("lag",),
    look_alikes={"lag": "faster changes of the rate"},
)


def _delayed(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    late = float(c[0]) / _step(record)

    def shifted(part: Array) -> Array:
        rows = np.arange(len(part)) - late
        return np.asarray(np.interp(rows, np.arange(len(part)), part))

    return _each(record, rate, shifted)


DELAY = Effect(
    name="delay",
    title="Delay",
    equations=("Ω(t) → Ω(t − τ)",),
    coefficients=(Size("delay", "s", positive=True),),
    stage=Stage.RATE,
    act=_delayed,
    starts=lambda record, declared: _times(record, 0.5, 5.0),
    bounds=_up_to_longest,
    reaches=lambda c: float(c[0]),
    source="transport through a digital output",
    compensation="the estimate is predicted over it",
    needs="time",
    generalises=("lag",),
    look_alikes={"lag": "faster changes of the rate"},
)


def moving_mean(rate: Array, window: float, step: float) -> Array:
    """Mean of the rate over the last `window` seconds, the rate straight between its samples and at rest before."""
    times = np.arange(len(rate)) * step
    turned = np.concatenate([[0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))])
    if window < _DIES * step or len(rate) < 2:
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
    equations=("Ω → (1/T) ∫ Ω dt over the last T",),
    coefficients=(Size("T", "s", positive=True),),
    stage=Stage.RATE,
    act=lambda rate, c, record, declared: _each(
        record, rate, lambda part: moving_mean(part, float(c[0]), _step(record))
    ),
    starts=lambda record, declared: _times(record, 3.0, 15.0),
    bounds=_up_to_longest,
    reaches=lambda c: float(c[0]),
    source="digital output that averages: a comb filter of first order; Hogenauer 1981",
    compensation="nothing: its zeros take rates at multiples of 1/T out of the record",
    needs="time",
    look_alikes={"lag": "faster changes of the rate", "delay": "faster changes of the rate"},
)


def _lead(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    def led(part: Array) -> Array:
        return np.asarray(part + c[0] * np.gradient(part, _step(record))) if len(part) > 1 else part

    return _each(record, rate, led)


REFERENCE_LAG = Effect(
    name="reference_lag",
    title="First-order lag of the reference",
    equations=("Ω = r + τr ṙ of the reference's reading r",),
    coefficients=(Size("tau_r", "s", positive=True),),
    stage=Stage.REFERENCE,
    act=_lead,
    starts=lambda record, declared: _times(record, 1.0),
    bounds=_up_to_longest,
    source="a reference that is a sensor has a bandwidth of its own",
    compensation="nothing to undo in the sensor",
    needs="time",
    look_alikes={"lag": "a faster reference"},
)


def _quiet(rate: Array, c: Array, record: SensorRecord, declared: Range) -> Array:
    numerator, denominator = butter(2, min(2.0 * float(c[0]) * _step(record), 0.99))

    def quiet(part: Array) -> Array:
        reach = min(3 * len(denominator), len(part) - 1)
        return np.asarray(filtfilt(numerator, denominator, part, padlen=reach)) if reach > 0 else part

    return _each(record, rate, quiet)


REFERENCE_NOISE = Effect(
    name="reference_noise",
    title="Noise of the reference",
    equations=("Ω = the part of the reading below f_r, without phase",),
    coefficients=(Size("f_r", "Hz", positive=True),),
    stage=Stage.REFERENCE,
    act=_quiet,
    starts=lambda record, declared: ((0.1 / _step(record),), (0.2 / _step(record),)),
    bounds=lambda record, declared: ((0.01 / _step(record), 0.49 / _step(record)),),
    source="errors in variables: what the reference reads above f_r is not rotation",
    compensation="nothing to undo in the sensor",
    needs="time",
)
