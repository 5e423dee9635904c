"""Routes of the bench files: those of the bench's folder and the examples, read and given what a trace found."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Request
from fastapi.responses import PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from hil.bench import Bench, load_any_bench
from hil.errors import InputError
from hil.records.kind import RUN_NAME
from hil.service.bench_files import files, found
from hil.service.problems import Problem
from hil.service.routes_runs import catalogue_of
from hil.service.service import holder_of, service_of

router = APIRouter(tags=["benches"])

BenchName = Annotated[str, Field(max_length=200)]


class Adding(BaseModel):
    """What goes into a bench file, and what the new one is called."""

    model_config = ConfigDict(extra="forbid")

    trace: Annotated[str, StringConstraints(max_length=200)]
    name: Annotated[str, StringConstraints(pattern=RUN_NAME, max_length=60)] | None = Field(
        default=None, description="By default the old name with -better, and a number where that is taken"
    )


@router.get("/api/benches")
def benches(request: Request) -> dict[str, list[dict[str, Any]]]:
    """The bench files that runs can be made with."""
    listed = files(service_of(request).folder, "bench")
    return {"benches": [_told(name, path) for name, path in sorted(listed.items())]}


@router.get("/api/benches/{name}", response_class=PlainTextResponse)
def bench(request: Request, name: BenchName) -> str:
    """A bench file as it stands."""
    return _found(request, name).read_text(encoding="utf-8", errors="replace")


@router.post("/api/benches/{name}/effects", status_code=201)
def add(request: Request, name: BenchName, adding: Adding) -> dict[str, Any]:
    """Write a new bench file beside the runs: this one, with what a trace found declared (`hil trace --add`)."""
    from hil.records.diagnosis import load_diagnosis
    from hil.tracing.addition import add_found

    service, source = service_of(request), _found(request, name)
    folder = catalogue_of(request).path_of(adding.trace)
    if not (folder / "diagnosis.json").exists():
        raise Problem(400, f"{adding.trace}: a run, not a trace", "trace it first")
    target = _target(service.folder, name, adding.name)
    diagnosis = load_diagnosis(folder / "diagnosis.json")
    written = add_found(diagnosis, source, target).names
    if not written:
        raise Problem(400, f"{diagnosis.verdict}: there is nothing to add", "only what is explained is declared")
    made = target.name.removesuffix(".bench.toml")
    try:
        service.audit.note(holder_of(request), "effects added", trace=adding.trace, bench=name, made=made)
    except Problem:
        target.unlink()
        raise
    return {"name": made, "effects": written}


def _found(request: Request, name: str) -> Path:
    try:
        return found(service_of(request).folder, "bench", name)
    except InputError as error:
        raise Problem(404, str(error), "GET /api/benches lists them") from None


def _target(runs: Path, name: str, wanted: str | None) -> Path:
    """A file that is not there yet, beside the runs."""
    place, listed = runs.resolve().parent, files(runs, "bench")
    if wanted is not None:
        if wanted in listed:
            raise Problem(409, f"{wanted}: there is such a bench file", "give another name")
        return place / f"{wanted}.bench.toml"
    bare = f"{name.removesuffix('.bench.toml')}-better"
    names = (bare if number == 1 else f"{bare}-{number}" for number in range(1, 10_000))
    return place / f"{next(one for one in names if one not in listed)}.bench.toml"


def _told(name: str, path: Path) -> dict[str, Any]:
    try:
        changed = path.stat().st_mtime_ns
    except OSError:
        changed = 0
    return {"name": name, **_read(path, changed)}


@lru_cache(maxsize=256)
def _read(path: Path, _changed: int) -> dict[str, Any]:
    """What a bench file declares, as far as a list needs it."""
    try:
        declared = load_any_bench(path)
    except InputError as error:
        return {"error": str(error)}
    told: dict[str, Any] = {"device": declared.device.name}
    if isinstance(declared, Bench):
        device = declared.device
        told |= {
            "link": declared.link.url,
            "duration_s": declared.loop.duration_s,
            "mode": declared.loop.mode,
            "axes": device.axes,
            "settings": {
                "target_stiffness": declared.target_stiffness_per_s2 * device.mass_kg,
                "amplitude": device.amplitude_m,
                "virtual_rotation": declared.controller.virtual_rotation_rad_s,
                "dither": declared.controller.dither_mps2,
            },
        }
    return told
