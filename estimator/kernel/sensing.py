"""What a sense channel shows where it does not show the displacement: the velocity, or the acceleration.

The sense chain, its offset and its effects, take q and q̇ where they took x and ẋ: ẋ and ẍ of a velocity, ẍ and what the
linear part makes of its derivative of an acceleration.  ẍ is what the whole model says, effects included.
"""

import numpy as np

from estimator.kernel.compiled import compiled, generated
from estimator.kernel.flow import effect_forces
from estimator.kernel.layout import Floats, Record
from estimator.kernel.structures import Push

_field_columns = generated().field_columns
_sense = generated().sense
_effect_sense = generated().effect_sense

VELOCITY = 1


@compiled
def senses_otherwise(settings: Record) -> bool:
    """Whether a channel shows something else than the displacement."""
    otherwise: bool = settings.sensed[0] + settings.sensed[1] > 0
    return otherwise


@compiled
def sensed_motion(settings: Record, c: Floats, s: Floats, push: Push) -> tuple[Floats, Floats]:
    """What the sense chain takes for displacement and velocity (states,) at state s, and its derivatives (states,
    states + constants); drive and signals as they stand in push, whose forces are written over.
    """
    states = s.shape[0]
    constants = c.shape[0]
    columns = 1 + states + settings.flow_constants
    first_flowing = settings.sense_constants
    drive = push.drive
    a = np.zeros((states, columns))
    b = np.zeros((states, columns))
    for i in range(states):
        a[i, 0] = s[i]
        a[i, 1 + i] = 1.0
    _field_columns(settings.model, c, a, drive, b, columns)
    linear = b[:, 1 : 1 + states].copy()
    effect_forces(settings, c, s, push)
    # ṡ and its derivatives, by states and by constants.
    slope = b[:, 0].copy()
    slope_by = np.zeros((states, states + constants))
    for i in range(states):
        for j in range(states):
            slope_by[i, j] = linear[i, j]
        for k in range(settings.flow_constants):
            slope_by[i, states + first_flowing + k] = b[i, 1 + states + k]
    for axis in range(settings.axes):
        row = 2 * axis + 1
        slope[row] += push.force[axis]
        for j in range(states):
            slope_by[row, j] += push.by_states[axis, j]
        for k in range(constants):
            slope_by[row, states + k] += push.by_constants[axis, k]
    q = s.copy()
    q_by = np.zeros((states, states + constants))
    for i in range(states):
        q_by[i, i] = 1.0
    for axis in range(settings.axes):
        row = 2 * axis
        if settings.sensed[axis] == 0:
            continue
        if settings.sensed[axis] == VELOCITY:
            q[row] = s[row + 1]
            q_by[row] = 0.0
            q_by[row, row + 1] = 1.0
            q[row + 1] = slope[row + 1]
            q_by[row + 1] = slope_by[row + 1]
            continue
        q[row] = slope[row + 1]
        q_by[row] = slope_by[row + 1]
        q[row + 1] = 0.0
        q_by[row + 1] = 0.0
        for i in range(states):
            q[row + 1] += linear[row + 1, i] * slope[i]
            for j in range(states + constants):
                q_by[row + 1, j] += linear[row + 1, i] * slope_by[i, j]
        # What the linear part makes of the slope moves with the constants, too: it is the field there, without a drive.
        a[:] = 0.0
        for i in range(states):
            a[i, 0] = slope[i]
        _field_columns(settings.model, c, a, np.zeros(settings.axes), b, columns)
        for k in range(settings.flow_constants):
            q_by[row + 1, states + first_flowing + k] += b[row + 1, 1 + states + k]
    return q, q_by


@compiled
def sensed_otherwise(
    settings: Record,
    c: Floats,
    s: Floats,
    push: Push,
    predicted: Floats,
    by_states: Floats,
    by_constants: Floats,
) -> None:
    """Measurement (axes,) at state s and its derivatives (axes, states), (axes, constants), effects included; drive and
    signals as they stand in push, whose forces are written over.
    """
    states = s.shape[0]
    constants = c.shape[0]
    drive, signals = push.drive, push.signals
    q, q_by = sensed_motion(settings, c, s, push)
    full = np.zeros((2, states + constants))
    _sense(settings.model, c, q, predicted, full)
    for e in range(settings.effect_count):
        number, first, signal = settings.effects[e]
        _effect_sense(
            number, settings.model, c, q, drive, signals, first, signal, predicted, full[:, :states], full[:, states:]
        )  # fmt: skip
    for axis in range(settings.axes):
        for j in range(states + constants):
            value = full[axis, j] if j >= states else 0.0
            for i in range(states):
                value += full[axis, i] * q_by[i, j]
            if j < states:
                by_states[axis, j] = value
            else:
                by_constants[axis, j - states] = value
