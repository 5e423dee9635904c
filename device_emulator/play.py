"""Elements whose foot the mass takes along with play: steps that end where it catches its foot and where it leaves it.

Between two such events the foot rests or goes with the mass, and the integrator of the plant is of its full order. The
events themselves are found by bisection over the length of the step, to rounding.

States of an element: foot and hold of x, foot and hold of y; hold is 1 or -1 while the mass takes the foot along in
that direction, else 0.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.compiled import compiled
from device_emulator.effects.force import ForceKind
from device_emulator.plant import STATES, step

_HALVED = 60
_MOST_EVENTS = 64
"""In one step; what is left of it is taken in one."""
_BEYOND = 1.0 + 1e-12
"""Of the half-width: rounding is no event."""


@compiled
def has_play(hidden: NDArray[Any]) -> bool:
    """Whether there is an element with play among the effects."""
    found = False
    for effect in hidden:
        found |= effect.kind == ForceKind.PLAY
    return found


@compiled
def put_feet(hidden: NDArray[Any], motion: NDArray[np.float64]) -> None:
    """The feet where a mass leaves them that came from 0 to where it is."""
    for effect in hidden:
        if effect.kind == ForceKind.PLAY:
            width = effect.c[2]
            for axis in range(2):
                x = motion[2 * axis]
                motion[effect.at + 2 * axis] = max(x - width, min(x + width, 0.0))
                motion[effect.at + 2 * axis + 1] = 0.0


@compiled
def step_with_play(
    plant: Any,
    hidden: NDArray[Any],
    piece: Any,
    t_s: float,
    h: float,
    push: NDArray[np.float64],
    n: int,
    motion: NDArray[np.float64],
    stages: NDArray[np.float64],
) -> None:
    """`plant.step`, in pieces that end where a mass catches or leaves a foot."""
    own = push.copy()
    begin = np.empty(STATES)
    since = 0.0
    for _ in range(_MOST_EVENTS):
        begin[:] = motion
        step(plant, hidden, piece, t_s + since, h - since, own, n, motion, stages)
        if not _passed(hidden, motion):
            return
        low, high = 0.0, h - since
        for _ in range(_HALVED):
            middle = 0.5 * (low + high)
            motion[:] = begin
            step(plant, hidden, piece, t_s + since, middle, own, n, motion, stages)
            if _passed(hidden, motion):
                high = middle
            else:
                low = middle
        motion[:] = begin
        step(plant, hidden, piece, t_s + since, high, own, n, motion, stages)
        _change(hidden, motion)
        own[0] += high * own[2]
        own[1] += high * own[3]
        since += high
        if not since < h:
            return
    step(plant, hidden, piece, t_s + since, h - since, own, n, motion, stages)


@compiled
def _passed(hidden: NDArray[Any], motion: NDArray[np.float64]) -> bool:
    """Whether a foot that rests is further away than its half-width, or a mass turns that takes its foot along."""
    for effect in hidden:
        if effect.kind == ForceKind.PLAY:
            for axis in range(2):
                hold = motion[effect.at + 2 * axis + 1]
                if hold != 0.0 and hold * motion[2 * axis + 1] < 0.0:
                    return True
                if hold == 0.0 and abs(motion[2 * axis] - motion[effect.at + 2 * axis]) > _BEYOND * effect.c[2]:
                    return True
    return False


@compiled
def _change(hidden: NDArray[Any], motion: NDArray[np.float64]) -> None:
    """Catch and leave feet as the motion says; one that is caught, or was, is exactly the half-width away."""
    for effect in hidden:
        if effect.kind == ForceKind.PLAY:
            width = effect.c[2]
            for axis in range(2):
                at = effect.at + 2 * axis
                x, v, foot, hold = motion[2 * axis], motion[2 * axis + 1], motion[at], motion[at + 1]
                if hold != 0.0:
                    motion[at] = x - hold * width
                    if hold * v < 0.0:
                        motion[at + 1] = 0.0
                elif abs(x - foot) > _BEYOND * width:
                    motion[at + 1] = 1.0 if x > foot else -1.0
                    motion[at] = x - motion[at + 1] * width
