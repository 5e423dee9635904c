"""Which free responses of two axes are traced by their free run, as a single axis is.

An observer that does not know where the motion goes next is no measure of what the model lacks: at thirty samples a
second, or with constants far from the declared, it loses a motion that nothing drives and that a free run follows from
its start on.
"""

from dataclasses import replace

import numpy as np

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.settings import Gain
from estimator.trace.fitting import is_lost, run
from estimator.trace.free_run_model import fitted
from estimator.trace.problem import Problem
from estimator.trace.start import settled_from


def loses_what_a_free_run_follows(part: Problem) -> bool:
    """Whether nothing drives the record of `part`, the observer has lost its motion, and a free run, which is never
    corrected, errs by less than the observer does from one sample to the next.
    """
    record, device = part.record, part.device
    if np.any(record.drive):
        return False
    observer = Observer(device, replace(part.settings, gain=Gain.EKF), part.controller)
    first = settled_from(part.settings, device, len(record))
    missed = run(observer, record).innovation[first:]
    if not np.isfinite(missed).any() or not is_lost(missed, device):
        return False  # without a single number the observer diverges, which is another matter
    try:
        free = fitted(part, tuple(part.effects), None, slice(first, None)).fit
    except ModelError:
        return False
    return bool(np.nanmean(free.residual[first:] ** 2) < np.nanmean(missed**2))
