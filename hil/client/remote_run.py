"""A run of a service, as the library has runs: what is asked for is fetched."""

import re
from pathlib import Path

from hil.client.requests import Requests
from hil.errors import InputError
from hil.library.loading import Run
from hil.records.runfolder import RunFolder


class _Fetched(RunFolder):
    """The folder of a run, of which each file is fetched when it is asked for."""

    def __init__(self, requests: Requests, path: Path) -> None:
        super().__init__(path)
        self._requests = requests

    def file(self, name: str) -> Path:
        """Raises InputError where it has no such file."""
        place = super().file(name)
        if not place.exists():
            answer = self._requests.ask("GET", f"/api/runs/{self.path.name}/files/{name}")
            self.path.mkdir(parents=True, exist_ok=True)
            place.write_bytes(answer.content)
        return place


class RemoteRun(Run):
    """As `hil.Run`; `id` is its name there, `path` the folder into which its files are fetched."""

    def __init__(self, requests: Requests, run: str, place: Path) -> None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", run):
            raise InputError(f"{run}: no run is called so")
        super().__init__(_Fetched(requests, place / run))
        self.id = run
        self._url = requests.url

    def fetch(self, name: str) -> Path:
        """A file of it, here. Raises InputError where it has no such file."""
        return self._folder.file(name)

    def __repr__(self) -> str:
        return f"<RemoteRun {self.id} of {self._url}>"
