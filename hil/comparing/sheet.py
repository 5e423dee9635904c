"""The figures of a data sheet for what a method made of a record, as `hil characterise` has them of a run."""

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from estimator.characteristics.angle_map import pattern_angle
from hil.characterising.figures import figures_of
from hil.characterising.source import Axis, Block
from hil.comparing.course import MethodCourse, Reference
from hil.records.methods import SheetFigures
from hil.records.truth import Truth

Floats = npt.NDArray[np.float64]
Pattern = Callable[[npt.NDArray[np.int64]], Floats]
"""The pattern's angle θ (n,) in the device's frame at ticks (n,)."""

_LEAST = 30


def pattern_of(truth: Truth, stiffness_per_s2: float) -> Pattern:
    """That of the true motion, between its rows straight."""
    x, vx, y, vy = (np.asarray(truth[name], float) for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
    theta = 0.5 * np.unwrap(2.0 * pattern_angle(x, vx, y, vy, stiffness_per_s2))
    return lambda tick: np.asarray(np.interp(tick, truth.tick, theta))


def sheet_of(
    course: MethodCourse, reference: Reference, pattern: Pattern | None, rate_Hz: float, from_s: float
) -> SheetFigures:
    """Value and 95 % interval by the figure's name, SI; nothing of an angle that is not finite, or too short."""
    scored = course.tick >= from_s * rate_Hz
    tick, angle = course.tick[scored], course.angle[scored]
    if tick.size < _LEAST or not np.isfinite(angle).all():
        return {}
    every = int(np.median(np.diff(tick)))
    seconds = np.diff(tick) / rate_Hz
    true = np.diff(reference.at(tick)[0]) / seconds
    theta = None if pattern is None or course.own_record else pattern(tick)
    middle = None if theta is None else 0.5 * (theta[1:] + theta[:-1])

    def blocks() -> Iterator[Block]:
        yield Block(tick[1:] // every, np.diff(angle) / seconds, true, None, middle)

    first, last = int(tick[1] // every), int(tick[-1] // every)
    axis = Axis(course.name, rate_Hz / every, first, last + 1 - first, first, False, blocks)
    found = figures_of([axis]).found
    return {
        name: (one.value, one.low, one.high)
        for name, one in found.items()
        if name != "start_up" and np.isfinite(one[:3]).all()
    }
