"""A board identified: at rest, a search over all frequencies, what its resonances need, and a likelihood of it all."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from estimator.identify.fit import Fitted, fit, grown, innovations
from estimator.identify.model import NAMES, Array, Piece, Predictor
from estimator.identify.schedule import LENGTHS, Known, Table, measurement, search
from estimator.identify.start import NoMotionError, start
from hil.boards.emulation import is_emulated
from hil.boards.identity import identity_at
from hil.errors import InputError
from hil.identifying.advice import advice_of
from hil.identifying.bench_file import bench_of, text_of
from hil.identifying.faults import codes_of, faults_of
from hil.identifying.findings import Findings, findings_of
from hil.identifying.recording import (
    Experiment,
    Run,
    Sampled,
    clock_of,
    full_scale_mps2,
    full_scale_V,
    identity_of,
    longest,
    played,
    sampled,
)
from hil.identifying.request import IdentifyRequest
from hil.numbers import signed
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, write_text
from hil.records.capture import Capture, read_capture
from hil.records.runfolder import RunFolder
from hil.running.run import run as run_apart
from hil.running.safety.preflight import require_plausible
from hil.wire.link_name import SerialPort, parse_link
from hil.wire.messages import Capabilities, Identity

_BOLTZMANN = 1.380649e-23
_SENSE, _DRIVE = 0.6, 0.9  # of a converter's range, where nothing else is told
_LEFT = 1.3  # times the noise: beyond it no linear device explains the record
_SHORT = 40  # samples


@dataclass(frozen=True)
class Identified:
    """findings; folder: where records and page are; bench: the file that was written, None where the board is not as
    it says.
    """

    findings: Findings
    folder: Path
    bench: Path | None

    @property
    def good(self) -> bool:
        """Whether the board does what it says."""
        return not self.findings.faults


def identify(
    request: IdentifyRequest, out: Path, progress: Watcher, *, run: Run = run_apart, report: bool = True
) -> Identified:
    """Carry it out; records, `identified.json` and `report.html` in a new folder below `out`.  run: what plays a drive.

    Raises InputError where nothing moves, WireError and Interrupted as `hil.run`; SAFE was sent then.
    """
    folder = make_run_folder(out, request.name)
    if request.link is None:
        captures = [_capture(place) for place in request.records]
        identity = identity_of(captures[0])
        records = [sampled(one) for one in captures]
        tables: list[Table | None] = [None] * len(records)
        limit, largest = _limits(request, identity)
    else:
        identity = identity_at(request.link)
        require_plausible(identity, request.link)
        if identity.axes != 2:
            raise InputError(f"{request.link}: a board of {identity.axes} axis; identify needs two")
        limit, largest = _limits(request, identity)
        clock = clock_of(identity, is_emulated(request.link))
        experiment = Experiment(request.link, identity, largest, limit, clock, LENGTHS, run=run)
        progress(Progress(longest(experiment), 0, 0))
        with _held_open(request.link):
            records, tables = _experiment(experiment, folder, progress)
    progress(Progress("fit", 0, 0))
    fitted = _fitted(records, request)
    found = findings_of(fitted, identity, limit, largest)
    faults = [fault for record in records for fault in codes_of(record, identity)]
    faults += [*faults_of(found, request.declared), *_unexplained(records[-1], found)]
    found = replace(found, faults=tuple(dict.fromkeys(faults)), remarks=tuple(_remarks(records, tables, fitted)))
    found = replace(found, settings=settings_of(found, request.amplitude_m))
    bench = None
    if not found.faults:
        progress(Progress("predict", 0, 0))
        found = replace(found, advice=advice_of(bench_of(found, request), identity, request.wishes))
    if request.out is not None and not found.faults:
        write_text(request.out, text_of(found, request.name, request.mass_kg, request.kept_link))
        bench = request.out
    write_text(folder / "identified.json", json.dumps(found.as_json(), indent=1) + "\n")
    if report:
        from hil.identifying.page import write_page

        write_page(folder / "report.html", found, records, request)
    return Identified(found, folder, bench)


def _experiment(experiment: Experiment, folder: Path, progress: Watcher) -> tuple[list[Sampled], list[Table | None]]:
    lengths = experiment.lengths
    table = search(experiment.largest, lengths)
    looked = sampled(_captured(played(experiment, table, folder, "search", progress)))
    known = _known(looked, lengths.quiet)
    table = measurement(known, experiment.largest, experiment.limit_V, lengths)
    measured = sampled(_captured(played(experiment, table, folder, "measure", progress)))
    return [looked, measured], [None, table]


def _known(record: Sampled, quiet: int) -> Known:
    """Where a search has found the resonances, whose first rows are quiet.  Raises InputError where nothing moved."""
    rest, all_ = record.sense[:quiet], record.sense
    noise = np.nanstd(np.diff(rest, axis=0), axis=0) / np.sqrt(2.0)
    if not np.any(np.nanstd(all_, axis=0) > 1.2 * noise):
        raise InputError(
            "no response: the drive moves nothing that sense shows; check drive amplifier, bias and wiring"
        )
    try:
        theta = start(record.parts).theta
    except NoMotionError as error:
        raise InputError(f"identify: {error}; look at the record, and raise the limits if nothing moved far") from None
    decay = max(0.25 * float(theta[3] + theta[4]), 1e-9)
    return Known(np.sqrt(np.maximum(theta[:2], 1e-6)), decay, theta[7:9])


def _fitted(records: list[Sampled], request: IdentifyRequest) -> Fitted:
    """From the record in which the device moved as it should: the last."""
    record = records[-1] if request.link is not None else None
    parts = [part for one in records for part in one.parts] if record is None else record.parts
    rate = records[-1].rate
    thermal = 0.0 if request.mass_kg is None else 2.0 * _BOLTZMANN * request.temperature_K * rate**2 / request.mass_kg
    try:
        begun = start(parts)
    except NoMotionError as error:
        raise InputError(f"identify: {error}; give a record with free decays of both axes") from None
    return grown(parts, begun.theta, thermal)


def _remarks(records: list[Sampled], tables: list[Table | None], fitted: Fitted) -> Iterator[str]:
    clipped = sum(int(record.clipped.sum()) for record in records)
    if clipped:
        yield f"{clipped} samples were at the end of the sense converter and are left out"
    if not fitted.converged:
        yield "the fit has not settled: look at the residual, and take its intervals with care"
    for record, table in zip(records, tables, strict=True):
        if table is not None:
            yield from amplitude_dependence(record, table, fitted)


def _unexplained(record: Sampled, found: Findings) -> Iterator[str]:
    """Whether the fit leaves more than the noise: that of pieces so short that each has its own first motion, in which
    nearly any device is a linear one.
    """
    length = max(round(2.0 * 2.0 * np.pi * record.rate / found.omega), _SHORT)
    pieces = [part for piece in record.parts for part in piece.parted(length)]
    fitted = np.sqrt(1.0 - 2.0 / length)  # four numbers of a motion to 2 · length of voltages
    noise = innovations(Predictor(found.fitted.theta), pieces, found.noise_V).noise / fitted
    ratio = float(np.max(found.noise_V / noise))
    if ratio > _LEFT:
        yield (
            f"the fitted device leaves {ratio:.2g} × the noise, so that no interval holds: the board turned "
            "meanwhile (keep it still), or it has an effect that no linear device has (hil trace names it)"
        )


def _limits(request: IdentifyRequest, identity: Identity) -> tuple[Array, float]:
    """Sense voltages (2,) and the largest drive in whole codes, m/s²."""
    sense = _SENSE * full_scale_V(identity)
    asked = _DRIVE * full_scale_mps2(identity)
    if request.declared is not None:
        sense = min(sense, 1.5 * max(request.declared.swing_V))
        asked = min(asked, float(request.declared.drive_limit_mps2))
    sense = sense if request.sense_limit_V is None else request.sense_limit_V
    asked = asked if request.drive_limit_mps2 is None else request.drive_limit_mps2
    if asked > full_scale_mps2(identity) or sense > full_scale_V(identity):
        raise InputError(
            f"identify: the board's converters end at {full_scale_mps2(identity):.6g} m/s² and "
            f"{full_scale_V(identity):.6g} V; give limits within that"
        )
    codes = int(asked / identity.drive_scale_mps2 * (1.0 + 1e-12))
    if codes < 1:
        raise InputError(
            f"--drive-limit: {asked:g} m/s² is less than one drive code, {identity.drive_scale_mps2:g} m/s²"
        )
    return np.full(2, sense), codes * identity.drive_scale_mps2


def _capture(place: Path) -> Capture:
    if not place.is_dir():
        return read_capture(place)
    return _captured(RunFolder.open(place))


def _captured(folder: RunFolder) -> Capture:
    capture = folder.capture
    if capture is None or not len(capture):
        raise InputError(f"{folder.path}: no sample was recorded")
    return capture


@contextmanager
def _held_open(link: str) -> Iterator[None]:
    """A serial line does not hang up between the parts of the experiment: a board in lockstep would end."""
    place = parse_link(link)
    if not isinstance(place, SerialPort):
        yield
        return
    import os

    try:
        descriptor = os.open(place.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError:
        yield  # whatever it is, the loop says it
        return
    try:
        yield
    finally:
        os.close(descriptor)


_SURE = 4.0  # standard deviations of a difference
_TOLD = {"kxx": "stiffness of x", "kyy": "stiffness of y", "dxx": "damping of x", "dyy": "damping of y"}
_SMALL = ("small decay x", "small decay y")
_LARGE = ("ring-down",)


def amplitude_dependence(record: Sampled, table: Table, found: Fitted) -> Iterator[str]:
    """A line for each constant that differs between the decays from small bursts and the ring-down, and by how much."""
    small, large = ([_decay(record, table, name) for name in names] for names in (_SMALL, _LARGE))
    if any(part is None for part in (*small, *large)):
        return
    free = [NAMES.index(name) for name in _TOLD]
    values = []
    for parts in (small, large):
        try:
            one = fit([part for part in parts if part is not None], found.theta, only=tuple(free), noise=found.noise)
        except np.linalg.LinAlgError:
            return
        values.append((one.theta[free], np.diag(one.covariance)[free]))
    difference = values[1][0] - values[0][0]
    u = np.sqrt(values[0][1] + values[1][1] + 1e-300)
    for name, by, of, spread in zip(_TOLD, difference, found.theta[free], u, strict=True):
        if abs(by) > _SURE * spread:
            yield (
                f"{_TOLD[name]} differs by {signed(100.0 * by / of)} % (± {200.0 * spread / abs(of):.1g} %) between a "
                "large and a small amplitude: hil trace names the effect"
            )


def _decay(record: Sampled, table: Table, name: str) -> Piece | None:
    """The free motion behind a burst; None where samples are missing."""
    rows = table.rows_of(name)
    begin = int(np.flatnonzero(np.nan_to_num(record.drive).any(axis=1))[-1]) + 12 if name == "ring-down" else None
    there = slice(rows.start + 40, min(rows.stop, len(record.sense)))
    if begin is not None:
        there = slice(max(begin, there.start), there.stop)
    part = Piece(record.sense[there], record.drive[there])
    whole = len(part.sense) > 500 and np.isfinite(part.sense).all() and not np.nan_to_num(part.drive).any()
    return part if whole else None


# In cycles of the vibration, as all of this scales with it.
MEMORY, SETTLE, LENGTH, TURN = 400.0, 2000.0, 5500.0, 3000.0
_SWING = 0.45  # of the limit of the sense voltages
_HOLDING = 0.5  # of the drive, to make the springs alike and replace what damping takes
_TURNING = 0.1  # of it, for the virtual rotation
_DITHER = 0.04  # of it, rms
_GAIN = 0.02
_LEAST_STIFFNESS, _LEAST_DAMPING = 1e-5, 0.02
_WIDER = 3.0  # than the uncertainty: what a temperature moves meanwhile


def settings_of(found: Findings, amplitude_m: float | None) -> dict[str, dict[str, Any]]:
    """By section of the bench file and key; SI per unit mass."""
    omega, drive = found.omega, found.largest_mps2
    hertz, rate = omega / (2.0 * np.pi), found.identity.tick_rate_Hz
    amplitude = amplitude_of(found) if amplitude_m is None else amplitude_m
    rotation = min(2.0 * np.pi * hertz / TURN, _TURNING * drive / (2.0 * omega * amplitude))
    k, d = omega**2, 0.5 * (found.value("dxx") + found.value("dyy"))
    stiffness = max(_WIDER * max(found.u(name) for name in ("kxx", "kyy", "kxy")) / k, _LEAST_STIFFNESS)
    damping = max(_WIDER * max(found.u(name) for name in ("dxx", "dyy", "dxy")) / d, _LEAST_DAMPING)
    force = max(found.force_mps2_per_rtHz, 1e-12 * k * amplitude / np.sqrt(hertz))
    in_blocks = Capabilities.LOCKSTEP not in Capabilities(found.identity.capabilities)
    every = max(round(rate / hertz), 1)
    return {
        "device": {"amplitude_m": amplitude},
        "loop": {
            "mode": "gain"
            if in_blocks and Capabilities.GAIN_MODE in Capabilities(found.identity.capabilities)
            else "force",
            "clock": "real" if in_blocks else "lockstep",
            "duration_s": LENGTH / hertz,
            "settle_s": SETTLE / hertz,
            "estimate_every": every,
        },
        "observer": {"memory_s": MEMORY / hertz, "acquisition_s": 20.0 / hertz},
        "observer.initial_sd": {"stiffness": stiffness, "damping": damping, "rate_rad_s": 2.0},
        "observer.process_noise": {
            "force_mps2_per_rtHz": float(force),
            "rate_rad_s_per_rts": float(0.05 * np.sqrt(hertz / 200.0)),
        },
        "controller": {
            "energy_gain": _GAIN,
            "quadrature_gain": _GAIN,
            "virtual_rotation_rad_s": float(rotation),
            "dither_mps2": _DITHER * drive,
            "force_limit_mps2": drive,
        },
    }


def amplitude_of(found: Findings) -> float:
    """Where neither the sense voltages nor the drive that holds it come near their ends."""
    swing = min(
        (_SWING * limit - abs(found.value(f"offset_{axis}"))) / abs(found.value(f"gain_{axis}"))
        for axis, limit in zip("xy", found.limit_V, strict=True)
    )
    k = found.omega**2
    uneven = max(abs(found.value("kxx") - k), abs(found.value("kyy") - k)) + abs(found.value("kxy"))
    damped = found.omega * max(found.value("dxx"), found.value("dyy"), 0.0)
    return float(min(swing, _HOLDING * found.largest_mps2 / max(uneven + damped, 1e-300)))
