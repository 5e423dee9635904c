"""Routes of the jobs and of what they need: uploads and bench files."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated, Any

from fastapi import APIRouter, Body, Request, Response
from fastapi.responses import FileResponse
from pydantic import Field
from starlette.datastructures import UploadFile
from starlette.requests import ClientDisconnect

from hil.errors import InputError
from hil.service.bench_files import files
from hil.service.jobs.asked import Asked, order_of
from hil.service.jobs.jobs import FOLDER, Jobs
from hil.service.jobs.uploads import TooLarge, Uploads
from hil.service.problems import Problem
from hil.service.routes_runs import REPORT_HEADERS, catalogue_of
from hil.service.service import Service, holder_of, service_of

router = APIRouter(tags=["jobs"])

JobId = Annotated[str, Field(max_length=200)]
_PIECE = 1 << 20
_FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["record"],
                    "properties": {
                        "record": {"type": "string", "format": "binary"},
                        "map": {"type": "string", "format": "binary"},
                    },
                }
            }
        },
    }
}


@asynccontextmanager
async def lifespan(service: Service) -> AsyncIterator[None]:
    loop, catalogue = asyncio.get_running_loop(), service.parts["catalogue"]

    def told(row: dict[str, Any]) -> None:
        loop.call_soon_threadsafe(service.tell, {"kind": "job", "job": row})

    uploads = Uploads(service.private / "uploads")

    def told_and_tidied(row: dict[str, Any]) -> None:
        if row["kind"] == "import" and row["state"] == "done":
            uploads.remove(row["asked"]["upload"])
        told(row)

    jobs = await asyncio.to_thread(
        Jobs, service.private / FOLDER, service.folder, told=told_and_tidied, made=catalogue.look_at
    )
    service.parts |= {"jobs": jobs, "uploads": uploads}
    try:
        yield
    finally:
        await asyncio.to_thread(jobs.close)


@router.get("/api/jobs")
def jobs(request: Request) -> dict[str, list[dict[str, Any]]]:
    """All jobs, the newest first."""
    return {"jobs": _jobs(request).rows()}


@router.post("/api/jobs", status_code=201)
def add(request: Request, asked: Annotated[Asked, Body()]) -> dict[str, Any]:
    """Ask for a run of an emulated board, a recording of a sensor, a trace, a replay, a data sheet, an
    identification, an import or a campaign."""
    service, holder = service_of(request), holder_of(request)
    order = order_of(asked, service.folder, catalogue_of(request).path_of, service.parts["uploads"])
    told = asked.model_dump(exclude_none=True, exclude_defaults=True, by_alias=True)

    def noted(name: str) -> None:
        service.audit.note(holder, "job asked for", job=name, **told)

    return _jobs(request).add(order, told, by=holder.name, noted=noted)


@router.get("/api/jobs/{job}")
def job(request: Request, job: JobId) -> dict[str, Any]:
    """One job."""
    return _jobs(request).row(job)


@router.get("/api/jobs/{job}/report", response_class=Response)
def report(request: Request, job: JobId) -> Response:
    """The page of a campaign, for a frame: it may load and run nothing."""
    campaign = (_jobs(request).row(job)["result"] or {}).get("campaign")
    path = None if campaign is None else service_of(request).folder / campaign / "report.html"
    if path is None or not path.is_file():
        raise Problem(404, f"{job}: no report", "campaigns have one once they are done; that of a run is its run's")
    return FileResponse(path, media_type="text/html", headers=REPORT_HEADERS)


@router.get("/api/campaigns")
def campaigns(request: Request) -> dict[str, list[str]]:
    """The campaign files that a job can be asked for with."""
    return {"campaigns": sorted(files(service_of(request).folder, "campaign"))}


@router.delete("/api/jobs/{job}")
def cancel(request: Request, job: JobId) -> dict[str, Any]:
    """Have a job end, well: a run closes its record. One that has ended is taken off the list, what it made stays."""
    row = _jobs(request).cancel(job)
    service_of(request).audit.note_anyway(holder_of(request), "job cancelled", job=job)
    return row


@router.post("/api/uploads", status_code=201, openapi_extra=_FORM)
async def upload(request: Request) -> dict[str, Any]:
    """Send a record (CSV, plain or gzipped; MATLAB; Parquet; what a package reads) as `record` and, where its columns
    have other names, a map of them as `map`; then ask for a job of kind `import`. It is not looked into here."""
    uploads: Uploads = service_of(request).parts["uploads"]
    try:
        async with request.form(max_files=4, max_fields=4) as form:
            for part in ("record", "map"):
                if len(form.getlist(part)) > 1:
                    raise Problem(422, f"more than one {part} in the form", "send each record in a request of its own")
            record, given = form.get("record"), form.get("map")
            if not isinstance(record, UploadFile):
                raise InputError("no file called record in the form; send one")
            receiving = uploads.begin(record.filename or "")
            try:
                await receiving.record(_pieces(record))
                if isinstance(given, UploadFile) and given.size:
                    await receiving.map(_pieces(given), given.filename or "")
                found = receiving.done()
            except BaseException:
                receiving.give_up()
                raise
    except OSError as error:  # of the form's own temporary file, or of this bench's folder
        room = "make room where TMPDIR is and beside the runs, or import it with hil import"
        raise Problem(507, f"the upload: {(error.strerror or 'cannot be written').lower()}", room) from None
    except (Problem, TooLarge):
        raise
    except (InputError, ClientDisconnect, ValueError) as error:
        raise Problem(400, str(error) or "the upload was cut off; send it again") from None
    try:
        service_of(request).audit.note(holder_of(request), "record uploaded", upload=found.id, bytes=found.bytes)
    except Problem:
        uploads.remove(found.id)
        raise
    return {"id": found.id, "bytes": found.bytes, "map": found.map is not None}


def _jobs(request: Request) -> Jobs:
    found: Jobs = service_of(request).parts["jobs"]
    return found


async def _pieces(file: UploadFile) -> AsyncIterator[bytes]:
    while piece := await file.read(_PIECE):
        yield piece
