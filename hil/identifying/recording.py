"""A planned drive played to a board by the loop of `hil run`, and the record of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.identify.model import Piece, pieces
from estimator.identify.schedule import Lengths, Table
from hil.bench import Bench
from hil.errors import InputError
from hil.numbers import counted, quantity
from hil.progress import Progress, Watcher
from hil.records.capture import Capture, RowFlag
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import RunResult
from hil.running.run import run as run_apart
from hil.running.safety.latching import alarm_of
from hil.toml.reading import parse_table
from hil.wire.errors import ProtocolError
from hil.wire.messages import Capabilities, Identity

Array = NDArray[np.float64]
Run = Callable[..., RunResult]
"""As `hil.running.run.run`."""
_CYCLE = 20.0  # samples, of the resonance that stands in the file while none is known
_LARGE = 1e12
_AFTER = 64  # samples behind the table
_SILENT_S = 30.0  # in lockstep, where CAN and UDP tell of no hang-up: nobody debugs a board that is measured


@dataclass(frozen=True)
class Experiment:
    """What may be done to a board: largest drive [m/s²], largest sense voltage (2,) [V], the clock, the link, how many
    samples each piece has, what runs it.
    """

    link: str
    identity: Identity
    largest: float
    limit_V: Array
    clock: str
    lengths: Lengths
    watchdog_s: float | None = None
    run: Run = run_apart


def full_scale_V(identity: Identity) -> float:
    """Of the sense converter."""
    return identity.sense_scale_V * float(1 << (identity.sense_bits - 1))


def full_scale_mps2(identity: Identity) -> float:
    """Of the drive converter."""
    return identity.drive_scale_mps2 * float(1 << (identity.drive_bits - 1))


def identity_of(record: Capture) -> Identity:
    """Who the board of a record said that it is.  Raises InputError for a record of none."""
    said = record.header.get("identity")
    if not isinstance(said, dict):
        raise InputError("identify: the record is of no board, whose converters and latency it would have to tell")
    return Identity(**{name: said.get(name, 0) for name in Identity._fields})


def clock_of(identity: Identity, emulated: bool) -> str:
    """The clock for a board: lockstep where it can wait, as then nothing is late."""
    able = Capabilities(identity.capabilities)
    if Capabilities.LOCKSTEP in able:
        return "lockstep"
    return "paced" if Capabilities.PACED in able or emulated else "real"


def ticks(lengths: Lengths) -> int:
    """Of an experiment on a device whose motion lasts longest; no other takes more."""
    return lengths.search + lengths.measurement + 2 * _AFTER


def longest(experiment: Experiment) -> str:
    """How long it takes at most, in words."""
    at_most = ticks(experiment.lengths)
    seconds = quantity(at_most / experiment.identity.tick_rate_Hz, "s")
    pace = ", in lockstep" if experiment.clock == "lockstep" else ""
    return f"experiment: at most {counted(at_most, 'tick')}, {seconds} of bench time{pace}"


def bench_of(experiment: Experiment, table: Path, rows: int, name: str) -> Bench:
    """A bench of which nothing is known but the board: it plays the table, and its observer estimates nothing."""
    identity, volts = experiment.identity, full_scale_V(experiment.identity)
    rate = identity.tick_rate_Hz
    values: dict[str, Any] = {
        "link": {"watchdog_s": experiment.watchdog_s} if experiment.watchdog_s else {},
        "device": {
            "name": name,
            "mass_kg": 1.0,
            "resonance_Hz": rate / _CYCLE,
            "q": 1000.0,
            "amplitude_m": 1.0,
            "sample_rate_Hz": rate,
            "sense": {"gain_V_per_m": 0.999 * volts, "noise_V": 0.01 * identity.sense_scale_V, "offset_sd_V": volts},
            "drive": {"unit": "mps2", "full_scale": full_scale_mps2(identity)},
        },
        "loop": {
            "name": name,
            "clock": experiment.clock,
            "duration_s": (rows + _AFTER) / rate,
            "settle_s": 0.0,
            "estimate_every": min(1000, rows // 2),
            "covariance_every": min(1000, rows // 2),
        },
        "observer": {"plugin": str(table)},
        "controller": {"plugin": str(table), "force_limit_mps2": experiment.largest * (1.0 + 1e-9)},
        "limits": {"residual_safe": _LARGE, "standstill_s": _SILENT_S},
    }
    return parse_table(values, Bench, "the experiment")


def played(experiment: Experiment, table: Table, folder: Path, name: str, progress: Watcher) -> RunFolder:
    """The record of a table, in a run folder below `folder`.

    Raises InputError, WireError and Interrupted as `hil.run`, and ProtocolError where the board stopped before its end.
    """
    place = folder / f"{name}.npz"
    np.savez(place, forces=table.forces, pieces=table.pieces, limit_V=experiment.limit_V)
    bench = bench_of(experiment, place.resolve(), len(table.forces), name)

    def named(one: Progress) -> None:
        progress(one._replace(stage=f"{name}: {one.stage}"))

    done = experiment.run(RunRequest(bench, experiment.link, judged=False), folder, progress=named)
    told = done.outcome.get("stopped") or alarm_of(done.outcome.get("safety", {}))
    if told or done.folder is None:
        raise ProtocolError(f"{told or 'nothing was recorded'}; the record so far: {done.folder}")
    return RunFolder(done.folder)


@dataclass(frozen=True)
class Sampled:
    """A record a row a tick: sense (n, 2) [V], drive (n, 2) [m/s²] that acted over the interval before a row, NaN where
    it is missing; clipped (n,); rate [Hz].
    """

    sense: Array
    drive: Array
    clipped: NDArray[np.bool_]
    rate: float

    @property
    def parts(self) -> list[Piece]:
        """Without what was lost or at the converter's end."""
        return list(pieces(np.where(self.clipped[:, None], np.nan, self.sense), self.drive))


def sampled(record: Capture) -> Sampled:
    """A capture of two axes.  Raises InputError for another."""
    if record.axes != 2 or not record.has_drive or record.drive_unit != "mps2":
        raise InputError("identify: the record needs two axes and a drive in m/s²; hil import has --map for its units")
    if record.hold != "zoh" or not record.uniform:
        raise InputError("identify: the record needs even samples and a held drive (zoh)")
    at = record.tick - record.tick[0]
    sense, drive = np.full((int(at[-1]) + 1, 2), np.nan), np.full((int(at[-1]) + 1, 2), np.nan)
    clipped = np.zeros(len(sense), bool)
    sense[at], drive[at] = record.sense_V, record.drive
    clipped[at] = record.flags & RowFlag.ADC_CLIPPED != 0
    return Sampled(sense, drive, clipped, record.tick_rate_Hz)
