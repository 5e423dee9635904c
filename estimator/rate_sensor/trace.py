"""From the record of a rate sensor to what the straight line of its data sheet lacks."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis import Diagnosis
from estimator.errors import ModelError
from estimator.rate_sensor.agreement import Line
from estimator.rate_sensor.chain import RateSensor, noise_floor
from estimator.rate_sensor.declaration import Range
from estimator.rate_sensor.record import SensorRecord
from estimator.trace.fit import fit
from estimator.trace.output_trace import trace_output

STILL = 1e-3
"""Of the declared range: a rate that changes by less does not change."""


def alternate_blocks(count: int, length: int) -> NDArray[np.bool_]:
    """True for every other block of `length` rows: what is fitted, where a record has no split of its own."""
    return np.asarray(np.arange(count) // length % 2 == 0)


def trace_sensor(
    record: SensorRecord, declared: Range, noise: float, fitting: NDArray[np.bool_], line: Line | None = None
) -> Diagnosis:
    """Find what the straight line lacks on the rows `fitting` and score it on the others.

    Figures before are those of the line at rates within the declared range: beyond it nobody promised one.
    Raises ModelError where a part is empty, or the rate of the fitting part never changes.
    """
    if not fitting.any() or fitting.all():
        raise ModelError("every row is in one part; keep some rows to fit and some to score")
    if float(np.ptp(record.rate[fitting])) < STILL * declared.rate:
        raise ModelError("the rate never changes in the fitting part; turn the sensor, at several rates")
    told = np.flatnonzero(fitting)
    floor = noise_floor(record, told, noise)
    sensor = RateSensor(record, declared, line, told=told, counted=told, noise=noise, floor=floor)
    return trace_output(sensor, fitting, fit(replace(sensor, told=sensor.within, counted=sensor.within), {}))
