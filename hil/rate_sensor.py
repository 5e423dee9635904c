"""Judge a rate-output sensor (`[device] axes = 0`) by its record: what the straight line of its data sheet lacks."""

from pathlib import Path

import numpy as np

from estimator.errors import ModelError
from estimator.rate_sensor.declaration import Range
from estimator.rate_sensor.model import Rows
from estimator.rate_sensor.record import SensorRecord
from estimator.rate_sensor.trace import SensorDiagnosis, alternate_blocks, trace_sensor
from hil.bench import RateSensorBench
from hil.errors import InputError
from hil.records.capture import Capture, read_capture

_BLOCK = 4  # samples; a step's transient is a few tens long


def trace_rate_sensor(capture: Path, bench: RateSensorBench) -> SensorDiagnosis:
    """Trace the record at `capture`; its segments `train` and `test` split it, else alternate blocks of 4 samples.

    Raises InputError when the record is not one of a rate sensor, or cannot be traced.
    """
    record = read_capture(capture)
    device = bench.device
    try:
        samples = sensor_record(record, capture)
        declared = Range(device.range_rad_s, abs(device.scale_V_s_per_rad) * device.range_rad_s)
        return trace_sensor(samples, declared, device.noise_V, fitting_rows(record))
    except ModelError as error:
        raise InputError(f"{capture}: {error}") from None


def sensor_record(record: Capture, place: Path) -> SensorRecord:
    """Rate and output of a capture. Raises InputError where it has no reference for the rate."""
    if record.rate_rad_s is None:
        raise InputError(f"{place}: no column rate_rad_s; a rate sensor is judged beside a reference for the rate")
    if record.axes != 1:
        raise InputError(f"{place}: {record.axes} outputs; import one sensor at a time")
    step = None if record.steady else 1.0 / record.tick_rate_Hz
    return SensorRecord(record.rate_rad_s, record.sense_V[:, 0], step, record.temp_C)


def fitting_rows(record: Capture) -> Rows:
    """The rows to fit; the others are scored."""
    segments = record.segments
    if {"train", "test"} <= set(segments):
        rows = np.zeros(len(record), dtype=bool)
        rows[slice(*segments["train"])] = True
        return rows
    return alternate_blocks(len(record), 1 if record.steady else _BLOCK)
