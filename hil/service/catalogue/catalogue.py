"""The catalogue: kept as the run folders are, marked by people, with a trash that can be taken back."""

import os
import shutil
import sqlite3
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from hil.errors import InputError
from hil.records.atomic import is_occupied
from hil.service.catalogue.entry import Entry, Marks, as_json, id_of, is_run, read_entry, read_marks, write_marks
from hil.service.catalogue.schema import connect, open_database
from hil.service.problems import Unknown

FILE = "catalogue.sqlite"
TRASH = ".trash"
"""Folder beside the runs into which deleted ones are moved."""

_TOGETHER = 100  # folders to a transaction: what is lost by kill -9 is read again
_RECENT = 50
_REMEMBERED = 1000
_READ = ("seen", "kind", "time", "name", "device", "serial", "bench", "verdict", "seconds", "state")
_UNSETTLED_NS = 2_000_000_000
"""A folder that was changed so short before it was read may change again within one tick of its clock."""


class Conflict(InputError):
    """What is asked cannot be done to this run now."""

    status = 409


class Looked(NamedTuple):
    """What a look at the folders came to: how many are new or changed, gone, and their ids."""

    changed: int
    gone: int
    ids: tuple[str, ...]


class Catalogue:
    """The runs and traces in `folder`, as its database in `private` knows them.

    Any thread may read; who writes waits for the others. `changed` is told the id of each run that was marked, deleted,
    restored or looked at by its name. `totals` are counts of lists, good for this `version` of it.
    """

    def __init__(self, folder: Path, private: Path, changed: Callable[[str], None] = lambda _: None) -> None:
        self.folder = folder
        self.changed = changed
        self._path = private / FILE
        self._writing = threading.RLock()
        self._of_thread = threading.local()
        self._all: list[sqlite3.Connection] = []
        self._quiet: dict[int, int] = {}  # when the folders were last changed that were looked through since
        self._empty: dict[int, set[str]] = {}  # folders that were no runs yet: records come seconds after them
        self.version = 0
        self.totals: dict[Any, int] = {}
        self._trash.mkdir(parents=True, exist_ok=True)
        self._keep(open_database(self._path))

    @property
    def _trash(self) -> Path:
        return self.folder / TRASH

    @property
    def database(self) -> sqlite3.Connection:
        found: sqlite3.Connection | None = getattr(self._of_thread, "connection", None)
        return found if found is not None else self._keep(connect(self._path))

    def close(self) -> None:
        with self._writing:
            for connection in self._all:
                connection.close()
            self._all.clear()

    # what there is

    def look(self, *, whole: bool = True, stop: Callable[[], bool] = lambda: False) -> Looked:
        """Take over what is new, changed or gone in the folders; `stop` is asked now and then whether to leave off.

        Without `whole`, of the folders that are known only the newest and those somebody works on are looked at.
        """
        ids: list[str] = []
        gone = 0
        for trashed, place in ((0, self.folder), (1, self._trash)):
            changed_ns = place.stat().st_mtime_ns
            recent = {} if whole else self._recent(trashed)
            if not whole and self._quiet.get(trashed) == changed_ns:
                known, there = recent, set(recent)  # none came, none went
                to_read = [name for name, seen in recent.items() if _seen(place / name) != seen]
                to_read += [name for name in self._empty.get(trashed, ()) if is_run(place / name)]
            else:
                known, there, to_read = self._known(trashed), set(), []
                for entry in _folders(place):
                    there.add(entry.name)
                    before = known.get(entry.name)
                    if before is None or ((whole or entry.name in recent) and _seen(entry) != before):
                        to_read.append(entry.name)
            to_read = sorted(set(to_read), reverse=True)  # names begin with the time: the newest first
            for start in range(0, len(to_read), _TOGETHER):
                if stop():
                    return Looked(len(ids), gone, tuple(ids))
                ids += self._read(trashed, to_read[start : start + _TOGETHER])
            gone += self._forget(trashed, [name for name in known if name not in there])
            if known is not recent:
                self._empty[trashed] = there - self._known(trashed).keys()
                if time.time_ns() - changed_ns > _UNSETTLED_NS:
                    self._quiet[trashed] = changed_ns
        return Looked(len(ids), gone, tuple(ids))

    def rebuild(self) -> Looked:
        with self._transaction() as database:
            database.execute("DELETE FROM runs")
            database.execute("DELETE FROM figure_names")
        return self.look()

    def look_at(self, name: str) -> str | None:
        """Take over one run folder by its name; its id, or None where it is no run."""
        found = self._read(0, [name])
        for one in found:
            self.changed(one)
        return found[0] if found else None

    def path_of(self, run: str) -> Path:
        """Folder of a run, by its id. Raises Unknown where there is no such run."""
        return self.folder / self._folder_of(run, 0)

    def remember(self, asked: Any, total: int, version: int) -> None:
        """Keep a count that was made at that version, until something changes."""
        if version == self.version and len(self.totals) < _REMEMBERED:
            self.totals[asked] = total

    # what people do with it

    def mark(self, run: str, *, tags: Iterable[str] | None = None, note: str | None = None) -> None:
        """Give a run tags or a note instead of those it has; what is None stays. An empty note takes a note away.

        Raises Unknown for an unknown run, InputError where its marks cannot be read, ValueError for what no tag is.
        """
        with self._writing:
            folder = self.path_of(run)
            marks = read_marks(folder).model_dump()
            if tags is not None:
                marks["tags"] = tuple(dict.fromkeys(tags))
            if note is not None:
                marks["note"] = note
            write_marks(folder, Marks.model_validate(marks))
            self.look_at(folder.name)

    def delete(self, run: str) -> None:
        """Move a run into the trash. Raises Unknown for an unknown one, Conflict while somebody works on it."""
        with self._writing:
            folder = self.path_of(run)
            if is_occupied(folder):
                raise Conflict(f"{run}: is being recorded or worked on; end it first, or wait")
            target = self._trash / folder.name
            if target.exists():
                shutil.rmtree(target)  # deleted before, under the same name
                self._forget(1, [folder.name])
            folder.rename(target)
            self._forget(0, [folder.name])
            self._read(1, [folder.name])
        self.changed(run)

    def restore(self, run: str) -> None:
        """Take a run back from the trash. Raises Unknown where it is not there, Conflict where its place is taken."""
        with self._writing:
            name = self._folder_of(run, 1)
            if (self.folder / name).exists():
                raise Conflict(f"{run}: there is another run of that name; delete it first")
            (self._trash / name).rename(self.folder / name)
            self._forget(1, [name])
            self.look_at(name)

    def empty_trash(self) -> int:
        """Remove what is in the trash for good; how many."""
        with self._writing:
            names = [entry.name for entry in _folders(self._trash)]
            for name in names:
                shutil.rmtree(self._trash / name)
            self._forget(1, names)
            return len(names)

    # how it is kept

    def _keep(self, connection: sqlite3.Connection) -> sqlite3.Connection:
        self._of_thread.connection = connection
        self._all.append(connection)
        return connection

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._writing:
            database = self.database
            database.execute("BEGIN IMMEDIATE")
            try:
                yield database
            except BaseException:
                database.execute("ROLLBACK")
                raise
            database.execute("COMMIT")
            self.version += 1
            self.totals = {}

    def _folder_of(self, run: str, trashed: int) -> str:
        asked = "SELECT folder FROM runs WHERE id = ? AND trashed = ?"
        if (row := self.database.execute(asked, (run, trashed)).fetchone()) is None:
            raise Unknown("run", run)
        return str(row["folder"])

    def _known(self, trashed: int) -> dict[str, str]:
        rows = self.database.execute("SELECT folder, seen FROM runs WHERE trashed = ?", (trashed,))
        return {row["folder"]: row["seen"] for row in rows}

    def _recent(self, trashed: int) -> dict[str, str]:
        """Those that a quick look does not pass over: the newest, and those somebody works on."""
        rows = self.database.execute(
            "SELECT folder, seen FROM runs WHERE state = 'running' AND trashed = :trashed UNION "
            "SELECT * FROM (SELECT folder, seen FROM runs WHERE trashed = :trashed ORDER BY time DESC LIMIT :most)",
            {"trashed": trashed, "most": _RECENT},
        )
        return {row["folder"]: row["seen"] for row in rows}

    def _read(self, trashed: int, names: list[str]) -> list[str]:
        """Read folders and keep what they say; the ids of those that are runs."""
        place = self._trash if trashed else self.folder
        read: list[tuple[str, str, Entry]] = []
        for name in names:
            folder = place / name
            try:
                before = folder.stat()
            except OSError:
                continue
            if is_run(folder):
                read.append((name, _settled(before), read_entry(folder)))
        with self._transaction() as database:
            for name, seen, entry in read:
                # of a run that somebody works on the files grow, which its folder does not show
                _write(database, trashed, name, "" if entry.state == "running" else seen, entry)
        return [id_of(name) for name, _, _ in read]

    def _forget(self, trashed: int, names: list[str]) -> int:
        if names:
            with self._transaction() as database:
                database.executemany(
                    "DELETE FROM runs WHERE trashed = ? AND folder = ?", [(trashed, name) for name in names]
                )
        return len(names)


