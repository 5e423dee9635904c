"""A bench service as an object, and its board for the holder of the lease."""

import getpass
import socket
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self, Unpack

from hil.characterising.options import CharacteriseOptions
from hil.client.remote_run import RemoteRun
from hil.client.requests import Requests, Stream, found
from hil.errors import InputError
from hil.identifying.options import IdentifyOptions
from hil.importing.options import ImportOptions
from hil.library.keywords import takes
from hil.options import body_of
from hil.records.frame import Frame
from hil.replaying.options import ReplayOptions
from hil.running.options import RunOptions
from hil.sensors.options import RecordOptions
from hil.sweeping.options import SweepOptions
from hil.tracing.options import TraceOptions

if TYPE_CHECKING:
    from hil.bench import Bench

AnyRun = RemoteRun | str
_LOOK_S = 0.2
_LEASE_S = 30.0
_RENEW_S = 10.0
_CATALOGUE_S = 20.0


def connect(
    url: str | None = None, token: str | None = None, *, folder: Path | str = "runs", verify: bool | str = True
) -> "Service":
    """The service at `url`, with a token as `hil serve` prints it; without them that of this user whose runs are in
    `folder`. `verify` is as of httpx: a file with the certificate of a service that signed its own.

    Raises InputError where there is none, or it does not take the token.
    """
    if url is None:
        url, token = found(Path(folder))
    elif token is None:
        url, _, token = url.partition("#token=")
    service = Service(Requests(url, token or "", verify))
    try:
        service.requests.json("GET", "/api/who")
    except InputError:
        service.close()
        raise
    return service


