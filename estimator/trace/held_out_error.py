"""How far a free run is off on a record that it was not fitted to: the record tells its start and nothing else."""

import numpy as np

from estimator.observer import Observer
from estimator.record import Record
from estimator.refinement import refine
from estimator.scaling import Array
from estimator.simulation import simulate


def held_out_error(observer: Observer, state: Array, record: Record, first: int) -> Array:
    """Residual (n, axes) V of the free run with the constants of `state` (states + constants,) SI.

    The first outputs, and those behind each gap, set the motion and are NaN, as is a stretch between gaps that has no
    more of them.
    """
    start = np.array(state, dtype=float)
    own = [c.name for _, effect in observer.effects for c in effect.coefficients if c.own]
    motion = (*observer.names[: observer.states], *own)
    start[[observer.names.index(name) for name in motion]] = 0.0
    residual = np.full_like(record.sense, np.nan)
    for stretch in record.stretches:
        part = record.part(stretch)
        beginning = part.part(slice(0, first))
        if len(part) <= first or int(np.sum(np.isfinite(beginning.sense))) < len(motion):
            continue
        begun = refine(observer, beginning.sense, beginning.drive, start=start, free=motion, step=beginning.step).state
        error = part.sense - simulate(observer, begun, part.drive, step=part.step).sensed
        residual[stretch][first:] = error[first:]
    return residual
