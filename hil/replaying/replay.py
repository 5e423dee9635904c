"""Today's estimator on yesterday's record: the observer of a bench file run over a capture."""

import shutil
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from estimator.backend import Backend, make_observer
from estimator.errors import ModelError
from estimator.gaps import observe
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.bench.by_verb import of_a_record, require_usable
from hil.errors import InputError
from hil.inputs.captured import Acts, Samples, control_of, drives_of, gaps_of, pieces_of_samples
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.progress import Progress, Watcher
from hil.records.atomic import occupied, replacing
from hil.records.capture import TRIMS, Capture, read_capture, trims_beside
from hil.records.changes import Change, note_change, read_changes
from hil.records.estimates import packed
from hil.records.runfolder import RunFolder
from hil.running.concluding import Made, conclude
from hil.running.process.live_settings import LiveSettings
from hil.running.recording.angle import ReportedAngle
from hil.running.recording.recorder import record_here
from hil.running.recording.tracks import estimate_rows, innovation_rows, observer_layouts
from hil.running.run import RunResult, new_folder

_BLOCK = 1 << 14


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def replay(capture: Path, bench: Bench, out: Path, *, backend: Backend | None = None, progress: Watcher) -> RunResult:
    """Run the observer over the record at `capture`; a new run folder below `out` keeps a copy of it.

    Settings that changed while the loop ran (`changes.jsonl` beside the record) change at the same samples.
    Raises InputError when record and bench file do not belong together, and for a record that the observer cannot take;
    nothing is left then.
    """
    require_usable(bench, "replay")
    bench = of_a_record(bench)
    record, bench = fitting(capture, bench)
    try:
        observer = _observer(backend or bench.observer.backend, bench, record)
        trims = trims_beside(capture)
        if trims is not None and (backend or bench.observer.backend) != "c":
            raise InputError(f'{capture}: trim voltages changed the springs, which only backend = "c" follows')
        trimmed = Acts(observer, bench, trims, record.tick_rate_Hz)
    except ModelError as error:
        raise InputError(f"{capture}: {error}") from None
    changes = read_changes(capture.parent)
    folder = new_folder(out, bench)
    with occupied(folder):
        with replacing(RunFolder(folder).capture_path) as part:
            shutil.copyfile(capture, part)
        if trims is not None:
            shutil.copyfile(capture.parent / TRIMS, folder / TRIMS)
        for change in changes:
            note_change(folder, change.tick, change.settings)
        try:
            _estimate(record, bench, observer, changes, trimmed, folder, progress)
        except ModelError as error:  # of the record itself: a step too long for the flow
            shutil.rmtree(folder)
            raise InputError(f"{capture}: {error}") from None
    conclude(Made(folder, bench, {"stopped": record.cut}), progress=progress)
    return RunResult(folder, {})


def _observer(backend: Backend, bench: Bench, record: Capture) -> Observer:
    """The one that the bench file asks for. Of a plug-in's controller a record needs nothing: it has been driven."""
    if bench.observer.plugin is None:
        return make_observer(
            backend, recorded_device_of(bench, record), observer_settings_of(bench), control_of(bench, record)
        )
    from hil.plugins.of_bench import recorded_observer

    return recorded_observer(bench, record)


def fitting(place: Path, bench: Bench) -> tuple[Capture, Bench]:
    """The record at `place`, and the bench as it reads it: demodulated streams by `slow_flow`, unless it names a
    plug-in.  Raises InputError as `require_fit`.
    """
    record = read_capture(place)
    require_fit(record, bench, place)
    if record.carrier_Hz is None or bench.observer.plugin is not None:
        return record, bench
    return record, override(bench, {"observer": {"plugin": "slow_flow"}}, str(place))


