"""The board of a service, for the holder of its lease."""

import getpass
import socket
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, Self, Unpack

from hil.errors import InputError
from hil.library.keywords import takes
from hil.options import body_of
from hil.running.options import RunOptions

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.client.remote_run import RemoteRun
    from hil.client.requests import Requests

_LEASE_S = 30.0
_RENEW_S = 10.0
_LOOK_S = 0.2
_CATALOGUE_S = 20.0


class Service(Protocol):
    """What a board needs of its service."""

    requests: "Requests"

    @property
    def state(self) -> dict[str, Any]:
        """What is known of the board."""

    def load(self, run: str) -> "RemoteRun":
        """A run by its id."""


class Started:
    """A run that lasts; `id` is its name."""

    def __init__(self, service: Service, run: str) -> None:
        self._service = service
        self.id = run

    def finished(self) -> "RemoteRun":
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
        answer: dict[str, Any] = self._service.requests.json(
            method, f"/api/board/{what}", lease=self._lease, **({} if body is None else {"json": body})
        )
        return answer

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
