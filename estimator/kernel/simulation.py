"""A whole record run freely: the flow from sample to sample with no correction, and what every unknown does to it."""

import numpy as np

from estimator.kernel.compiled import compiled, generated
from estimator.kernel.flow import advance, begin_ways, part_of
from estimator.kernel.layout import MAX_AXES, Floats, Record
from estimator.kernel.observer import flow_work
from estimator.kernel.sensing import sensed_otherwise, senses_otherwise
from estimator.kernel.signals import line_values
from estimator.kernel.structures import Interval

_sense = generated().sense
_effect_sense = generated().effect_sense


@compiled
def sensed_at(
    settings: Record,
    c: Floats,
    s: Floats,
    drive: Floats,
    signals: Floats,
    predicted: Floats,
    by_states: Floats,
    by_constants: Floats,
) -> None:
    """Measurement (axes,) at state s, drive and signals, and its derivatives (axes, states), (axes, constants)."""
    full = np.zeros((2, s.shape[0] + c.shape[0]))
    _sense(settings.model, c, s, predicted, full)
    for axis in range(settings.axes):
        for j in range(s.shape[0]):
            by_states[axis, j] = full[axis, j]
        for j in range(c.shape[0]):
            by_constants[axis, j] = full[axis, s.shape[0] + j]
    for e in range(settings.effect_count):
        number, first, signal = settings.effects[e]
        _effect_sense(
            number, settings.model, c, s, drive, signals, first, signal, predicted, by_states, by_constants
        )  # fmt: skip


@compiled
def free_run(
    settings_record: Record,
    x: Floats,
    u: Floats,
    h: Floats,
    parts: int,
    sensitive: bool,
    sensed: Floats,
    sensitivity: Floats,
) -> None:
    """Run from x = [state at the first sample, constants] under u (n, axes, degree + 1) over the steps h (n,).

    Each step is taken in `parts` equal parts: the flow's impulses are exact in the limit of many.  sensed (n, axes);
    with `sensitive` also sensitivity (n, axes, states + constants), the derivative by x, else 0 rows of it.  The
    columns of the flow are carried from step to step as they are: they begin as the derivatives by the first state.
    """
    settings = settings_record[0]
    states = settings.states
    sense_constants = settings.sense_constants
    total = x.shape[0]
    columns = 1 + states + settings.flow_constants if sensitive else 1
    work = flow_work(settings, total - states, columns)
    out, push = work.out, work.push
    signals = push.signals
    time = 0.0
    for i in range(settings.signal_count):
        signals[i] = settings.signal_parameters[i, 0]  # what is not a constant is written over as it moves
    otherwise = senses_otherwise(settings)
    drive = np.zeros(MAX_AXES)
    predicted = np.zeros(MAX_AXES)
    full = np.zeros((2, total))
    by_states, by_constants = full[:, :states], full[:, states:]
    s = x[:states].copy()
    c = x[states:]
    for i in range(states):
        out[i, 0] = s[i]
        if sensitive:
            out[i, 1 + i] = 1.0
    begin_ways(settings, c, s, columns, push.slips)
    for m in range(sensed.shape[0]):
        if m > 0:
            for part in range(parts):
                piece = u[m] if parts == 1 else part_of(u[m], part / parts, 1.0 / parts)
                advance(settings, Interval(time, h[m] / parts, piece), c, columns, work)
                time += h[m] / parts
            for i in range(states):
                s[i] = out[i, 0]
        for axis in range(settings.axes):
            drive[axis] = u[m, axis].sum()  # at the end of the interval
        predicted[:] = 0.0
        full[:] = 0.0
        line_values(settings, time, signals)
        if otherwise:
            push.drive[:] = drive
            sensed_otherwise(settings, c, s, push, predicted, by_states, by_constants)
        else:
            sensed_at(settings, c, s, drive, signals, predicted, by_states, by_constants)
        for axis in range(settings.axes):
            sensed[m, axis] = predicted[axis]
            if sensitive:
                for j in range(total):
                    value = by_constants[axis, j - states] if j >= states else 0.0
                    column = 1 + j if j < states else 1 + j - sense_constants
                    if j < states or j >= states + sense_constants:
                        for k in range(states):
                            value += by_states[axis, k] * out[k, column]
                    sensitivity[m, axis, j] = value
