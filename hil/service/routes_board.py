"""Routes of the board and its lease."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated, Any, cast

from fastapi import APIRouter, Header, Request
from pydantic import BaseModel, ConfigDict, Field, StrictBool

from hil.options import chosen, with_fields
from hil.running.options import RunOptions
from hil.running.process.live_settings import Settings
from hil.service.board import part
from hil.service.board.lease import LONGEST_S
from hil.service.board.part import BoardPart
from hil.service.problems import Problem
from hil.service.security.tokens import Role
from hil.service.service import Service, holder_of, service_of

router = APIRouter(tags=["board"])
Lease = Annotated[str | None, Header(alias="X-Lease", description="the lease of the board")]
_LINE = Field(max_length=200, pattern=r"^[^\x00-\x1f\x7f]*$")


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Connect(_Body):
    """Where the board is."""

    link: str = Field(max_length=1000)
    """as of `hil run --link`; scenarios by name, serial ports below /dev"""
    bench: str | None = Field(default=None, max_length=200)
    """name of a bench file of this bench, or of an example, that a start takes when it names none"""


@with_fields(RunOptions)
class Drives(_Body):
    """What would be run."""

    bench: str | None = Field(default=None, max_length=200)
    bench_toml: str | None = Field(default=None, max_length=100_000)
    """a bench file's text, instead"""
    settings: Settings = Settings()

    @property
    def start(self) -> part.Start:
        return part.Start(
            self.bench, self.bench_toml, self.settings.given, cast(RunOptions, chosen(RunOptions, dict(self)))
        )


class Start(Drives):
    """What is to be run."""

    consent: StrictBool = False
    """that the board may be armed: said for each run anew, needed for every board that was not started here"""
    agreed: str | None = Field(default=None, max_length=64)
    """digest of POST /api/board/drives: the start is refused where what would drive is no longer that"""


class TakeLease(_Body):
    """Who wants the board, for what, and for how long without renewal."""

    holder: Annotated[str, _LINE]
    purpose: Annotated[str, _LINE] = ""
    seconds: float = Field(default=60.0, ge=1.0, le=LONGEST_S)
    wait: StrictBool = False
    """queue where somebody has it"""


@asynccontextmanager
async def lifespan(service: Service) -> AsyncIterator[None]:
    """The board's part, as long as the service lives; a board that was held before is found again."""
    held = BoardPart(service)
    service.parts["board"] = held
    service.at_signal.append(held.line.end_soon)
    try:
        yield
    finally:
        await held.close()


def board_of(request: Request) -> BoardPart:
    return cast(BoardPart, service_of(request).parts["board"])


def _operated(request: Request, lease: str | None, what: str, **details: Any) -> BoardPart:
    """The board, for the holder of its lease, with an entry in the audit log; without one nothing is to be done."""
    held = board_of(request)
    holder = held.leases.require(lease)
    service_of(request).audit.note(holder_of(request), what, lease=holder, **details)
    return held


def _stopped(request: Request, lease: str | None, what: str) -> BoardPart:
    """The same for what stops, or lets go: that does not depend on the log."""
    held = board_of(request)
    holder = held.leases.require(lease)
    service_of(request).audit.note_anyway(holder_of(request), what, lease=holder)
    return held


@router.get("/api/board")
async def board(request: Request) -> dict[str, Any]:
    """The board's state."""
    return board_of(request).state


@router.post("/api/board/connect")
async def connect(request: Request, wanted: Connect, x_lease: Lease = None) -> dict[str, Any]:
    """Open the link and look at the board; nothing is armed. An emulated board is started."""
    return await _operated(request, x_lease, "connect", link=wanted.link).connect(wanted.link, wanted.bench)


@router.post("/api/board/disconnect")
async def disconnect(request: Request, x_lease: Lease = None) -> dict[str, Any]:
    """Let the link go; an emulated board ends."""
    return await _stopped(request, x_lease, "disconnect").disconnect()


@router.post("/api/board/drives")
async def drives(request: Request, wanted: Drives) -> dict[str, Any]:
    """What a start with this body would drive the board with, and a digest of it for `agreed`; starts nothing."""
    return await board_of(request).drives(wanted.start)


@router.post("/api/board/start")
async def start(request: Request, wanted: Start, x_lease: Lease = None) -> dict[str, Any]:
    """Arm the board and close the loop; answers when it is armed, with the run's folder."""
    said = wanted.model_dump(exclude={"bench_toml"}, exclude_none=True)
    held = _operated(request, x_lease, "start", **said)
    return await held.start(wanted.start, consent=wanted.consent, agreed=wanted.agreed)


@router.post("/api/board/stop")
async def stop(request: Request, x_lease: Lease = None) -> dict[str, Any]:
    """End the run: SAFE, the record closed, its figures made."""
    return await _stopped(request, x_lease, "stop").stop()


@router.post("/api/board/safe")
async def safe(request: Request) -> dict[str, Any]:
    """Bring the board to SAFE: for everybody who may look, without a lease. Answers when the board has said so."""
    said = await board_of(request).safe()
    service_of(request).audit.note_anyway(holder_of(request), "safe", **said)
    return said


@router.patch("/api/board/settings")
async def settings(request: Request, wanted: Settings, x_lease: Lease = None) -> dict[str, Any]:
    """Change settings: at once where the loop can, else at the next start, if that comes under the same lease and the
    board stays connected; the answer says which, and why."""
    return await _operated(request, x_lease, "settings", **wanted.given).settings(wanted)


@router.get("/api/lease")
async def lease(request: Request) -> dict[str, Any]:
    """Who has the board, and who waits for it."""
    return board_of(request).leases.told()


@router.post("/api/lease")
async def take_lease(request: Request, wanted: TakeLease) -> dict[str, Any]:
    """Take the board, or with `wait` a place in the queue (`place` > 0); renew either by PUT before it ends."""
    leases = board_of(request).leases
    said = leases.take(wanted.holder, wanted.purpose, wanted.seconds, wait=wanted.wait)
    try:
        service_of(request).audit.note(holder_of(request), "lease", **wanted.model_dump(), place=said["place"])
    except Problem:
        leases.give_back(said["lease"])  # nobody has heard its key
        raise
    return said


@router.put("/api/lease")
async def renew_lease(request: Request, x_lease: Lease = None) -> dict[str, Any]:
    """Keep the lease, or the place in the queue."""
    if x_lease is None:
        raise Problem(422, "the header X-Lease is missing", "send the lease that POST /api/lease gave")
    return board_of(request).leases.renew(x_lease)


@router.delete("/api/lease")
async def end_lease(request: Request, x_lease: Lease = None) -> dict[str, Any]:
    """Give the lease back, or leave the queue; who may administer ends another's by sending none."""
    leases = board_of(request).leases
    if x_lease is not None:
        leases.give_back(x_lease)
    elif holder_of(request).role is Role.ADMINISTER:
        leases.end()
    else:
        raise Problem(403, "only an administrator ends another one's lease", "send X-Lease to give yours back")
    service_of(request).audit.note_anyway(holder_of(request), "lease ended")
    return leases.told()
