"""A run of a service, as the library has runs: what is asked for is fetched."""

import re
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from hil.client.requests import Requests
from hil.errors import InputError
from hil.library.finished_run import Run
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.library.series import Series
    from hil.records.result import Result


class RemoteRun(Run):
    """As `hil.Run`; `id` is its name there, `path` the folder into which its files are fetched."""

    def __init__(self, requests: Requests, run: str, place: Path) -> None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", run):
            raise InputError(f"{run}: no run is called so")
        super().__init__(RunFolder(place / run))
        self.id = run
        self._requests = requests

    def fetch(self, name: str) -> Path:
        """A file of it, here. Raises InputError where it has no such file."""
        place = self.path / name
        if not place.exists():
            answer = self._requests.ask("GET", f"/api/runs/{self.id}/files/{name}")
            self.path.mkdir(parents=True, exist_ok=True)
            place.write_bytes(answer.content)
        return place

    @cached_property
    def bench(self) -> "Bench":
        """As of a `Run`."""
        self.fetch("bench.toml")
        return super().bench

    @property
    def result(self) -> "Result":
        """As of a `Run`."""
        self.fetch("result.json")
        return super().result

    @cached_property
    def capture(self) -> "Series":
        """As of a `Run`."""
        self.fetch("capture.arrow")
        return super().capture

    @cached_property
    def estimates(self) -> "Series":
        """As of a `Run`."""
        self.fetch("estimates.arrow")
        return super().estimates

    @cached_property
    def innovation(self) -> "Series":
        """As of a `Run`."""
        self.fetch("innovation.arrow")
        return super().innovation

    def report(self) -> Path:
        """As of a `Run`."""
        return self.fetch("report.html")

    def __repr__(self) -> str:
        return f"<RemoteRun {self.id} of {self._requests.url}>"
