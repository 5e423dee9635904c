"""The database of the catalogue: its tables in numbered migrations, and how it is opened.

Nothing is in it that the run folders do not say, so a file that cannot be used is thrown away and made anew.
"""

import sqlite3
from contextlib import closing, suppress
from pathlib import Path

MIGRATIONS: tuple[str, ...] = (
    """
    CREATE TABLE runs (
        key INTEGER PRIMARY KEY,
        id TEXT NOT NULL,
        trashed INTEGER NOT NULL,          -- 0: where runs are, 1: in the trash
        folder TEXT NOT NULL,              -- name of its folder
        seen TEXT NOT NULL,                -- what the folder was like then, '' where it has to be read again
        kind TEXT NOT NULL,
        time REAL NOT NULL,                -- s since 1970
        name TEXT NOT NULL,
        device TEXT,
        serial TEXT,
        bench TEXT,
        verdict TEXT,
        seconds REAL,
        state TEXT NOT NULL,
        UNIQUE (trashed, folder)
    );
    CREATE UNIQUE INDEX runs_by_id ON runs (id, trashed);
    CREATE INDEX runs_by_time ON runs (trashed, time);
    CREATE INDEX runs_by_serial ON runs (serial, time);
    CREATE INDEX runs_by_verdict ON runs (trashed, verdict, time);
    CREATE INDEX runs_by_state ON runs (state);
    CREATE TABLE details (key INTEGER PRIMARY KEY REFERENCES runs ON DELETE CASCADE, body TEXT NOT NULL);
    CREATE TABLE words (key INTEGER PRIMARY KEY REFERENCES runs ON DELETE CASCADE, text TEXT NOT NULL);
    CREATE TABLE tags (
        key INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
        tag TEXT NOT NULL,
        PRIMARY KEY (tag, key)
    ) WITHOUT ROWID;
    CREATE INDEX tags_by_run ON tags (key);
    CREATE TABLE figure_names (
        figure INTEGER PRIMARY KEY,
        name TEXT NOT NULL,
        unit TEXT NOT NULL,
        better TEXT,
        UNIQUE (name, unit)
    );
    CREATE TABLE figures (
        key INTEGER NOT NULL REFERENCES runs ON DELETE CASCADE,
        figure INTEGER NOT NULL REFERENCES figure_names,
        value REAL NOT NULL,
        u REAL,                            -- half width of the 95 % interval
        PRIMARY KEY (key, figure)
    ) WITHOUT ROWID;
    CREATE INDEX figures_by_value ON figures (figure, value, key);
    """,
    """
    CREATE INDEX details_record ON details (json_extract(body, '$.record'));
    """,
    """
    DROP INDEX runs_by_serial;
    CREATE INDEX runs_by_serial ON runs (serial, trashed, kind, time, device);
    """,
)
"""Applied in this order, each once; the number of the last one is the file's `user_version`."""

_BUSY_S = 30.0
_PRAGMAS = (
    "journal_mode = WAL",
    "synchronous = NORMAL",
    "foreign_keys = ON",
    "cache_size = -65536",  # kB
    "mmap_size = 1073741824",
)


def open_database(path: Path) -> sqlite3.Connection:
    """The database at `path`, up to date; one that is damaged, or by a newer program, is made anew."""
    try:
        return _opened(path)
    except sqlite3.DatabaseError:
        for suffix in ("", "-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
        return _opened(path)


def connect(path: Path) -> sqlite3.Connection:
    """A further connection to a database that `open_database` has opened, for one thread; any may close it."""
    connection = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
    connection.row_factory = sqlite3.Row
    for pragma in _PRAGMAS:
        connection.execute(f"PRAGMA {pragma}").close()
    return connection


def _opened(path: Path) -> sqlite3.Connection:
    connection = connect(path)
    try:
        _migrate(connection)
        connection.execute("SELECT count(*) FROM runs").fetchone()
        return connection
    except BaseException:
        with suppress(sqlite3.Error):
            connection.close()
        raise


def _migrate(connection: sqlite3.Connection) -> None:
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version > len(MIGRATIONS):
        raise sqlite3.DatabaseError("by a newer program")
    for number, statements in enumerate(MIGRATIONS[version:], version + 1):
        with closing(connection.cursor()) as cursor:
            cursor.executescript(f"BEGIN IMMEDIATE; {statements} PRAGMA user_version = {number}; COMMIT;")
