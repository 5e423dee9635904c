"""The board of a service: its state as everybody is told it, who may operate it, and what he can have done."""

import asyncio
import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from hil.bench import Bench
from hil.errors import InputError
from hil.running.options import RunOptions
from hil.running.process.live_settings import Settings, at_once, with_settings
from hil.running.request import RunRequest, request_of, require_consent
from hil.running.safety.drives import Fact, digest, drives, in_one_line
from hil.service.bench_files import found
from hil.service.board.lease import Leases
from hil.service.board.line import BoardLine
from hil.service.board.links import allowed
from hil.service.board.messages import NOBODY, Message
from hil.service.problems import Problem
from hil.service.service import Service

_SAFE_S = 2.0  # for the board to say so; then the answer says that it has not
_START_S = 180.0  # a law of one's own is compiled at the start, on a machine that may be busy
_END_S = 90.0  # for record, figures and report of a run that ends with the service
_CUT = "if it still drives, cut its supply"
Track = Callable[[str, dict[str, Any], int], None]


@dataclass(frozen=True)
class Start:
    """What is to be run: a bench file by name or as text, settings in the place of its own, what else is asked."""

    bench: str | None
    bench_toml: str | None
    settings: dict[str, float]
    options: RunOptions


class BoardPart:
    """What routes, telemetry and metrics know the board by.

    Attributes:
        leases: who may operate it.
        on_track: called with the name of a ring of the run that begins, its layout, and a descriptor to be kept.
        on_run: called with the name of a run that has ended, None where nothing was recorded.
        health: what telemetry says of it, part of the state.
    """

    def __init__(self, service: Service) -> None:
        self._service = service
        self._told: dict[str, Any] = dict(NOBODY)
        self._next: dict[str, float] = {}  # settings that wait for the next start, of the lease `_next_of`
        self._next_of: str | None = None
        self._bench: Bench | None = None  # of the run under way
        self._bench_name: str | None = None
        self._link: str | None = None  # as the client called it
        self._safe: asyncio.Event = asyncio.Event()
        self.line = BoardLine(service.private, self._heard)
        self.leases = Leases(self._changed)
        self.on_track: Track = _nobody_looks
        self.on_state: list[Callable[[], None]] = []
        self.on_run: list[Callable[[str | None], None]] = []
        self.health: dict[str, Any] = {}

    @property
    def state(self) -> dict[str, Any]:
        return {
            **self._told,
            "bench": self._bench_name,
            **self.leases.told(),
            "next_settings": self._waiting(),
            "health": self.health,
        }

    async def connect(self, link: str, bench: str | None) -> dict[str, Any]:
        """Look at the board at `link`; nothing is armed."""
        place = await asyncio.to_thread(allowed, self._service, link)
        if bench is not None:
            await asyncio.to_thread(found, self._service.folder, "bench", bench)
        await self.line.start()
        self._next = {}
        await self.line.ask("connect", _START_S, link=place.url, bench=bench)
        self._bench_name, self._link = bench, link
        self._changed()
        return self.state

    async def disconnect(self) -> dict[str, Any]:
        self._next = {}
        if self.line.attached:
            await self.line.ask("disconnect")
            await self.line.end(_SAFE_S)
        return self.state

    async def drives(self, start: Start) -> dict[str, Any]:
        """What that start would drive the board with, whole, and a digest of it that a start can be held to."""
        _, facts = await self._asked(start)
        return {"drives": [fact._asdict() for fact in facts], "digest": digest(facts)}

    async def start(self, start: Start, *, consent: bool, agreed: str | None) -> dict[str, Any]:
        """Begin a run; {"run": folder}. Raises Problem or InputError where it is refused."""
        request, facts = await self._asked(start)
        try:
            require_consent(request, given=consent)
        except InputError as refusal:
            raise Problem(409, str(refusal), 'look at what would move, then send "consent": true') from None
        if agreed not in (None, digest(facts)):
            told = in_one_line(facts)
            raise Problem(409, f"what would drive has changed since it was shown: now {told}", "look at it again")
        self._bench, self._bench_name = request.bench, start.bench or self._bench_name or request.bench.loop.bench_name
        self._next = {}  # they are in this run's bench, and in no other one's
        self._safe.clear()
        said = await self.line.ask(
            "start",
            _START_S,
            request=request.as_json(),
            out=os.path.realpath(self._service.folder),
            bench=self._bench_name,
        )
        return {"run": said["run"]}

    async def _asked(self, start: Start) -> tuple[RunRequest, tuple[Fact, ...]]:
        """The run with every setting in it, and what it would drive."""
        if not self._told["connected"]:
            raise Problem(409, "no board is connected", "POST /api/board/connect")
        name = start.bench or self._bench_name
        request = await asyncio.to_thread(self._declared, name, start)
        changed = self._waiting() | start.settings
        try:
            bench = with_settings(request.bench, changed)
            await asyncio.to_thread(self._require_suitable, bench)
        except InputError as refusal:
            told = ", ".join(f"{name} = {value:g}" for name, value in changed.items())
            raise Problem(409, f"with {told}: {refusal}" if changed else str(refusal)) from None
        facts = drives(bench, request.link, request.bench)
        return replace(request, bench=bench), facts

    def _require_suitable(self, bench: Bench) -> None:
        """Refuse a bench that the board that is connected cannot run, as far as it has said what it is."""
        if (said := self._told["identity"]) is not None:
            from hil.running.safety.preflight import require_suitable
            from hil.wire.messages import Identity

            identity = Identity(**{name: said[name] for name in Identity._fields})
            require_suitable(bench, identity, self._link or self._told["link"])

    def _declared(self, name: str | None, start: Start) -> RunRequest:
        declared: Any = None
        if start.bench_toml is not None:
            declared = _parsed(start.bench_toml)
        elif name is not None:
            declared = found(self._service.folder, "bench", name)
        else:
            raise Problem(422, "no bench file is named", 'give "bench", or "bench_toml" with what is in one')
        options: Any = {**start.options, **self._service.files}
        return request_of(declared, options, link=self._told["link"])

    def _waiting(self) -> dict[str, float]:
        """Settings that wait for the next start: of the lease under which they were asked for, and of no other."""
        return dict(self._next) if self._next and self._next_of == self.leases.key else {}

    async def stop(self) -> dict[str, Any]:
        """End the run: SAFE, the record closed."""
        return await self.safe()

    async def safe(self) -> dict[str, Any]:
        """Bring the board to SAFE, and say within two seconds whether it has said that it is there."""
        if not self.line.attached:
            return {"told": False, "confirmed": None, "words": "no board is connected"}
        begin = time.perf_counter()
        self._safe.clear()
        self.line.interrupt()
        try:
            said = await self.line.ask("safe", _SAFE_S)
        except Problem as problem:  # whatever it is: the answer to SAFE says what is known of the board
            return {"told": False, "confirmed": False, "ms": _ms(begin), "words": f"{problem.error}; {_CUT}"}
        if not said.get("loop"):
            confirmed = not said.get("unanswered") if said["told"] else None
            words = f"{said['words']}; {_CUT}" if confirmed is False else said.get("words", "")
            return {
                "told": said["told"],
                "confirmed": confirmed,
                "tick": said.get("tick"),
                "ms": _ms(begin),
                "words": words,
            }
        if self._told["safe_tick"] is None:  # else it has ended meanwhile, and the board has said so
            with suppress(TimeoutError):
                await asyncio.wait_for(self._safe.wait(), _SAFE_S)
        confirmed = self._told["safe_tick"] is not None
        words = "" if confirmed else f"the board has not said SAFE yet; {_CUT}"
        if self._told["run"] is None and not confirmed:
            confirmed, words = None, self._told["words"] or "the run ended before the board was armed"
        return {"told": True, "confirmed": confirmed, "tick": self._told["safe_tick"], "ms": _ms(begin), "words": words}

    async def settings(self, settings: Settings) -> dict[str, Any]:
        """Change settings: what can be at once, the rest at the next start under the same lease; says which."""
        if not self._told["connected"]:
            raise Problem(409, "no board is connected", "POST /api/board/connect; settings are of one board's run")
        given = settings.given
        if self._bench is not None and self._told["run"] is not None:
            bench = self._bench
            with_settings(bench, given)  # refuses what no bench file could say
            later = {name: why for name, why in at_once(bench, given).items() if why}
            now = {name: value for name, value in given.items() if name not in later}
            if now:
                await self.line.ask("settings", settings=now)
        else:
            if self._bench_name is not None:
                await self._asked(Start(None, None, given, {}))  # refuses what a start would
            later, now = dict.fromkeys(given, "no loop runs"), {}
        self._next = self._waiting() | {name: given[name] for name in later}
        self._next_of = self.leases.key
        self._changed()
        return {"at_once": now, "at_next_start": later}

    async def close(self) -> None:
        """The service ends: SAFE, the record closed, the process that holds the board ended."""
        await self.line.end(_END_S)

    def _heard(self, message: Message, descriptor: int | None) -> None:
        if "track" in message and descriptor is not None:
            self.on_track(message["track"], message["layout"], descriptor)
        elif "board" in message:
            last = {name: self._told[name] for name in ("last_run", "last_verdict")}
            self._told = message["board"]
            self._bench_name = self._told["bench"] or self._bench_name  # as it is held, after a restart
            if self._told["last_run"] is None:  # of a board that was let go: what was run stays to be seen
                self._told |= last
            self._changed()
        elif "safe" in message:
            self._safe.set()
        elif "run" in message:
            self._safe.set()
            for told in self.on_run:
                told(message["run"])
            self._service.audit.note_anyway("board", "run ended", run=message["run"], words=message["words"])

    def _changed(self) -> None:
        for told in self.on_state:
            told()


def _parsed(text: str) -> Bench:
    from hil.plugins.finding import require_no_files
    from hil.toml.reading import parse_table, table_of

    try:
        table = table_of(text.encode("utf-8", "surrogatepass"), "bench_toml")
    except InputError as error:
        raise Problem(422, str(error)) from None
    bench = parse_table(table, Bench, "bench_toml")
    require_no_files(bench, "bench_toml")
    return bench


def _ms(begin: float) -> float:
    return round(1e3 * (time.perf_counter() - begin), 3)


def _nobody_looks(_name: str, _layout: dict[str, Any], descriptor: int) -> None:
    os.close(descriptor)
