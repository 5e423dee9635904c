"""A trace as it is asked for, checked as far as it can be without the record: for every caller alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path

from hil.bench import Bench, RateSensorBench, load_any_bench, override
from hil.bench.examples import bench_file
from hil.errors import InputError
from hil.errors.input import names_of, require
from hil.options import chosen
from hil.records.diagnosis import Diagnosis
from hil.tracing.options import TraceOptions


@dataclass(frozen=True)
class TraceRequest:
    """Captures, one or several to be traced together, and the bench with the name of the trace in it.

    source: the bench file, where there is one; it is kept of a rate sensor.  name: of the folder.  The rest is as in
    `TraceOptions`.
    """

    captures: tuple[Path, ...]
    bench: Bench | RateSensorBench
    source: Path | None
    name: str
    fraction: float | None = None
    report: bool = True
    missing_force: bool | None = None
    covariate: str | None = None
    hold_out: tuple[str, ...] = ()

    @property
    def capture(self) -> Path:
        return self.captures[0]

    @property
    def called(self) -> str:
        """What errors call the bench."""
        return self.bench.device.name if self.source is None else str(self.source)


def request_of(
    captures: Path | Sequence[Path], bench: Bench | RateSensorBench | Path | str, options: TraceOptions
) -> TraceRequest:
    """Put together what is asked of a trace.  Raises InputError, which speaks of the options of `hil trace`."""
    given = chosen(TraceOptions, options)
    if isinstance(bench, Bench | RateSensorBench):
        source, declared = None, bench
    else:
        source = bench_file("bench", bench)
        declared = load_any_bench(source)
    require("fraction", given["fraction"], Real | None, "a number")
    given["hold_out"] = names_of("hold_out", given["hold_out"])
    name = given["name"] or "trace"
    if isinstance(declared, Bench):
        name = given["name"] or f"{declared.loop.name}-trace"
        declared = override(
            declared, {"loop": {"name": name}}, f"{source or declared.device.name} with the options given"
        )
    together = (captures,) if isinstance(captures, Path) else tuple(captures)
    request = TraceRequest(together, declared, source, **{**given, "name": name})
    _require_fit(request)
    return request


def _require_fit(request: TraceRequest) -> None:
    """InputError for what cannot be asked of such records, or such a device."""
    if request.fraction is not None and not 0.0 < request.fraction < 1.0:
        raise InputError(f"--fraction: {request.fraction:g} is no share of the record; give a number between 0 and 1")
    if len(request.captures) > 1:
        _require_several(request)
    elif request.covariate is not None or request.hold_out:
        raise InputError("--covariate and --hold-out belong to several records; name them, or leave those out")
    if isinstance(request.bench, RateSensorBench):
        _require_of_a_sensor(request)
    elif request.bench.device.sense.is_envelope and request.missing_force:
        raise InputError(
            f"{request.capture}: an envelope, which shows no force at an instant; leave out --missing-force"
        )


def _require_several(request: TraceRequest) -> None:
    if isinstance(request.bench, RateSensorBench):
        raise InputError(f"{request.called}: a rate sensor; its records are traced one by one")
    if request.bench.device.sense.is_envelope:
        raise InputError(f"{request.called}: an envelope, which is traced by itself; leave out further records")
    if request.missing_force or request.fraction is not None:
        raise InputError("several records: they are held out whole; leave out --missing-force and --fraction")


def _require_of_a_sensor(request: TraceRequest) -> None:
    if request.source is None:
        raise InputError(f"{request.called}: a rate sensor; give the path of its bench file")
    if request.fraction is not None:
        raise InputError("--fraction: the record of a rate sensor is split by its segments, or in alternate blocks")
    if request.missing_force:
        raise InputError("--missing-force: a rate sensor has no force that could be missing; leave it out")


@dataclass(frozen=True)
class Traced:
    """Where a trace was written (diagnosis.json, report.html, bench.toml), and what it came to."""

    folder: Path
    diagnosis: Diagnosis


def called(capture: Path) -> str:
    """What a record is called: its run folder's name, or its own."""
    return capture.resolve().parent.name if capture.name == "capture.arrow" else capture.stem