class Service:
    """See `connect`. What is refused raises InputError, one line."""

    def __init__(self, requests: Requests) -> None:
        self.requests = requests
        self._place = tempfile.TemporaryDirectory(prefix="gyrohil-")

    # -- runs ----------------------------------------------------------------------------------------------------------

    def runs(self, **chosen: Any) -> Iterator[dict[str, Any]]:
        """Rows of runs and traces, the newest first; chosen by `verdict`, `device`, `bench`, `tag`, `kind`, `q` …"""
        after: str | None = None
        while True:
            page = self.requests.json("GET", "/api/runs", params={**chosen, **({"after": after} if after else {})})
            yield from page["runs"]
            if (after := page.get("next")) is None:
                return

    def load(self, run: str) -> RemoteRun:
        """A run by its id; "last" is the newest. Its records are fetched when they are asked for."""
        if run == "last":
            newest = next(self.runs(kind="run"), None)
            if newest is None:
                raise InputError("last: the service has no run")
            run = newest["id"]
        return RemoteRun(self.requests, run, Path(self._place.name))

    @takes(RunOptions)
    def run(
        self,
        bench: "Bench | Path | str | None" = None,
        *,
        link: str | None = None,
        arm: bool = False,
        purpose: str = "hil.client",
        **options: Unpack[RunOptions],
    ) -> RemoteRun:
        """A run of the board, to its end: as `hil.run`, with the lease for as long. `arm` is the consent to arming."""
        with self.board(purpose) as board:
            if link is not None:
                board.connect(link, bench if isinstance(bench, str) else None)
            return board.start(bench, arm=arm, **options).finished()

    @takes(RecordOptions)
    def record(self, link: str, **options: Unpack[RecordOptions]) -> RemoteRun:
        """A recording of a sensor that cannot be driven, by the service: as `hil.record`."""
        return self.load(self.job("record", link=link, **body_of(RecordOptions, options))["result"]["run"])

    @takes(ImportOptions)
    def import_record(
        self, source: Path | str, *, name: str = "imported", **options: Unpack[ImportOptions]
    ) -> RemoteRun:
        """A file of this machine becomes a record of the service; `mapping` is one here, or the name of one there."""
        body = body_of(ImportOptions, options)
        with ExitStack() as opened:
            files = {"record": opened.enter_context(Path(source).open("rb"))}
            if (given := options.get("mapping")) is not None and Path(given).is_file():
                files["map"] = opened.enter_context(Path(given).open("rb"))
                del body["map"]
            upload = self.requests.json("POST", "/api/uploads", files=files)
        return self.load(self.job("import", upload=upload["id"], name=name, **body)["result"]["run"])

    @takes(SweepOptions)
    def sweep(self, campaign: str, **options: Unpack[SweepOptions]) -> dict[str, Any]:
        """A campaign file of the service, carried out there: what it came to."""
        found: dict[str, Any] = self.job("sweep", campaign=campaign, **body_of(SweepOptions, options))["result"]
        return found

    @takes(TraceOptions)
    def trace(
        self, run: "AnyRun | Sequence[AnyRun]", bench: str | None = None, **options: Unpack[TraceOptions]
    ) -> dict[str, Any]:
        """A trace of a run's record, or of several together, made by the service: its diagnosis."""
        asked = {} if bench is None else {"bench": bench}
        row = self.job("trace", run=_ids(run), **asked, **body_of(TraceOptions, options))
        return self.requests.json("GET", f"/api/runs/{row['result']['run']}/diagnosis")

    @takes(ReplayOptions)
    def replay(
        self,
        run: "AnyRun",
        bench: str | None = None,
        *,
        effects_of: str | None = None,
        **options: Unpack[ReplayOptions],
    ) -> RemoteRun:
        """Today's estimator on a run's record, by the service."""
        given = {"bench": bench, "effects_of": effects_of}
        asked = {name: value for name, value in given.items() if value is not None} | body_of(ReplayOptions, options)
        return self.load(self.job("replay", run=_id(run), **asked)["result"]["run"])

    @takes(CharacteriseOptions)
    def characterise(
        self, run: "AnyRun | Sequence[AnyRun]", bench: str | None = None, **options: Unpack[CharacteriseOptions]
    ) -> dict[str, Any]:
        """The figures of a data sheet from runs of one device, by the service."""
        asked = {} if bench is None else {"bench": bench}
        row = self.job("characterise", run=_ids(run), **asked, **body_of(CharacteriseOptions, options))
        sheet: dict[str, Any] = row["result"]["sheet"]
        return sheet

    @takes(IdentifyOptions)
    def identify(
        self,
        link: str | None = None,
        *,
        run: "AnyRun | Sequence[AnyRun]" = (),
        save: str | None = None,
        **options: Unpack[IdentifyOptions],
    ) -> dict[str, Any]:
        """The constants of an emulated board by an experiment of the service, or of a device by its runs: `found` is as
        identified.json, `bench` the name of the bench file, that of `save` where the board is as it says.
        """
        given = {"link": link, "run": _ids(run), "save": save}
        asked = {name: value for name, value in given.items() if value is not None} | body_of(IdentifyOptions, options)
        result: dict[str, Any] = self.job("identify", **asked)["result"]
        return result

    def diff(self, a: RemoteRun | str, b: RemoteRun | str) -> dict[str, Any]:
        """Two runs side by side."""
        return self.requests.json("GET", "/api/compare", params={"a": _id(a), "b": _id(b)})

    def job(self, kind: str, **asked: Any) -> dict[str, Any]:
        """A job, to its end: its row. Raises InputError where it failed or was cancelled."""
        row = self.requests.json("POST", "/api/jobs", json={"kind": kind, **asked})
        while row["state"] in ("queued", "running"):
            time.sleep(_LOOK_S)
            row = self.requests.json("GET", f"/api/jobs/{row['id']}")
        if row["state"] != "done":
            raise InputError(f"{kind}: {row['state']}: {row.get('error') or 'see its row'}")
        return row

    def devices(self) -> list[dict[str, Any]]:
        """The devices whose runs are there."""
        devices: list[dict[str, Any]] = self.requests.ask("GET", "/api/devices").json()
        return devices

    # -- the board -----------------------------------------------------------------------------------------------------

    @property
    def state(self) -> dict[str, Any]:
        """What is known of the board."""
        return self.requests.json("GET", "/api/board")

    def safe(self) -> dict[str, Any]:
        """Bring the board to SAFE, whatever client has it; returns whether it has confirmed."""
        return self.requests.json("POST", "/api/board/safe")

    def board(self, purpose: str = "", *, holder: str | None = None, wait: bool = False) -> "Board":
        """The board, for a `with`: its lease is kept for as long. With `wait` the queue is stood in."""
        return Board(self, purpose, holder, wait=wait)

    def stream(
        self, channels: Sequence[str], *, window_s: float = 1.0, points: int = 800, **more: Any
    ) -> Iterator[Frame]:
        """Decimated channels of the run that lasts, frame by frame, until it ends."""
        request = {"op": "subscribe", "channels": list(channels), "window_s": window_s, "points": points, **more}
        with self.live() as live:
            yield from live.frames(request)

    def states(self) -> Iterator[dict[str, Any]]:
        """The board's state as it is told, several times a second."""
        with self.live() as live:
            yield from live.states()

    def live(self) -> Stream:
        """The live connection, for a `with`."""
        return Stream(self.requests.url, self.requests.token)

    def close(self) -> None:
        """Let go of the connection and of what was fetched."""
        self.requests.close()
        self._place.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _ids(run: "AnyRun | Sequence[AnyRun]") -> str | list[str]:
    return [_id(one) for one in run] if isinstance(run, list | tuple) else _id(run)  # type: ignore[arg-type]


