"""From a capture to what the estimator takes: its samples, the control that was at work, both as a record."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.gaps import ROWS_BEFORE, Drives, Gaps
from estimator.hold import drive_polynomials
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device
from estimator.spans import spans
from hil.bench import Bench
from hil.records.capture import Capture, Hold, RowFlag

_LEARNT = 50_000  # rows from which is learnt how the drive goes
_STRETCHES = 10  # of a longer record


class Samples(NamedTuple):
    """Samples of a record, a row a tick: tick, sense (n, axes) V, NaN where it was lost, drive (n, axes, degree + 1) in
    the record's unit, step (n,) s; gap (n,): at the last sample of a run whose drive is estimated, the number of what
    that adds to the motion (`estimator.gaps`), 0 elsewhere.
    """

    tick: NDArray[np.int64]
    sense: Array
    drive: Array
    step: Array
    gap: NDArray[np.int64]

    def part(self, rows: slice) -> "Samples":
        """The samples of `rows`."""
        return Samples(self.tick[rows], self.sense[rows], self.drive[rows], self.step[rows], self.gap[rows])

    def then(self, later: "Samples") -> "Samples":
        """These, and those that come after them."""
        return Samples(
            np.concatenate([self.tick, later.tick]),
            np.concatenate([self.sense, later.sense]),
            np.concatenate([self.drive, later.drive]),
            np.concatenate([self.step, later.step]),
            np.concatenate([self.gap, later.gap]),
        )


def samples_of(record: Capture, drives: Drives | None = None) -> Samples:
    """The samples of a record; `drives` tells what drove the device where some are lost, else the drive is taken to
    have changed evenly.
    """
    tick = record.tick
    every = np.arange(tick[0], tick[-1] + 1)
    sense, drive, known = _spread_out(record)
    gap = np.zeros(len(every), np.int64)
    if drives is None:
        drive = np.column_stack([np.interp(every, tick, channel) for channel in record.drive.T])
    else:
        drive, gap = drives.fill(sense, drive, known)
    step = np.full(len(every), 1.0 / record.tick_rate_Hz)
    if not record.uniform:
        step[1:] = np.diff(np.interp(every, tick, record.t_s))
    return Samples(every, sense, _polynomials(drive, known, record.hold), step, gap)


def _polynomials(drive: Array, known: NDArray[np.bool_], hold: Hold) -> Array:
    """`drive_polynomials` of a drive (n, axes), each stretch that is known by itself: what lies in a gap says nothing
    of the derivatives beside it.
    """
    if hold == "zoh" or known.all():
        return drive_polynomials(drive, hold)
    straight = drive_polynomials(drive, "foh")
    edges = spans(known)
    pieces = [drive_polynomials(drive[begin:end], hold) for begin, end in edges]
    made = np.zeros((*drive.shape, pieces[0].shape[2]))
    made[:, :, : straight.shape[2]] = straight
    for (begin, end), piece in zip(edges, pieces, strict=True):
        own = slice(0 if begin == 0 else 1, None)  # the interval up to a stretch is part of the gap
        made[begin:end][own] = piece[own]
    return made


def drives_of(record: Capture, device: Device) -> Drives | None:
    """How the drive of a record goes with the rows around it, by some of its rows; None where none is missing, and of
    demodulated streams, which change slowly.
    """
    if len(record) < 2 or record.carrier_Hz is not None:
        return None
    first, last = record.ends
    if last - first + 1 == len(record):
        return None
    if len(record) <= _LEARNT:
        length, starts = len(record), np.array([0])
    else:
        length = _LEARNT // _STRETCHES
        starts = np.linspace(0, len(record) - length, _STRETCHES).astype(int)
    parts = [_spread_out(record.part(int(start), int(start) + length)) for start in starts]
    between = np.full((1, record.axes), np.nan), np.zeros((1, record.axes)), np.zeros(1, bool)
    sense, drive, known = (
        np.concatenate([array for part in parts for array in (part[k], between[k])]) for k in range(3)
    )
    return Drives(
        sense,
        drive,
        known,
        omega=math.sqrt(device.target),
        step=1.0 / record.tick_rate_Hz,
        gain=device.drive_gain,
        held=record.hold == "zoh",
    )


def _spread_out(record: Capture) -> tuple[Array, Array, NDArray[np.bool_]]:
    """sense (n, axes), drive (n, axes) and whether it is known (n,), a row a tick."""
    tick = record.tick - record.tick[0]
    n = int(tick[-1]) + 1
    shown, driven = record.sense_V, record.drive
    sense, drive, known = np.full((n, shown.shape[1]), np.nan), np.zeros((n, driven.shape[1])), np.zeros(n, bool)
    sense[tick], drive[tick], known[tick] = shown, driven, True
    held = np.zeros(n, bool)
    held[tick] = record.flags & RowFlag.LATE_ANSWER_HELD != 0
    for row in (np.flatnonzero(np.diff(tick) > 1) + 1)[held[tick[1:][np.diff(tick) > 1]]]:
        # A host that did not see these samples did not answer them: from the last answer on the board held its drive,
        # and goes on to until the first sample that was seen again is answered.
        end, latency = int(tick[row]), record.latency_ticks
        until = slice(end, end + latency + 1)
        if np.all(held[until] | ~known[until]):
            begin = min(int(tick[row - 1]) + 1 + latency, end)
            drive[begin:end], known[begin:end] = drive[end], True
    return sense, drive, known


def pieces_of_samples(record: Capture, drives: Drives | None = None) -> Iterator[Samples]:
    """`samples_of` in parts, one after another, that memory always has room for.

    A record that was imported comes whole where the hold or the time of a sample depends on its neighbours.
    """
    if not record.uniform or record.hold != "zoh":
        yield samples_of(record, drives)
        return
    start = 0
    for piece in record.pieces():
        stop = start + len(piece)
        # With the rows around, from which the drive over a gap is estimated.
        earlier = max(start - ROWS_BEFORE, 0)
        later = min(stop + record.latency_ticks, len(record))
        around = record.part(earlier, later)
        samples = samples_of(around, drives)
        new = slice(
            int(around.tick[start - 1 - earlier] - around.tick[0]) + 1 if start else 0,
            int(around.tick[stop - 1 - earlier] - around.tick[0]) + 1,
        )
        yield samples.part(new)
        start = stop


def gaps_of(samples: Samples, drives: Drives | None) -> Gaps | None:
    """The gaps among these samples."""
    if drives is None:
        return None
    last = np.flatnonzero(samples.gap)
    return Gaps(last, drives.spread(samples.gap[last]))


def control_of(bench: Bench, record: Capture) -> ControllerSettings | None:
    """What a replay must know of the control at work: its virtual rotation, which the angle leaves out."""
    if bench.device.axes != 2 or not bench.controller.enabled:
        return None
    return ControllerSettings(
        latency=record.latency_ticks,
        force_quantum=1.0,
        force_limit=float(bench.drive_limit_mps2),
        sense_quantum=1.0,
        virtual_rotation=bench.controller.virtual_rotation_rad_s,
        virtual_reversal=bench.virtual_reversal_s,
    )


def record_of(captured: Capture, drives: Drives | None = None) -> Record:
    """The samples of a capture as the estimator takes them, a row a tick, with the channels it has."""
    samples = samples_of(captured, drives)
    given = {"rate": captured.rate_rad_s, "temperature": captured.temp_C}
    channels: dict[str, Array] = {
        name: np.interp(samples.tick, captured.tick, series) for name, series in given.items() if series is not None
    }
    filtered = captured.noise_gain != 1.0
    return Record(samples.sense, samples.drive, samples.step, channels, gaps_of(samples, drives), filtered)
