"""From a capture to what the estimator takes: its samples, the control that was at work, both as a record.

Trim voltages of a record: told to an observer that goes through all of it, or the part in which they stand still.

What looks at a record in stretches, or fits a model to it, takes the springs as constant.  So it is given the longest
part between two changes, and a bench whose springs are softened as they were there.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.gaps import ROWS_BEFORE, Drives, Gaps
from estimator.hold import drive_polynomials
from estimator.observer import Observer
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device
from estimator.spans import spans
from estimator.trims import Electrode
from hil.bench import Bench
from hil.records.capture import Capture, Hold, RowFlag, Trims

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


_SETTLED = 10.0  # time constants after a change


class AtRest(NamedTuple):
    """A record and its bench, as far as the voltages stand still; what is to be said of it, "" for nothing."""

    captured: Capture
    bench: Bench
    told: str = ""


def at_rest(captured: Capture, bench: Bench, trims: Trims | None) -> AtRest:
    """The longest part of a record in which the trim voltages stand still, and the bench with the springs there."""
    if trims is None or not len(trims) or not len(captured):
        return AtRest(captured, bench)
    first, last = captured.ends
    settling = int(_SETTLED * max(one["settling_s"] for one in trims.outputs) * captured.tick_rate_Hz) + 1
    bounds = np.append(trims.columns["acted_tick"], last + 1)
    # The first row is that of the start, at 0 V: nothing has to settle.
    moved = np.any(np.diff(trims.volts, axis=0, prepend=0.0), axis=1)
    begins = np.maximum(bounds[:-1] + np.where(moved, settling, 0), first)
    longest = int(np.argmax(np.minimum(bounds[1:], last + 1) - begins))
    part = captured.between(int(begins[longest]), int(bounds[longest + 1]) - 1)
    softened = trims.volts[longest] ** 2 @ np.array([one.softening for one in electrodes_of(bench, trims)])
    springs = np.array(bench.device.stiffness_N_per_m) - softened * bench.device.mass_kg
    target = bench.target_stiffness_per_s2 * bench.device.mass_kg
    if bench.trim.control and bench.controller.target_stiffness_N_per_m is None:
        bench = bench.with_(controller={"target_stiffness_N_per_m": target})
    told = ""
    if len(part) < len(captured):
        begin_s, end_s = (tick / captured.tick_rate_Hz for tick in part.ends)
        told = f"the trim voltages are constant from {begin_s:.3f} to {end_s:.3f} s; only that part was used"
    return AtRest(part, bench.with_(device={"stiffness_N_per_m": tuple(map(float, springs))}), told)


def declared_electrodes(bench: Bench, settling_s: Sequence[float]) -> list[Electrode]:
    """Those of the bench file, with the time constants that a board tells of them."""
    trim, mass = bench.trim, bench.device.mass_kg
    each = trim.softening_u if len(trim.softening_u) > 1 else trim.softening_u * len(trim.electrodes)
    found = []
    for row, u, settling in zip(trim.softening_N_per_m_per_V2, each, settling_s, strict=True):
        xx, yy, xy = (value / mass for value in row)
        found.append(Electrode((xx, yy, xy), (u * abs(xx), u * abs(yy), u * abs(xy)), settling))
    return found


def electrodes_of(bench: Bench, trims: Trims) -> Sequence[Electrode]:
    """The electrodes of a record, with the coefficients of the bench file where it declares them."""
    declared = dict(zip(bench.trim.electrodes, bench.trim.softening_N_per_m_per_V2, strict=True))
    found = []
    for one in trims.outputs:
        recorded = np.array(one["softening_per_s2_per_V2"])
        row = declared.get(one["name"])
        softening = recorded if row is None else np.array(row) / bench.device.mass_kg
        found.append(Electrode(tuple(softening), tuple(one["softening_u_per_s2_per_V2"]), one["settling_s"]))
    return found


class Acts:
    """What a record's observer has to be told, and when: the changes of its trims in the order of their samples."""

    def __init__(self, observer: Observer, bench: Bench, trims: Trims | None, rate_Hz: float) -> None:
        self._observer, self._trims, self._rate_Hz, self._next = observer, trims, rate_Hz, 0
        if trims is not None:
            observer.declare_trims(electrodes_of(bench, trims))

    def due(self, tick: NDArray[np.int64]) -> list[tuple[int, "partial[None]"]]:
        """(row, act) before the samples of `tick`, which follow those that this was last asked for."""
        acts: list[tuple[int, partial[None]]] = []
        while self._trims is not None and self._next < len(self._trims):
            row = self._next
            at = int(self._trims.tick[row])
            if at > tick[-1]:
                break
            acts.append((int(np.searchsorted(tick, at)), partial(self._put, self._trims, row)))
            self._next += 1
        return acts

    def _put(self, trims: Trims, row: int) -> None:
        late_s = (int(trims.tick[row]) - 1 - int(trims.columns["acted_tick"][row])) / self._rate_Hz
        for k, volts in enumerate(trims.volts[row]):
            if volts != self._observer.trims.target_V(k):
                self._observer.trims.put(k, float(volts), max(late_s, 0.0))
