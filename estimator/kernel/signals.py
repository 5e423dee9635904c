"""The signals that effects depend on beside state and drive, advanced from sample to sample."""

import math

from estimator.effects.declaration import Source
from estimator.kernel.compiled import compiled
from estimator.kernel.layout import MAX_SIGNALS, Floats, Record

_PARAMETER = Source.PARAMETER.value
_COSINE = Source.COSINE.value
_SINE = Source.SINE.value
_TEMPERATURE = Source.TEMPERATURE.value
_INTEGRAL = Source.INTEGRAL.value
_RESONATOR = Source.RESONATOR.value
_DIRECTION = Source.DIRECTION.value
_DECAY = Source.DECAY.value
_LAG = Source.LAG.value
_WANE = Source.WANE.value
_TIME = Source.TIME.value
_MOST_TERMS = 25


@compiled
def line_values(settings: Record, time: float, w: Floats) -> None:
    """Write the signals that are functions of time into w (signals,)."""
    for i in range(settings.signal_count):
        if settings.signals[i, 0] == _COSINE:
            w[i] = math.cos(settings.signal_parameters[i, 0] * time)
        elif settings.signals[i, 0] == _SINE:
            w[i] = math.sin(settings.signal_parameters[i, 0] * time)
        elif settings.signals[i, 0] == _DECAY:
            w[i] = math.exp(-settings.signal_parameters[i, settings.signals[i, 1]] * time)
        elif settings.signals[i, 0] == _TIME:
            w[i] = time


@compiled
def turns_over(settings: Record, i: int) -> bool:
    """Whether a signal is the direction in which an axis of the device moves."""
    is_one: bool = settings.signals[i, 0] == _DIRECTION and settings.signals[i, 1] < settings.axes
    return is_one


@compiled
def directions(settings: Record, s: Floats, w: Floats) -> None:
    """Write the directions of motion of state s, smooth through rest, into w (2 MAX_SIGNALS,), and into its second half
    their derivatives by the velocity.
    """
    for i in range(settings.signal_count):
        if turns_over(settings, i):
            rest = settings.signal_parameters[i, 0]
            w[i] = math.tanh(s[2 * settings.signals[i, 1] + 1] / rest)
            w[MAX_SIGNALS + i] = (1.0 - w[i] * w[i]) / rest


@compiled
def signal_values(settings: Record, memory: Record, time: float, w: Floats) -> None:
    """Write all signals as they stand in memory, and those of `time`, into w (signals,)."""
    for i in range(settings.signal_count):
        source = settings.signals[i, 0]
        if source == _PARAMETER:
            w[i] = settings.signal_parameters[i, 0]
        elif source == _TEMPERATURE:
            w[i] = memory.temperature
        else:
            w[i] = memory.signals[i, 0]
    line_values(settings, time, w)


@compiled
def lagged(value: float, u: Floats, axis: int, share: float) -> float:
    """What a first-order lag makes of the drive u (axes, degree + 1) of an axis over one interval, exactly; share: its
    time constant over the interval.

    Behind the lag, a polynomial is itself less its derivatives in turn, times the time constant; what the start departs
    from that decays.
    """
    if not share > 0.0:  # none, or a lead, which has no such answer
        total = 0.0
        for n in range(u.shape[1]):
            total += u[axis, n]
        return total
    first = 0.0
    last = 0.0
    at_first = 1.0
    at_last = 1.0
    for n in range(u.shape[1]):
        if n > 0:
            at_first *= -share * n
            at_last = 1.0 - share * n * at_last
        first += u[axis, n] * at_first
        last += u[axis, n] * at_last
    return last + (value - first) * math.exp(-1.0 / share)


@compiled
def leaking(value: float, u: Floats, axis: int, rate: float, h: float) -> float:
    """The integral q of q̇ = u − rate q, of the drive u (axes, degree + 1) of an axis, over an interval, exactly.

    ∫ sⁿ e^(−z(1−s)) ds over 0..1 is the series Σ (−z)ᵏ n!/(n + k + 1)!, and (1 − n times that of one degree less)/z.
    """
    z = rate * h
    total = 0.0
    share = -math.expm1(-z) / z if z > 0.0 else 1.0
    for n in range(u.shape[1]):
        if z > 2.0:
            share = share if n == 0 else (1.0 - n * share) / z
        else:
            term = 1.0 / (n + 1.0)
            share = term
            for k in range(_MOST_TERMS):
                term *= -z / (n + k + 2.0)
                share += term
                if abs(term) < 1e-17:
                    break
        total += u[axis, n] * share
    return value * math.exp(-z) + h * total


@compiled
def advance_signals(settings: Record, memory: Record, c: Floats, u: Floats, h: float) -> None:
    """Carry the signals' recursions in memory over an interval h.

    c: the constants; u (axes, degree + 1) the drive, of which a resonator takes the mean over the interval.
    memory.time is that of its beginning.
    """
    for i in range(settings.signal_count):
        source = settings.signals[i, 0]
        axis = settings.signals[i, 1]
        if axis >= settings.axes:
            continue
        if source == _INTEGRAL:
            memory.signals[i, 0] = leaking(memory.signals[i, 0], u, axis, settings.signal_parameters[i, 0], h)
        elif source == _LAG:
            memory.signals[i, 0] = lagged(memory.signals[i, 0], u, axis, c[settings.signals[i, 2]] / h)
        elif source == _WANE:
            lag = c[settings.signals[i, 2]]
            memory.signals[i, 0] = math.exp(-(memory.time + h) / lag) if lag > 0.0 else 0.0
        elif source == _RESONATOR:
            mean = 0.0
            for n in range(u.shape[1]):
                mean += u[axis, n] / (n + 1.0)
            omega = settings.signal_parameters[i, 0]
            decay = settings.signal_parameters[i, 1] * omega
            ringing = math.sqrt(omega * omega - decay * decay)
            rest = mean / (omega * omega)
            p = memory.signals[i, 0] - rest
            v = memory.signals[i, 1]
            cosine = math.cos(ringing * h)
            sine = math.sin(ringing * h) / ringing
            fade = math.exp(-decay * h)
            memory.signals[i, 0] = rest + fade * (p * cosine + (v + decay * p) * sine)
            memory.signals[i, 1] = fade * (v * cosine - (decay * v + omega * omega * p) * sine)
