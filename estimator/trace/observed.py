"""The bench's observer over a record."""

from dataclasses import replace

import numpy as np

from estimator.gaps import observe
from estimator.observer import Estimates, Observer
from estimator.record import Record


def run(observer: Observer, record: Record, every: int | None = None) -> Estimates:
    """The observer over a record; lost samples have NaN innovation."""
    estimates = observe(
        observer,
        record.sense,
        record.drive,
        record.gaps,
        step=record.step,
        every=every or len(record),
        temperature=record.channels.get("temperature"),
    )
    return replace(estimates, innovation=np.where(np.isfinite(record.sense), estimates.innovation, np.nan))
