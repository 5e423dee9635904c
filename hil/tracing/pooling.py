"""Several records of one device traced together: captures in, one diagnosis out."""

import math
from collections.abc import Sequence
from pathlib import Path

from estimator import diagnosis as traced
from estimator.errors import ModelError
from estimator.side_by_side import interruptible, workers
from estimator.trace.pool import Member, Pool, held_out_by_default
from estimator.trace.traceable import remarks, require_traceable
from hil.bench import Bench
from hil.bench.by_verb import require_usable
from hil.errors import InputError
from hil.inputs.captured import control_of, drives_of, record_of
from hil.inputs.declared import observer_settings_of, recorded_device_of
from hil.progress import Progress, Watcher
from hil.records.atomic import require_place
from hil.records.capture import Capture, read_capture, trims_beside
from hil.records.diagnosis import save_diagnosis, to_model
from hil.replaying.replay import require_fit
from hil.running.run import new_folder
from hil.tracing.request import Traced, TraceRequest, called
from hil.tracing.time_left import TimeLeft

_ALIKE = 1e-3  # relative, of the noise that filters leave of records traced together


def trace_pool_files(request: TraceRequest, bench: Bench, out: Path, progress: Watcher) -> Traced:
    """Trace the records of `request` together; a new folder below `out` has the answer.

    covariate: a number that each record carries (`[covariates]` of its map) on which constants and coefficients may
    depend; hold_out: names of the records that only judge, by default a third of them.  Raises InputError for records
    that cannot be traced together; nothing is left then.
    """
    captures, covariate = request.captures, request.covariate
    workers()
    require_usable(bench, "trace")
    require_place(out)
    records = [read_capture(place) for place in captures]
    for place, record in zip(captures, records, strict=True):
        require_fit(record, bench, place)
        if trims_beside(place) is not None:
            raise InputError(f"{place}: trim voltages changed the springs; trace this record alone, not with others")
        if record.carrier_Hz is not None:
            raise InputError(f"{place}: demodulated streams, of which one record is traced at a time")
    names = _names(captures)
    _require_alike(captures, records)
    device = recorded_device_of(bench, records[0])
    members = []
    for place, record, each in zip(captures, records, names, strict=True):
        numbers = record_of(record, drives_of(record, device))
        try:
            require_traceable(numbers, device, len(numbers) // 2)
        except ModelError as error:
            raise InputError(f"{place}: {error}") from None
        members.append(Member(each, numbers, _covariate(place, record, covariate)))
    pool = Pool(
        tuple(members),
        device,
        observer_settings_of(bench),
        covariate,
        control_of(bench, records[0]),
        bench.loop.settle_s,
    )
    judges = _judges(names, request.hold_out) or held_out_by_default(pool)
    left = TimeLeft()

    def told(stage: str, done: int, total: int) -> None:
        progress(Progress(stage, done, total, left_s=left.told(stage, done, total)))

    def searched() -> traced.Diagnosis:
        from estimator.trace.pool_trace import trace_pool  # loaded after what can be refused without it

        return trace_pool(pool, judges, told)

    try:
        found = interruptible(searched)
    except ModelError as error:
        raise InputError(f"{len(captures)} records: {error}") from None
    said = [remark for record in records for remark in record.prepared]
    said += [f"{each}: {record.cut}" for each, record in zip(names, records, strict=True) if record.cut]
    said += [f"{member.name}: {remark}" for member in members for remark in remarks(member.record, device)]
    diagnosis = to_model(
        found,
        record=f"{len(names)} records: {', '.join(names)}",
        bench=bench.device.name,
        sense_unit=bench.device.sense.unit,
        prepared=tuple(dict.fromkeys(said)),
    )
    folder = new_folder(out, bench)
    save_diagnosis(folder / "diagnosis.json", diagnosis)
    if request.report:
        from hil.report.diagnosis.page import write_pool_report

        write_pool_report(folder, diagnosis)
    return Traced(folder, diagnosis)


def _names(captures: Sequence[Path]) -> list[str]:
    names = [called(place) for place in captures]
    if twice := next((each for each in names if names.count(each) > 1), None):
        raise InputError(f"{twice}: named twice; records of a trace have names of their own, rename one of the files")
    return names


def _covariate(place: Path, record: Capture, name: str | None) -> float:
    if name is None:
        return 0.0
    if name not in record.covariates:
        there = ", ".join(record.covariates) or "none"
        raise InputError(
            f"{place}: no covariate {name}; it has: {there}. Import it with covariates = {{ {name} = … }} in its map"
        )
    return record.covariates[name]


def _require_alike(captures: Sequence[Path], records: Sequence[Capture]) -> None:
    """One device is fitted to all records: InputError for one with another filter, or another unit of the drive."""
    first = records[0]
    for place, record in zip(captures, records, strict=True):
        if not math.isclose(record.noise_gain, first.noise_gain, rel_tol=_ALIKE):
            raise InputError(f"{place}: filtered otherwise than {captures[0]}; import all records with one [filter]")
        if (record.has_drive, record.drive_unit) != (first.has_drive, first.drive_unit):
            units = [one.drive_unit if one.has_drive else "no unit, as there is none" for one in (record, first)]
            raise InputError(
                f"{place}: drive in {units[0]}, of {captures[0]} in {units[1]}; import all records with one unit"
            )


def _judges(names: Sequence[str], held_out: Sequence[str]) -> tuple[int, ...]:
    for each in held_out:
        if each not in names:
            raise InputError(f"--hold-out: no record {each}; there are: {', '.join(names)}")
    return tuple(sorted({names.index(each) for each in held_out}))
