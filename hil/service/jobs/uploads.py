"""Records that were uploaded: received piece by piece up to a bound, kept until they are imported or a day has passed.

Nothing of a name that a client gives becomes part of a path but one of a few endings.
"""

import json
import re
import secrets
import shutil
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from hil.errors import InputError, printable
from hil.importing.importer import endings
from hil.service.security.bodies import RECORD_BYTES

MOST_MAP_BYTES = 1 << 20
MOST_AT_ONCE = 20
ENDINGS = (".csv", ".csv.gz", ".mat", ".parquet")
"""Beside those that packages read."""
_KEPT_S = 86_400.0
_CALLED = "called.json"
_LONGEST_NAME = 100
_ID = re.compile(r"[0-9a-f]{24}")


class TooLarge(InputError):
    """More came than is taken."""

    status = 413


class Upload(NamedTuple):
    """What was received: the record, and the map of its columns where one came along; called: what the client calls
    each file, by its path here."""

    id: str
    record: Path
    map: Path | None
    bytes: int
    called: Mapping[str, str]


class Uploads:
    """The uploads of a service, in `folder`."""

    def __init__(self, folder: Path, most_bytes: int = RECORD_BYTES) -> None:
        self._folder = folder
        self.most_bytes = most_bytes
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        self.tidy()

    def begin(self, name: str) -> "Receiving":
        """Begin to receive a record that the client calls `name`. Raises InputError where it is none that is taken."""
        self.tidy()
        taken = (*ENDINGS, *endings())
        ending = next((one for one in sorted(taken, key=len, reverse=True) if name.lower().endswith(one)), None)
        if ending is None:
            raise InputError(f"{name[-60:]}: no record that is taken; give one of {', '.join(taken)}")
        if sum(1 for _ in self._folder.iterdir()) >= MOST_AT_ONCE:
            raise TooLarge(f"{MOST_AT_ONCE} uploads wait already; import them first")
        place = self._folder / secrets.token_hex(12)
        place.mkdir(mode=0o700)
        return Receiving(place, place / f"record{ending}", name, self.most_bytes)

    def of(self, upload: str) -> Upload:
        """The upload of that id. Raises InputError where there is none."""
        place = self._folder / upload
        records = list(place.glob("record.*")) if _ID.fullmatch(upload) and place.is_dir() else []
        if not records:
            raise InputError(f"{upload[:60]}: no such upload; it was imported, or is older than a day")
        return _upload(place, records[0])

    def remove(self, upload: str) -> None:
        """Remove the upload of that id, if it is there."""
        if _ID.fullmatch(upload):
            shutil.rmtree(self._folder / upload, ignore_errors=True)

    def tidy(self) -> None:
        for place in self._folder.iterdir():
            with suppress(OSError):
                if time.time() - place.stat().st_mtime > _KEPT_S:
                    shutil.rmtree(place, ignore_errors=True)


class Receiving:
    """An upload on its way; `give_up` removes what came of it."""

    def __init__(self, place: Path, record: Path, name: str, most_bytes: int) -> None:
        self._place, self._record = place, record
        self._called = {str(record): _shown(name, record.name)}
        self._most = {record: most_bytes, place / "map.toml": MOST_MAP_BYTES}

    async def record(self, pieces: AsyncIterator[bytes]) -> None:
        """Receive the record. Raises TooLarge."""
        await self._receive(self._record, pieces)

    async def map(self, pieces: AsyncIterator[bytes], name: str = "") -> None:
        """Receive the map, which the client calls `name`. Raises TooLarge."""
        self._called[str(self._place / "map.toml")] = _shown(name, "map.toml")
        await self._receive(self._place / "map.toml", pieces)

    def done(self) -> Upload:
        """All has come. Raises InputError where no record has."""
        if not self._record.exists() or not self._record.stat().st_size:
            raise InputError("no record came; send a file that is not empty")
        (self._place / _CALLED).write_text(json.dumps(self._called), encoding="utf-8")
        return _upload(self._place, self._record)

    def give_up(self) -> None:
        shutil.rmtree(self._place, ignore_errors=True)

    async def _receive(self, path: Path, pieces: AsyncIterator[bytes]) -> None:
        most, size = self._most[path], 0
        with path.open("wb") as file:
            async for piece in pieces:
                size += len(piece)
                if size > most:
                    raise TooLarge(f"larger than the {most >> 20} MB that are taken; import it with hil import")
                file.write(piece)


def _upload(place: Path, record: Path) -> Upload:
    given, names = place / "map.toml", place / _CALLED
    called = json.loads(names.read_text(encoding="utf-8")) if names.exists() else {}
    return Upload(place.name, record, given if given.exists() else None, record.stat().st_size, called)


def _shown(name: str, otherwise: str) -> str:
    """A client's name of a file as errors show it: no folder, and nothing that a terminal would obey."""
    return printable(re.split(r"[/\\]", name)[-1])[-_LONGEST_NAME:] or otherwise