def _folders(place: Path) -> Iterator["os.DirEntry[str]"]:
    with os.scandir(place) as entries:
        for entry in entries:
            if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False) and _is_text(entry.name):
                yield entry


def _is_text(name: str) -> bool:
    """Whether a folder's name can be told at all."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _seen(entry: "os.DirEntry[str] | Path") -> str | None:
    """What a folder is like now, None where it has gone."""
    try:
        return _told(entry.stat(follow_symlinks=False))
    except OSError:
        return None


def _told(found: os.stat_result) -> str:
    """What a folder was like: files in it are replaced whole, which changes its time."""
    return f"{found.st_mtime_ns}-{found.st_ino}"


def _settled(found: os.stat_result) -> str:
    """The same, '' of one that may change again without showing it."""
    return "" if time.time_ns() - found.st_mtime_ns < _UNSETTLED_NS else _told(found)


def _write(database: sqlite3.Connection, trashed: int, name: str, seen: str, entry: Entry) -> None:
    run = id_of(name)
    values = (
        run, trashed, name, seen, entry.kind, entry.time, entry.name, entry.device, entry.serial, entry.bench,
        entry.verdict, entry.seconds, entry.state,
    )  # fmt: skip
    (key,) = database.execute(
        f"INSERT INTO runs (id, trashed, folder, {', '.join(_READ)}) VALUES ({', '.join('?' * len(values))}) "
        f"ON CONFLICT (trashed, folder) DO UPDATE SET {', '.join(f'{name} = excluded.{name}' for name in _READ)} "
        "RETURNING key",
        values,
    ).fetchone()
    for table in ("figures", "tags"):
        database.execute(f"DELETE FROM {table} WHERE key = ?", (key,))
    database.execute("INSERT OR REPLACE INTO details VALUES (?, ?)", (key, as_json(entry.details)))
    database.execute("INSERT OR REPLACE INTO words VALUES (?, ?)", (key, _words(name, entry)))
    database.executemany("INSERT OR IGNORE INTO tags VALUES (?, ?)", [(key, tag) for tag in entry.tags])
    database.executemany(
        "INSERT INTO figures VALUES (?, ?, ?, ?)",
        [(key, _figure(database, one.name, one.unit, one.better), one.value, one.u) for one in entry.figures],
    )


def _figure(database: sqlite3.Connection, name: str, unit: str, better: str | None) -> int:
    wanted = (name, unit)
    row = database.execute("SELECT figure FROM figure_names WHERE name = ? AND unit = ?", wanted).fetchone()
    if row is None:
        row = database.execute(
            "INSERT INTO figure_names (name, unit, better) VALUES (?, ?, ?) RETURNING figure", (*wanted, better)
        ).fetchone()
    return int(row[0])


def _words(folder: str, entry: Entry) -> str:
    """What a search looks through."""
    told: list[Any] = [
        folder, entry.device, entry.serial, entry.bench, entry.verdict, entry.details.get("note"), *entry.tags,
        *entry.details.get("effects", ()),
    ]  # fmt: skip
    return "\n".join(str(one) for one in told if one).casefold()