def require_fit(record: Capture, bench: Bench, place: Path) -> None:
    """InputError naming the first thing in which record and bench file differ."""
    device = bench.device
    if record.axes != device.axes:
        raise InputError(
            f"{place}: a record of {record.axes} axes, but [device] axes = {device.axes}; give its own bench file"
        )
    if record.has_drive and device.drive_mps2_per(record.drive_unit) is None:
        raise InputError(
            f"{place}: drive recorded in {record.drive_unit}, but [device.drive] unit = "
            f"{device.drive.unit!r} does not tell what a volt does; give its own bench file"
        )
    if record.has_drive and device.drive.hold not in ("zoh", record.hold):
        raise InputError(
            f"{place}: the drive is {record.hold} between samples by the record, [device.drive] hold = "
            f'"{device.drive.hold}" by the bench file; take that out, or import the record with it'
        )
    if record.sense_unit != device.sense.unit:
        raise InputError(
            f"{place}: sensed in {record.sense_unit}, but [device.sense] unit = {device.sense.unit!r}; "
            f'set unit = "{record.sense_unit}" with gain and noise in it, or give its own bench file'
        )
    if record.uniform and record.carrier_Hz is None and abs(record.tick_rate_Hz / device.sample_rate_Hz - 1.0) > 1e-3:
        raise InputError(
            f"{place}: recorded at {record.tick_rate_Hz:g} Hz, but [device] sample_rate_Hz = "
            f"{device.sample_rate_Hz:g}; correct the bench file"
        )
    if len(record) < 2:
        raise InputError(f"{place}: {len(record)} samples are no record; record for longer")


def _estimate(
    record: Capture,
    bench: Bench,
    observer: Observer,
    changes: Sequence[Change],
    trimmed: Acts,
    folder: Path,
    progress: Watcher,
) -> None:
    layouts = observer_layouts(observer, bench)
    every, reported = bench.loop.estimate_every, ReportedAngle(bench)
    stride = bench.loop.covariance_stride(record.tick_rate_Hz)
    first, last = record.ends
    total = last - first + 1
    done = 0
    drives = drives_of(record, observer.device)
    settings, due = LiveSettings(observer, bench), deque(_as_recorded(changes, bench, record.latency_ticks))
    with record_here(folder, layouts) as recording:
        for samples in _parts(pieces_of_samples(record, drives), every, stride):
            tick, sense, drive, step, _ = samples
            acts = []
            while due and due[0].tick <= tick[-1]:
                change = due.popleft()
                acts.append((int(np.searchsorted(tick, change.tick)), partial(_apply, settings, change)))
            acts = sorted([*acts, *trimmed.due(tick)], key=lambda act: act[0])
            gaps = gaps_of(samples, drives)
            estimates = observe(observer, sense, drive, gaps, step=step, every=every, acts=acts)
            recording["innovation"].push(innovation_rows(layouts["innovation"], tick, estimates))
            recording["estimates"].push(estimate_rows(layouts["estimates"], tick, estimates, reported))
            done += len(tick)
            if done % stride == 0 and observer.HAS_COVARIANCE:
                recording["covariance"].put(int(tick[-1]), *packed(observer.covariance))
            progress(Progress("replay", done, total))


def _apply(settings: LiveSettings, change: Change) -> None:
    settings.change(change.settings)


def _as_recorded(changes: Sequence[Change], bench: Bench, latency_ticks: int) -> list[Change]:
    """Changes at the rows in which they show.

    In force mode the drive that is computed from a sample acts `latency_ticks` later, over the interval that ends with
    the next row; only then does the pattern turn otherwise. Its energy is judged otherwise at once.
    """
    later = latency_ticks + 1 if bench.loop.mode == "force" else 0
    parts = []
    for tick, settings in changes:
        turning = {name: value for name, value in settings.items() if name == "virtual_rotation"}
        parts += [
            Change(tick, {name: settings[name] for name in settings.keys() - turning}),
            Change(tick + later, turning),
        ]
    return sorted(parts, key=lambda one: one.tick)


def _parts(pieces: Iterable[Samples], every: int, stride: int) -> Iterator[Samples]:
    """Samples cut anew: parts end where a covariance is due, and after whole estimates, so that decimation runs on
    across them."""
    block = max(_BLOCK // every, 1) * every
    begun = 0  # samples before those that wait
    waiting: Samples | None = None
    for piece in pieces:
        waiting = piece if waiting is None else waiting.then(piece)
        start, rows = 0, len(waiting.tick)
        while (stop := min(start + block, (begun // stride + 1) * stride - begun + start)) <= rows:
            yield waiting.part(slice(start, stop))
            begun += stop - start
            start = stop
        waiting = waiting.part(slice(start, None))
    if waiting is not None and len(waiting.tick):
        yield waiting
