"""Routes of the runs: lists, one run and what it recorded, two side by side, devices and their trends.

A run is named by its id, which is looked up in the catalogue: no part of an address is a path.
"""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse, JSONResponse, Response
from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from hil.records.junit import Case, junit_xml
from hil.service import series
from hil.service.catalogue import queries
from hil.service.catalogue.catalogue import Catalogue, Looked
from hil.service.catalogue.entry import Tag
from hil.service.catalogue.keeping import compare as compare_runs
from hil.service.catalogue.keeping import kept
from hil.service.catalogue.queries import Filter, Page
from hil.service.problems import Problem, Unknown
from hil.service.service import Service, holder_of, service_of

router = APIRouter(tags=["runs"])
PART = "catalogue"

_TELL_EACH = 20
REPORT_HEADERS = {
    "content-security-policy": "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "frame-ancestors 'self'",
    "x-frame-options": "SAMEORIGIN",
}
"""Of a report, which may load and run nothing, in a frame of this page."""

RunId = Annotated[str, Field(max_length=200)]


@asynccontextmanager
async def lifespan(service: Service) -> AsyncIterator[None]:
    """The catalogue of a service, kept up to date."""
    loop = asyncio.get_running_loop()

    def tell(message: dict[str, Any]) -> None:
        loop.call_soon_threadsafe(service.tell, message)

    def changed(run: str) -> None:
        tell({"kind": "run", "run": _row_or_gone(catalogue, run)})  # apart: a row has a kind of its own

    def looked(found: Looked) -> None:
        if found.changed > _TELL_EACH or found.gone:
            tell({"kind": "runs", "changed": found.changed, "gone": found.gone})
        for run in found.ids if found.changed <= _TELL_EACH else ():
            changed(run)

    catalogue = await asyncio.to_thread(Catalogue, service.folder, service.private, changed)
    service.parts[PART] = catalogue
    try:
        with kept(catalogue, looked):
            yield
    finally:
        catalogue.close()


def catalogue_of(request: Request) -> Catalogue:
    found: Catalogue = service_of(request).parts[PART]
    return found


class Marking(BaseModel):
    """What is changed of a run's marks; what is left out stays."""

    model_config = ConfigDict(extra="forbid")

    tags: Annotated[list[Tag], Field(max_length=50)] | None = None
    note: Annotated[str, StringConstraints(max_length=10_000)] | None = None


@router.get("/api/runs")
def runs(request: Request, page: Annotated[Page, Query()]) -> dict[str, Any]:
    """A page of runs and traces."""
    return queries.listed(catalogue_of(request), page)


@router.get("/api/runs.junit.xml", response_class=Response)
def junit(request: Request, chosen: Annotated[Filter, Query()]) -> Response:
    """Verdicts as JUnit XML, of all runs of a filter."""
    catalogue, after, cases = catalogue_of(request), None, list[Case]()
    while True:
        found = queries.listed(catalogue, Page(**chosen.model_dump(), limit=queries.MOST, after=after))
        cases += [_case(row) for row in found["runs"]]
        if (after := found["next"]) is None:
            return Response(junit_xml(cases, catalogue.folder.resolve().name), media_type="application/xml")


@router.get("/api/tags")
def tags(request: Request) -> dict[str, int]:
    """All tags, with how many runs have each."""
    return queries.tags(catalogue_of(request))


@router.get("/api/figures")
def figures(request: Request) -> list[dict[str, Any]]:
    """All figures that runs can be filtered and sorted by."""
    return queries.figure_names(catalogue_of(request))


@router.delete("/api/trash")
def empty_trash(request: Request) -> dict[str, int]:
    """Remove what was deleted for good."""
    removed = catalogue_of(request).empty_trash()
    service_of(request).audit.note_anyway(holder_of(request), "trash emptied", runs=removed)  # it is what makes room
    return {"removed": removed}


@router.post("/api/catalogue/rebuild")
def rebuild(request: Request) -> dict[str, int]:
    """Read all folders anew: after an editor changed a file in place, or where the catalogue is not to be trusted."""
    found = catalogue_of(request).rebuild()
    service_of(request).audit.note_anyway(holder_of(request), "catalogue rebuilt", runs=found.changed)
    return {"runs": found.changed}


@router.get("/api/compare")
def compare(request: Request, a: RunId, b: RunId) -> dict[str, Any]:
    """Two runs, or two traces, side by side."""
    return compare_runs(catalogue_of(request), a, b)


@router.get("/api/devices")
def devices(request: Request) -> list[dict[str, Any]]:
    """Devices by serial number, the last used first."""
    return queries.devices(catalogue_of(request))


@router.get("/api/devices/{serial}")
def device(request: Request, serial: RunId) -> dict[str, Any]:
    """One device, and the figures that its runs have."""
    return queries.device(catalogue_of(request), serial)


@router.get("/api/devices/{serial}/trend")
def trend(request: Request, serial: RunId, figure: Annotated[str, Query(max_length=200)]) -> dict[str, Any]:
    """A figure over the runs of a device, the oldest first."""
    return queries.trend(catalogue_of(request), serial, figure)


@router.get("/api/runs/{run}")
def run(request: Request, run: RunId) -> dict[str, Any]:
    """A run or a trace: its row, all figures, its files, and the traces made of it."""
    catalogue = catalogue_of(request)
    found = queries.one(catalogue, run)
    files = [{"name": name, "bytes": size} for name, (_, size) in _files(_path(request, run)).items()]
    return {**found, "files": files}