def _id(run: RemoteRun | str | Mapping[str, Any]) -> str:
    return run if isinstance(run, str) else run.id if isinstance(run, RemoteRun) else str(run["id"])


class Started:
    """A run that lasts; `id` is its name."""

    def __init__(self, service: Service, run: str) -> None:
        self._service = service
        self.id = run

    def finished(self) -> RemoteRun:
        """The run, once its figures and report are made."""
        while (state := self._service.state)["run"] == self.id:
            time.sleep(_LOOK_S)
        if state["last_run"] != self.id:
            raise InputError(f"{self.id}: {state['words'] or 'nothing was recorded'}")
        end = time.monotonic() + _CATALOGUE_S
        while True:
            try:
                self._service.requests.ask("GET", f"/api/runs/{self.id}")
                return self._service.load(self.id)
            except InputError:  # the catalogue has not come to it yet
                if time.monotonic() > end:
                    raise
                time.sleep(_LOOK_S)


class Board:
    """Inside its `with` the lease is renewed by a thread; it ends with it, or half a minute after this process."""

    def __init__(self, service: Service, purpose: str, holder: str | None, *, wait: bool) -> None:
        self._service = service
        self._asked = {
            "holder": holder or f"{getpass.getuser()} at {socket.gethostname()}",
            "purpose": purpose,
            "seconds": _LEASE_S,
            "wait": wait,
        }
        self._lease = ""
        self._ended = threading.Event()
        self._renewer: threading.Thread | None = None

    def __enter__(self) -> Self:
        requests = self._service.requests
        taken = requests.json("POST", "/api/lease", json=self._asked)
        self._lease = taken["lease"]
        while taken["place"]:
            time.sleep(1.0)
            taken = requests.json("PUT", "/api/lease", lease=self._lease)
        self._renewer = threading.Thread(target=self._renew, daemon=True)
        self._renewer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        assert self._renewer is not None
        self._renewer.join()
        with suppress(InputError):
            self._service.requests.ask("DELETE", "/api/lease", lease=self._lease)

    def connect(self, link: str, bench: str | None = None) -> dict[str, Any]:
        """Look at the board at `link`; nothing is armed. `bench` is one of the service's bench files."""
        return self._ask("POST", "connect", {"link": link, "bench": bench})

    def disconnect(self) -> dict[str, Any]:
        """Let it go."""
        return self._ask("POST", "disconnect", None)

    @takes(RunOptions)
    def start(
        self,
        bench: "Bench | Path | str | None" = None,
        *,
        arm: bool = False,
        settings: Mapping[str, float] = MappingProxyType({}),
        **options: Unpack[RunOptions],
    ) -> Started:
        """Begin a run; `arm` is the consent to arming. `bench`: one of the service's by its name, a file here, or a
        `Bench`; `settings`: as of `settings`, before it begins.
        """
        asked = {**_named(bench), "consent": arm, "settings": dict(settings), **body_of(RunOptions, options)}
        said = self._ask("POST", "start", asked)
        return Started(self._service, said["run"])

    def settings(self, **changed: float) -> dict[str, Any]:
        """Change target_stiffness, amplitude, virtual_rotation or dither; says what acts at once."""
        return self._ask("PATCH", "settings", changed)

    def stop(self) -> dict[str, Any]:
        """End the run: SAFE, the record closed."""
        return self._ask("POST", "stop", None)

    def _ask(self, method: str, what: str, body: dict[str, Any] | None) -> dict[str, Any]:
        given = {} if body is None else {"json": body}
        return self._service.requests.json(method, f"/api/board/{what}", lease=self._lease, **given)

    def _renew(self) -> None:
        while not self._ended.wait(_RENEW_S):
            with suppress(InputError):  # of a service that does not answer: it may again
                self._service.requests.ask("PUT", "/api/lease", lease=self._lease)


def _named(bench: "Bench | Path | str | None") -> dict[str, str]:
    """A bench as a request has it: by name, or its text."""
    if bench is None:
        return {}
    if isinstance(bench, str | Path):
        if not Path(bench).is_file():
            return {"bench": str(bench)}
        return {"bench_toml": Path(bench).read_text(encoding="utf-8")}
    from hil.bench.template import template, values_of

    return {"bench_toml": template(values_of(bench), "")}
