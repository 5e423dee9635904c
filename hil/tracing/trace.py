"""From the residual of a record to the effect that the model lacks: record in, diagnosis and report out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estimator import diagnosis as traced
from estimator.errors import ModelError
from estimator.missing_force.result import MissingForce
from estimator.record import Record
from estimator.settings import Device
from estimator.side_by_side import interruptible, one_blas_thread, workers
from estimator.thresholds import THRESHOLDS
from estimator.trace.problem import Problem
from estimator.trace.traceable import moves_until, remarks, require_length, require_traceable
from hil.bench import Bench, RateSensorBench
from hil.bench.by_verb import require_usable
from hil.bench.ratio import path_of
from hil.errors import InputError
from hil.inputs.captured import at_rest, control_of, drives_of, record_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.inputs.swing import swing_slip
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, require_place, write_sealed
from hil.records.capture import Capture, RowFlag, read_capture, trims_beside
from hil.records.diagnosis import MissingForce as WrittenForce
from hil.records.diagnosis import save_diagnosis, to_model
from hil.records.force import refused, save_force
from hil.records.force import to_model as force_model
from hil.replaying.replay import fitting, require_fit
from hil.running.run import new_folder
from hil.tracing.demodulated import trace_ring_down, trace_streams
from hil.tracing.rate_sensor import with_gyro
from hil.tracing.request import Traced, TraceRequest, called
from hil.tracing.time_left import TimeLeft


@one_blas_thread()
@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def trace(request: TraceRequest, out: Path, *, progress: Watcher) -> Traced:
    """Find what the model of the bench lacks on the records; a new folder below `out` has the answer, and a page of it
    where that is asked for.

    Effects are chosen on the first `fraction` of the record and scored on the rest.  Without one, a record with a
    segment `train` and another that follows it is split as it says itself.  Raises InputError for a record that cannot
    be traced, or that does not belong to the bench, and for effects that are none; nothing is left then.
    """
    if isinstance(request.bench, RateSensorBench):
        return _trace_sensor(request, request.bench, out, progress)
    if len(request.captures) > 1:
        from hil.tracing.pooling import trace_pool_files

        return trace_pool_files(request, request.bench, out, progress)
    if request.bench.device.sense.is_envelope:
        return _trace_envelope(request, request.bench, out, progress)
    return _trace_oscillator(request, request.bench, out, progress)


def _trace_oscillator(request: TraceRequest, bench: Bench, out: Path, progress: Watcher) -> Traced:
    """Of one record of an oscillator."""
    capture, fraction, missing_force = request.capture, request.fraction, request.missing_force
    require_usable(bench, "trace")
    workers()  # no number of them is told before minutes are spent
    require_place(out)
    captured, bench = fitting(capture, bench)
    said = (*captured.told, *filter(None, [swing_slip(captured, bench)]))
    captured, bench, trimmed = at_rest(captured, bench, trims_beside(capture))
    captured, held_out = parts_of(captured, fraction)
    if captured.carrier_Hz is not None:
        return _trace_streams(request, bench, out, captured, sample_of(captured, held_out), said)
    device, settings = recorded_device_of(bench, captured), observer_settings_of(bench)
    record, gyro = with_gyro(record_of(captured, drives_of(captured, device)), captured, capture)
    part = Part(captured, record, sample_of(captured, held_out), gyro)
    if fraction is None and "train" not in captured.segments:
        part = moving(part, device)
    captured, record, split = part.captured, part.record, part.split
    try:
        _require_unclipped(captured)
        require_traceable(record, device, split)
        left = TimeLeft()
        problem = Problem(record, device, settings, control_of(bench, captured), bench.loop.settle_s)

        def told(stage: str, done: int, total: int) -> None:
            progress(Progress(stage, done, total, left_s=left.told(stage, done, total)))

        found = interruptible(lambda: _traced(problem, split, told))
    except ModelError as error:
        raise InputError(f"{capture}: {error}") from None
    found = _within_limits(found, bench)
    blamed = [(one.name, one.coefficients) for one in found.effects]
    path = path_of(blamed, device.mass)
    found = replace(found, reasons=(*filter(None, [path.told]), *found.reasons))
    unnamed: MissingForce | None = None
    about: WrittenForce | None = None
    if missing_force or (missing_force is None and request.report and found.verdict.is_open):
        progress(Progress("missing force", 0, 0))
        unnamed, about = _unnamed(problem, split)
    diagnosis = to_model(
        found,
        record=called(capture),
        bench=bench.device.name,
        sense_unit=bench.device.sense.unit,
        prepared=(*said, *filter(None, [trimmed]), *part.said, *remarks(record, device)),
        missing_force=about,
        fault=path.is_fault,
    )
    folder = new_folder(out, bench)
    save_diagnosis(folder / "diagnosis.json", diagnosis)
    if unnamed is not None:
        save_force(folder / "force.arrow", unnamed)
    if request.report:
        progress(Progress("report", 0, 0))
        from hil.report.diagnosis import write_report

        write_report(folder, found, diagnosis, record, device, settings, unnamed, capture)
    return Traced(folder, diagnosis)


def _traced(problem: Problem, split: int, told: Callable[[str, int, int], None]) -> traced.Diagnosis:
    """Its modules are loaded here: after what can be refused without them, and where Ctrl-C need not wait for them."""
    from estimator.trace.trace import trace as by_likelihood

    return by_likelihood(problem, split=split, progress=told)


def _within_limits(found: traced.Diagnosis, bench: Bench) -> traced.Diagnosis:
    """The answer; *adequate* only where a replay of the record would keep [limits] innovation_ratio too."""
    if found.verdict is not traced.Verdict.ADEQUATE:
        return found
    limit = bench.limits.innovation_ratio
    over = [
        f"the innovation of the part {part} is {fit.ratio:.3g} × the noise floor ({fit.floor_from}), [limits] "
        f"innovation_ratio is {limit:g}"
        for part, fit in (("that was fitted", found.before), ("held out", found.held_out_before))
        if fit.ratio > limit
    ]
    return replace(found, verdict=traced.Verdict.UNEXPLAINED, reasons=(*found.reasons, *over)) if over else found


def _unnamed(problem: Problem, split: int) -> "tuple[MissingForce | None, WrittenForce]":
    """The force that the model lacks, and what is written of it; none where it cannot be estimated."""

    def estimated() -> MissingForce:
        from estimator.missing_force.estimate import missing_force  # compiles

        return missing_force(problem, split)

    try:
        found = interruptible(estimated)
    except ModelError as error:
        return None, refused(str(error))
    return found, force_model(found)


def _trace_streams(
    request: TraceRequest, bench: Bench, out: Path, captured: Capture, split: int, said: tuple[str, ...]
) -> Traced:
    """The same of demodulated streams: whether the averaged motion accounts for them."""
    capture = request.capture
    found = interruptible(lambda: trace_streams(capture, captured, bench, split))
    diagnosis = to_model(found, record=called(capture), bench=bench.device.name, prepared=said)
    folder = new_folder(out, bench)
    save_diagnosis(folder / "diagnosis.json", diagnosis)
    if request.report:
        from hil.report.diagnosis.page import Pictures, write_page

        seconds = f"{len(captured) / captured.tick_rate_Hz:.4g} s"
        write_page(folder, diagnosis, Pictures(), ("Record", seconds, f"{len(captured)} rows"), seconds)
    return Traced(folder, diagnosis)


def _trace_sensor(request: TraceRequest, bench: RateSensorBench, out: Path, progress: Watcher) -> Traced:
    """The same of a rate sensor: its answer is a static curve and a response instead of an innovation."""
    from hil.tracing.rate_sensor import sensor_remarks, trace_rate_sensor  # loads scipy.signal, which takes a second

    capture, source = request.capture, request.source
    assert source is not None  # as the request was checked
    progress(Progress("effects", 0, 0))
    found = interruptible(lambda: trace_rate_sensor(capture, bench))
    captured = read_capture(capture)
    said = (*captured.told, *sensor_remarks(captured))
    diagnosis = to_model(
        found, record=called(capture), bench=bench.device.name, sense_unit=bench.device.unit, prepared=said
    )
    folder = make_run_folder(out, request.name)
    write_sealed(folder / "bench.toml", source.read_text(encoding="utf-8"))
    save_diagnosis(folder / "diagnosis.json", diagnosis)
    if request.report:
        from hil.report.diagnosis.envelope import write_sensor_report

        assert captured.rate_rad_s is not None  # or it could not have been traced
        write_sensor_report(folder, found, diagnosis, captured.rate_rad_s)
    return Traced(folder, diagnosis)


def _trace_envelope(request: TraceRequest, bench: Bench, out: Path, progress: Watcher) -> Traced:
    """The same of a ring-down whose amplitude was recorded: a law of damping."""
    capture, fraction = request.capture, request.fraction
    captured = read_capture(capture)
    said = captured.told
    require_fit(captured, bench, capture)
    split = None
    if fraction is not None or "train" in captured.segments:
        captured, split = parts_of(captured, fraction)
    progress(Progress("effects", 0, 0))
    envelope, found = interruptible(lambda: trace_ring_down(capture, captured, bench, split))
    unit = "dB" if bench.device.sense.is_in_decibels else bench.device.sense.unit
    diagnosis = to_model(found, record=called(capture), bench=bench.device.name, sense_unit=unit, prepared=said)
    folder = new_folder(out, bench)
    save_diagnosis(folder / "diagnosis.json", diagnosis)
    if request.report:
        from hil.report.diagnosis.envelope import write_envelope_report

        write_envelope_report(folder, envelope, found, diagnosis)
    return Traced(folder, diagnosis)


def _require_unclipped(captured: Capture) -> None:
    share = float(np.mean((captured.flags & RowFlag.ADC_CLIPPED) != 0))
    if share > THRESHOLDS.fitness.clipped_share:
        raise ModelError(
            f"the board flagged {share:.2%} of the samples as clipped; "
            "record with a smaller amplitude, a lower gain or a wider converter"
        )


FRACTION = 0.6
"""Share of a record that is fitted, where it does not say so itself; the rest is held out."""


@dataclass(frozen=True)
class Part:
    """A part of a capture, its samples, the first sample of them that is held out, and what was left out, in words."""

    captured: Capture
    record: Record
    split: int
    said: tuple[str, ...] = ()


def parts_of(captured: Capture, fraction: float | None) -> tuple[Capture, int]:
    """The part of a record to be traced, and its first row that is held out."""
    segments = captured.segments
    if fraction is None and "train" in segments:
        start, stop = segments["train"]
        following = [end for first, end in segments.values() if first == stop]
        if following:
            return captured.part(start, max(following)), stop - start
    held_out = round((FRACTION if fraction is None else fraction) * len(captured))
    return captured, min(max(held_out, 1), len(captured) - 1)


def sample_of(captured: Capture, row: int) -> int:
    """The sample of `hil.inputs.captured.record_of` that is this row: there is one a tick."""
    return int(captured.tick[row] - captured.tick[0])


def moving(part: Part, device: Device) -> Part:
    """`part` without what follows when a free response has come to rest, where the part held out would be all of that.

    Friction, damping and stiffness all predict that a mass at rest stays there: such a part could contradict nobody.
    Where too little would be left, `part` stays as it is.
    """
    until = moves_until(part.record, device)
    if until > part.split:
        return part
    whole = part.captured
    rows = int(np.searchsorted(whole.tick - whole.tick[0], until))
    captured, held_out = parts_of(whole.part(0, rows), FRACTION)
    record, split = part.record.part(slice(0, until)), sample_of(captured, held_out)
    try:
        require_length(record, device, split)
    except ModelError:
        return part
    rest = len(part.record) - until
    said = (
        f"the motion has come to rest at {record.time[-1]:.4g} s: the {rest} samples after that are not used, "
        "since every law predicts that a mass at rest stays there; --fraction uses them"
    )
    return Part(captured, record, split, (*part.said, said))