@router.patch("/api/runs/{run}")
def mark(request: Request, run: RunId, marking: Marking) -> dict[str, Any]:
    """Give a run tags or a note."""
    catalogue = catalogue_of(request)
    _path(request, run)
    _audit(request, "run marked", run=run, **marking.model_dump(exclude_none=True))
    catalogue.mark(run, tags=marking.tags, note=marking.note)
    return queries.one(catalogue, run)


@router.delete("/api/runs/{run}")
def delete(request: Request, run: RunId) -> dict[str, str]:
    """Move a run into the trash."""
    catalogue, jobs = catalogue_of(request), service_of(request).parts.get("jobs")
    folder = _path(request, run).name
    if jobs is not None and (busy := jobs.using(folder)):
        raise Problem(409, f"{run}: job {busy[0]} works on it", "wait for it, or cancel it")
    _audit(request, "run deleted", run=run)
    catalogue.delete(run)
    return {"deleted": run, "undo": f"/api/runs/{run}/restore"}


@router.post("/api/runs/{run}/restore")
def restore(request: Request, run: RunId) -> dict[str, Any]:
    """Take a run back from the trash."""
    catalogue = catalogue_of(request)
    catalogue.restore(run)
    service_of(request).audit.note_anyway(holder_of(request), "run restored", run=run)
    return queries.one(catalogue, run)


@router.get("/api/runs/{run}/report", response_class=Response)
def report(request: Request, run: RunId) -> Response:
    """The page of a run, for a frame: it may load and run nothing."""
    return FileResponse(_file(request, run, "report.html"), media_type="text/html", headers=REPORT_HEADERS)


@router.get("/api/runs/{run}/diagnosis")
def diagnosis(request: Request, run: RunId) -> Response:
    """What a trace came to, diagnosis.json."""
    return FileResponse(_file(request, run, "diagnosis.json"), media_type="application/json")


@router.get("/api/runs/{run}/result")
def result(request: Request, run: RunId) -> Response:
    """What a run came to, result.json."""
    return FileResponse(_file(request, run, "result.json"), media_type="application/json")


@router.get("/api/runs/{run}/files/{name}", response_class=Response)
def file(request: Request, run: RunId, name: Annotated[str, Field(max_length=255)]) -> Response:
    """Download one of a run's files."""
    return FileResponse(_file(request, run, name), media_type="application/octet-stream", filename=f"{run}-{name}")


@router.get("/api/runs/{run}/channels")
def channels(request: Request, run: RunId) -> list[dict[str, Any]]:
    """What a run recorded that can be drawn."""
    folder = _path(request, run)
    return [one._asdict() for one in series.channels(folder)]


@router.get("/api/runs/{run}/series", response_class=Response)
def window(
    request: Request,
    run: RunId,
    channels: Annotated[str, Query(max_length=4000, description="Names, separated by commas")],
    from_s: Annotated[float | None, Query(alias="from")] = None,
    to_s: Annotated[float | None, Query(alias="to")] = None,
    points: Annotated[int, Query(ge=1, le=series.MOST_POINTS)] = 800,
) -> Response:
    """Lowest and highest values of channels over bench time, as a binary frame (`GYT1`); 202 with a job where the
    record is long and has to be prepared first."""
    folder = _path(request, run)
    names = [name for name in channels.split(",") if name]
    try:
        frame = series.window(folder, names, from_s, to_s, points)
    except series.PyramidNeeded as needed:
        return _prepared(request, run, needed)
    return Response(frame.packed(), media_type="application/octet-stream")


def _prepared(request: Request, run: str, needed: series.PyramidNeeded) -> Response:
    """Have the pyramid made, and tell the job."""
    jobs = service_of(request).parts.get("jobs")
    if jobs is None:
        raise Problem(503, str(needed), "ask again when the service has begun")
    job = jobs.pyramid(run, needed.record, by=holder_of(request).name)
    return JSONResponse({"job": job}, 202, {"retry-after": "2"})


def _path(request: Request, run: str) -> Path:
    return catalogue_of(request).path_of(run)


def _files(folder: Path) -> dict[str, tuple[Path, int]]:
    """The files of a run, by name: plain ones in its folder."""
    found = {}
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_file(follow_symlinks=False) and not entry.name.startswith("."):
                found[entry.name] = (Path(entry.path), entry.stat(follow_symlinks=False).st_size)
    return dict(sorted(found.items()))


def _file(request: Request, run: str, name: str) -> Path:
    folder = _path(request, run)
    files = _files(folder)
    if name not in files:
        raise Problem(404, f"{run} has no file of that name", f"GET /api/runs/{run} lists its files")
    return files[name][0]


def _audit(request: Request, what: str, **details: Any) -> None:
    service_of(request).audit.note(holder_of(request), what, **details)


def _case(row: dict[str, Any]) -> Case:
    told = row["unreadable"], *row["reasons"]
    reasons = tuple(reason for reason in told if reason)
    return Case(row["folder"], row["device"] or "", row["verdict"] or "", row["seconds"], reasons)


def _row_or_gone(catalogue: Catalogue, run: str) -> dict[str, Any]:
    try:
        row = queries.one(catalogue, run)
    except Unknown:
        return {"id": run, "deleted": True}
    return {name: value for name, value in row.items() if name != "traces"}
