"""The application: parts of the service put together, each with its routes and what runs beside them."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fastapi import APIRouter, FastAPI, Request
from pydantic import BaseModel
from starlette.staticfiles import StaticFiles

from hil.service.problems import Problem, ProblemBody, answer_problems
from hil.service.security.bodies import Bodies
from hil.service.security.guard import Guard
from hil.service.service import Service, holder_of, service_of

PARTS = ("routes_runs", "routes_jobs", "routes_benches", "routes_board", "routes_live", "routes_metrics")
"""Modules of this package with a `router`, and with a `lifespan(service)` where something runs beside the routes: an
async context manager around all of the service's life."""

_REFUSALS: dict[int | str, dict[str, Any]] = {
    code: {"model": ProblemBody} for code in (400, 401, 403, 404, 409, 413, 422, 503, 507)
}
_own = APIRouter(tags=["service"])


def make_app(service: Service) -> FastAPI:
    modules = [import_module(f"hil.service.{part}") for part in PARTS]

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            for module in modules:
                if hasattr(module, "lifespan"):
                    await stack.enter_async_context(module.lifespan(service))
            yield

    app = FastAPI(
        title="gyrohil",
        version=version("gyrohil"),
        summary="A hardware-in-the-loop bench for angle-measuring gyroscopes, as a service",
        lifespan=lifespan,
        docs_url=None,  # they load scripts from elsewhere; page/docs has what they show
        redoc_url=None,
        responses=_REFUSALS,
    )
    app.state.service = service
    answer_problems(app)
    for router in (_own, *(module.router for module in modules)):
        app.include_router(router)
    app.mount("/", StaticFiles(directory=PAGE, html=True), name="page")
    app.add_middleware(Bodies)  # after the guard: only who may ask is listened to
    app.add_middleware(Guard, hosts=service.hosts, tokens=service.tokens, tickets=service.tickets)
    return app


class TicketFor(BaseModel):
    """What a ticket is asked for."""

    path: str
    """a path of this service, beginning with /api/runs/ or /api/jobs/"""


class Ticket(BaseModel):
    """A short-lived right to read one path."""

    url: str
    """the path with the ticket, good for a minute"""


@_own.get("/healthz")
async def healthz() -> dict[str, str]:
    """Whether the service answers; says nothing of the bench, and needs no token."""
    return {"status": "ok"}


@_own.get("/api/who")
async def who(request: Request) -> dict[str, str]:
    """Name and role of the token's holder."""
    holder = holder_of(request)
    return {"name": holder.name, "role": holder.role.name.lower()}


@_own.post("/api/ticket")
async def ticket(request: Request, wanted: TicketFor) -> Ticket:
    """A ticket for a frame or a download, which cannot send the token: to read `path` for a minute."""
    if not wanted.path.startswith(("/api/runs/", "/api/jobs/")) or "?" in wanted.path or "#" in wanted.path:
        raise Problem(
            422, "a ticket is for a path below /api/runs/ or /api/jobs/", "give the path alone, without a query"
        )
    made = service_of(request).tickets.make(wanted.path, holder_of(request))
    return Ticket(url=f"{wanted.path}?ticket={made}")


@_own.get("/api/audit")
async def audit(request: Request, limit: int = 1000) -> list[dict[str, Any]]:
    """Who changed what, the newest first."""
    if not 1 <= limit <= 10_000:
        raise Problem(422, f"limit: {limit} is not between 1 and 10000", "give a number in that range")
    return service_of(request).audit.entries(limit)


PAGE = Path(__file__).parent / "page"
_FETCHED = ("uPlot.esm.js", "uPlot.min.css")


def lacking(page: Path = PAGE) -> str:
    """One line on what the page in that folder lacks and how to get it, "" where it is complete."""
    missing = [name for name in _FETCHED if not (page / "vendor" / name).is_file()]
    if not missing:
        return ""
    return f"the page will draw no curves: {' and '.join(missing)} not there; `make install` fetches what is missing"
