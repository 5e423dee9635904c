"""From a capture to what the estimator takes: its samples, the control that was at work, both as a record."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from estimator.hold import drive_polynomials
from estimator.scaling import Array
from estimator.settings import ControllerSettings
from estimator.trace.record import Record
from hil.bench import Bench
from hil.records.capture import Capture


def samples_of(record: Capture) -> tuple[NDArray[np.int64], Array, Array, Array]:
    """(tick, sense, drive polynomials, step), a row a tick: lost samples have NaN sense, their drive interpolated.

    sense (n, axes) V; drive (n, axes, degree + 1) in the record's unit; step (n,) s.
    """
    tick = record.tick
    step = np.full(len(record), 1.0 / record.tick_rate_Hz)
    if not record.uniform:
        step[1:] = np.diff(record.t_s)
        return tick, record.sense_V, drive_polynomials(record.drive, record.hold), step
    every = np.arange(tick[0], tick[-1] + 1)
    sense = np.full((len(every), record.axes), np.nan)
    sense[tick - tick[0]] = record.sense_V
    drive = np.column_stack([np.interp(every, tick, channel) for channel in record.drive.T])
    return every, sense, drive_polynomials(drive, record.hold), np.full(len(every), step[0])


def pieces_of_samples(record: Capture) -> Iterator[tuple[NDArray[np.int64], Array, Array, Array]]:
    """`samples_of` in parts, one after another, that memory always has room for.

    A record that was imported comes whole where the hold or the time of a sample depends on its neighbours.
    """
    if not record.uniform or record.hold != "zoh":
        yield samples_of(record)
        return
    start = 0
    for piece in record.pieces():
        stop = start + len(piece)
        # with the row before, from which the drive is interpolated over a gap
        tick, *series = samples_of(record.part(max(start - 1, 0), stop))
        new = 0 if start == 0 else 1
        sense, drive, step = (values[new:] for values in series)
        yield tick[new:], sense, drive, step
        start = stop


def control_of(bench: Bench, record: Capture) -> ControllerSettings | None:
    """What a replay must know of the control at work: its virtual rotation, which the angle leaves out."""
    if bench.device.axes != 2 or not bench.controller.enabled:
        return None
    return ControllerSettings(
        latency=record.latency_ticks,
        force_quantum=1.0,
        force_limit=bench.device.drive.full_scale,
        sense_quantum=1.0,
        virtual_rotation=bench.controller.virtual_rotation_rad_s,
        virtual_reversal=bench.virtual_reversal_s,
    )


def record_of(captured: Capture) -> Record:
    """The samples of a capture as the estimator takes them, a row a tick, with the channels it has."""
    tick, sense, drive, step = samples_of(captured)
    given = {"rate": captured.rate_rad_s, "temperature": captured.temp_C}
    channels: dict[str, Array] = {
        name: np.interp(tick, captured.tick, series) for name, series in given.items() if series is not None
    }
    return Record(sense, drive, step, channels)
