"""Judge a rate-output sensor (`[device] axes = 0`) by its record: what the straight line of its data sheet lacks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis import Diagnosis
from estimator.errors import ModelError
from estimator.rate_sensor.agreement import Line
from estimator.rate_sensor.declaration import Range
from estimator.rate_sensor.record import SensorRecord
from estimator.rate_sensor.trace import alternate_blocks, trace_sensor
from estimator.record import Record
from hil.bench import RateSensorBench
from hil.bench.rate_sensor import RateSensor
from hil.bench.ratio import slip
from hil.errors import InputError
from hil.records.capture import Capture, missing, read_capture
from hil.records.runfolder import RunFolder
from hil.scoring.reference import reference_rate

_BLOCK = 4  # samples; a step's transient is a few tens long
_OFFSET = 0.1  # of what full rate adds, where no tolerance of the offset is declared
_RATE = 1e-2  # relative, of the sampling rate: stamps of a logger are no better


def trace_rate_sensor(capture: Path, bench: RateSensorBench) -> Diagnosis:
    """Trace the record at `capture`; its segments `train` and `test` split it, else alternate blocks of 4 samples.

    Raises InputError when the record is not one of a rate sensor, or cannot be traced.
    """
    record = read_capture(capture)
    device = bench.device
    require_sensor_fit(record, device, capture)
    full = abs(device.scale_V_s_per_rad) * device.range_rad_s
    line = Line(
        offset=device.offset_V,
        scale=device.scale_V_s_per_rad,
        offset_tolerance=_OFFSET * full if device.offset_tolerance_V is None else device.offset_tolerance_V,
        scale_tolerance=device.scale_tolerance,
        unit=device.unit,
        meant=slip,
    )
    try:
        samples = sensor_record(record, capture)
        return trace_sensor(
            samples, Range(device.range_rad_s, full, device.unit), device.noise_V, fitting_rows(record), line
        )
    except ModelError as error:
        raise InputError(f"{capture}: {error}") from None


def require_sensor_fit(record: Capture, device: RateSensor, place: Path) -> None:
    """InputError naming the first thing in which record and bench file differ."""
    if record.sense_unit != device.unit:
        raise InputError(
            f"{place}: the output is in {record.sense_unit}, but [device] unit = {device.unit!r}; set unit = "
            f'"{record.sense_unit}" with scale, offset and noise in it, or give its own bench file'
        )
    rate = device.sample_rate_Hz
    if rate and not record.steady and abs(record.tick_rate_Hz / rate - 1.0) > _RATE:
        raise InputError(
            f"{place}: recorded at {record.tick_rate_Hz:g} Hz, but [device] sample_rate_Hz = {rate:g}; correct the "
            "bench file, or the time of the record"
        )


def sensor_record(record: Capture, place: Path) -> SensorRecord:
    """Rate and output of a capture. Raises InputError where it has no reference for the rate."""
    if record.rate_rad_s is None:
        raise InputError(f"{place}: no column rate_rad_s; a rate sensor is judged beside a reference for the rate")
    if record.axes != 1:
        raise InputError(f"{place}: {record.axes} outputs; import one sensor at a time")
    if record.steady or not record.uniform:  # uneven time tells no response from another
        return SensorRecord(record.rate_rad_s, record.sense_V[:, 0], None, record.temp_C)
    step = 1.0 / record.tick_rate_Hz
    return SensorRecord(record.rate_rad_s, record.sense_V[:, 0], step, record.temp_C, record.tick)


def fitting_rows(record: Capture) -> NDArray[np.bool_]:
    """The rows to fit; the others are scored."""
    segments = record.segments
    if {"train", "test"} <= set(segments):
        rows = np.zeros(len(record), dtype=bool)
        rows[slice(*segments["train"])] = True
        return rows
    return alternate_blocks(len(record), 1 if record.steady else _BLOCK)


def sensor_remarks(record: Capture) -> tuple[str, ...]:
    """What of a record is left aside, or passed over, a sentence each."""
    said = []
    if not record.steady and not record.uniform:
        said.append("uneven time: no response is looked for, only the static curve")
    if record.lost:
        said.append(missing(record.lost, record.gaps))
    return tuple(said)


def with_gyro(record: Record, captured: Capture, place: Path) -> tuple[Record, tuple[str, ...]]:
    """A record, a row a tick from the first of `captured` on, with the gyro of its run at `place` where it has one and
    no rate of its own; what there is to say of it.
    """
    folder = RunFolder(place.parent)
    if record.reference is not None or place.name != "capture.arrow" or not folder.reference_path.exists():
        return record, ()
    found = reference_rate(folder)
    if isinstance(found, str):
        return record, (f"reference: not used: {found}",)
    t_s = (captured.tick[0] + np.arange(len(record))) / captured.tick_rate_Hz
    if found.t_s[0] > t_s[0] or found.t_s[-1] + found.step_s < t_s[-1]:
        return record, ("reference: not used: it does not cover the record",)
    held = found.rate_rad_s[np.searchsorted(found.t_s, t_s, side="right") - 1]
    said = "reference: errors are against the gyro beside the run, less its own bias, scale and delay"
    return replace(record, channels={**record.channels, "gyro": held}), (said,)
