"""Questions to the catalogue: lists by filter, order and page; one run; devices; the trend of a figure."""

import base64
import json
import math
import re
import sqlite3
from collections.abc import Iterable, Sequence
from datetime import datetime
from difflib import get_close_matches
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from hil.errors import InputError
from hil.records.figures import HEADLINES
from hil.records.runs import Kind
from hil.service.catalogue.catalogue import Catalogue
from hil.service.problems import Problem, Unknown

MOST = 1000
"""Rows of a page, at most."""

_COLUMNS = ("time", "name", "kind", "device", "serial", "bench", "verdict", "seconds", "state")
_CONDITION = re.compile(r"([A-Za-z_][A-Za-z0-9_.]{0,80})\s*(<=|>=|<|>|=)\s*([-+0-9.eE]{1,30})")
_LONGEST = 200
_ONE_BY_ONE = "EXISTS (SELECT 1 FROM words WHERE words.key = runs.key AND"
_TOGETHER = "runs.key IN (SELECT key FROM words WHERE"
_FEW = 5000

Word = Annotated[str | None, StringConstraints(max_length=_LONGEST)]


class Filter(BaseModel):
    """Which runs, in which order."""

    model_config = ConfigDict(extra="forbid")

    kind: Kind | None = None
    verdict: Word = None
    device: Word = None
    serial: Word = None
    bench: Word = None
    tag: Word = None
    state: Literal["done", "running", "interrupted", "recorded", "unreadable"] | None = None
    q: Word = Field(default=None, description="Words that its name, device, note, tags or effects have")
    since: datetime | None = Field(default=None, description="ISO 8601")
    until: datetime | None = None
    where: Annotated[list[Annotated[str, StringConstraints(max_length=_LONGEST)]], Field(max_length=10)] = Field(
        default=[], description="Conditions on figures, such as angle_error_rms_rad<0.01"
    )
    sort: Annotated[str, StringConstraints(max_length=100)] = Field(
        default="-time", description="A column or a figure, of which only runs that have it are listed; - is downwards"
    )
    deleted: bool = Field(default=False, description="Those in the trash instead")


class Page(Filter):
    """Which runs, and which page of them."""

    limit: int = Field(default=100, ge=1, le=MOST)
    after: Annotated[str | None, StringConstraints(max_length=1000)] = Field(
        default=None, description="`next` of the page before"
    )


def listed(catalogue: Catalogue, asked: Page) -> dict[str, Any]:
    """{"runs": rows, "next": cursor or None, "total": how many there are}.

    Raises InputError for what is no question.
    """
    database = catalogue.database
    conditions, values = _conditions(database, asked)
    down, name = asked.sort.startswith("-"), asked.sort.removeprefix("-")
    source, by, figure = "runs", f"runs.{name}", None
    if name not in _COLUMNS:
        figure = _figure_of(database, name)
    total = _total(catalogue, conditions, values, figure)
    if figure is not None:
        source, by = "figures CROSS JOIN runs ON runs.key = figures.key", "figures.value"
        conditions.append("figures.figure = ?")
        values.append(figure)
    if total <= _FEW:
        conditions = [_gathered(condition) for condition in conditions]
    where = " AND ".join(conditions)
    if asked.after is not None:
        after, key = _cursor(asked.after, asked.sort)
        sign = "<" if down else ">"
        # of columns that may be empty, what is empty comes first upwards and last downwards, as SQLite orders it
        if after is None:
            conditions.append(f"({by} IS NULL AND runs.key {sign} ?)" + ("" if down else f" OR {by} IS NOT NULL"))
            values.append(key)
        else:
            conditions.append(
                f"({by} {sign} ? OR ({by} = ? AND runs.key {sign} ?)" + (f" OR {by} IS NULL)" if down else ")")
            )
            values += [after, after, key]
        where = " AND ".join(f"({condition})" for condition in conditions)
    order = f"{by} {'DESC' if down else 'ASC'}, runs.key {'DESC' if down else 'ASC'}"
    found = database.execute(
        f"SELECT runs.*, {by} AS sorted FROM {source} WHERE {where} ORDER BY {order} LIMIT ?",
        [*values, asked.limit + 1],
    ).fetchall()
    page = found[: asked.limit]
    shown = HEADLINES if figure is None else (*HEADLINES, name)
    rest = len(found) > asked.limit
    return {
        "runs": _rows(database, page, shown),
        "next": _as_cursor(asked.sort, page[-1]["sorted"], page[-1]["key"]) if rest else None,
        "total": total,
    }


def _total(catalogue: Catalogue, conditions: list[str], values: list[Any], figure: int | None) -> int:
    """How many runs meet the conditions, and have the figure where one is asked for. Pages of one list count once."""
    asked = (tuple(conditions), tuple(values), figure)
    if (known := catalogue.totals.get(asked)) is not None:
        return known
    at = catalogue.version
    if figure is not None and len(conditions) == 1:  # all of them: by the index of the figure alone
        sql = "SELECT count(*) FROM figures WHERE figure = ? AND key NOT IN (SELECT key FROM runs WHERE trashed != ?)"
        given = [figure, *values]
    else:
        where = " AND ".join(map(_gathered, conditions))
        sql, given = f"SELECT count(*) FROM runs WHERE {where}", list(values)
        if figure is not None:
            sql += " AND EXISTS (SELECT 1 FROM figures WHERE figures.key = runs.key AND figure = ?)"
            given.append(figure)
    total = int(catalogue.database.execute(sql, given).fetchone()[0])
    catalogue.remember(asked, total, at)
    return total


def _gathered(condition: str) -> str:
    """The same condition, for which all words are gone through once: quicker where few runs have them."""
    return condition.replace(_ONE_BY_ONE, _TOGETHER)


def one(catalogue: Catalogue, run: str) -> dict[str, Any]:
    """Row of a run with all its figures, and the traces made of it. Raises Unknown where there is none."""
    database, found = catalogue.database, _run(catalogue, run)
    (row,) = _rows(database, [found], ())
    row["figures"] = figures_of(database, found["key"])
    traces = database.execute(
        "SELECT * FROM runs WHERE key IN (SELECT key FROM details WHERE json_extract(body, '$.record') = ?) "
        "AND trashed = 0 ORDER BY time DESC",
        (found["folder"],),
    ).fetchall()
    row["traces"] = _rows(database, traces, HEADLINES)
    return row


def figures_of(database: sqlite3.Connection, key: int) -> dict[str, dict[str, Any]]:
    """All figures of a run by name: value, unit, half width u of the 95 % interval, and what is better."""
    rows = database.execute(
        "SELECT name, unit, better, value, u FROM figures JOIN figure_names USING (figure) WHERE key = ? "
        "ORDER BY figure",
        (key,),
    )
    return {row["name"]: {name: row[name] for name in ("value", "unit", "u", "better")} for row in rows}


def key_of(catalogue: Catalogue, run: str) -> int:
    """Raises Unknown where there is no such run."""
    return int(_run(catalogue, run)["key"])


def _run(catalogue: Catalogue, run: str) -> sqlite3.Row:
    row: sqlite3.Row | None = catalogue.database.execute(
        "SELECT * FROM runs WHERE id = ? AND trashed = 0", (run,)
    ).fetchone()
    if row is None:
        raise Unknown("run", run)
    return row


_DEVICE = (
    "SELECT serial, max(device) AS device, sum(kind = 'run') AS runs, sum(kind = 'trace') AS traces, "
    "min(time) AS first, max(time) AS last FROM runs {index} WHERE trashed = 0 AND serial {which} GROUP BY serial"
)


def devices(catalogue: Catalogue) -> list[dict[str, Any]]:
    """Devices by serial number: their names, how many runs and traces, the last time and verdict of a run."""
    asked = _DEVICE.format(index="INDEXED BY runs_by_serial", which="> ''")
    rows = catalogue.database.execute(f"{asked} ORDER BY last DESC").fetchall()
    return [_device(catalogue.database, row) for row in rows]


def device(catalogue: Catalogue, serial: str) -> dict[str, Any]:
    """One device, with the names of the figures that its runs have. Raises Unknown where there is none."""
    database = catalogue.database
    row = database.execute(_DEVICE.format(index="", which="= ?"), (serial,)).fetchone()
    if row is None:
        raise Unknown("device", serial)
    named = database.execute(
        "SELECT figure_names.name, unit, better, runs FROM (SELECT figure, count(*) AS runs FROM runs "
        "CROSS JOIN figures USING (key) WHERE serial = ? AND trashed = 0 AND kind = 'run' GROUP BY figure) "
        "JOIN figure_names USING (figure) ORDER BY figure",
        (serial,),
    )
    return {**_device(database, row), "figures": [dict(name) for name in named]}


def trend(catalogue: Catalogue, serial: str, figure: str, limit: int = 10_000) -> dict[str, Any]:
    """A figure over the runs of one device, the oldest first; of several units, that of the newest run.

    Raises Unknown where there is no such device, InputError where none of its runs has the figure.
    """
    database = catalogue.database
    if database.execute("SELECT 1 FROM runs WHERE serial = ? AND trashed = 0", (serial,)).fetchone() is None:
        raise Unknown("device", serial)
    rows = database.execute(
        "SELECT runs.id, time, verdict, value, u, unit, better FROM figure_names JOIN runs "
        "JOIN figures ON figures.key = runs.key AND figures.figure = figure_names.figure "
        "WHERE figure_names.name = ? AND serial = ? AND trashed = 0 ORDER BY time DESC LIMIT ?",
        (figure, serial, limit),
    ).fetchall()
    if not rows:
        raise InputError(f"{figure}: no run of {serial} has such a figure; the device lists those there are")
    unit = rows[0]["unit"]
    points = [
        {"run": row["id"], "time": stamp(row["time"]), "verdict": row["verdict"], "value": row["value"], "u": row["u"]}
        for row in reversed(rows)
        if row["unit"] == unit
    ]
    return {"serial": serial, "figure": figure, "unit": unit, "better": rows[0]["better"], "points": points}


def figure_names(catalogue: Catalogue) -> list[dict[str, Any]]:
    """All figures that runs may be filtered and sorted by."""
    rows = catalogue.database.execute("SELECT name, unit, better FROM figure_names ORDER BY figure")
    return [dict(row) for row in rows]


def tags(catalogue: Catalogue) -> dict[str, int]:
    rows = catalogue.database.execute(
        "SELECT tag, count(*) AS runs FROM tags JOIN runs USING (key) WHERE trashed = 0 GROUP BY tag ORDER BY tag"
    )
    return {row["tag"]: row["runs"] for row in rows}


def stamp(when: float) -> str:
    """ISO 8601, in the zone of this machine."""
    return datetime.fromtimestamp(when).astimezone().isoformat(timespec="seconds")


def _device(database: sqlite3.Connection, row: sqlite3.Row) -> dict[str, Any]:
    last = database.execute(
        "SELECT id, verdict FROM runs WHERE serial = ? AND trashed = 0 AND kind = 'run' ORDER BY time DESC LIMIT 1",
        (row["serial"],),
    ).fetchone()
    return {
        **dict(row),
        "first": stamp(row["first"]),
        "last": stamp(row["last"]),
        "last_run": None if last is None else last["id"],
        "verdict": None if last is None else last["verdict"],
    }


def _conditions(database: sqlite3.Connection, asked: Filter) -> tuple[list[str], list[Any]]:
    conditions, values = ["runs.trashed = ?"], [int(asked.deleted)]
    told: list[Any] = list(values)
    for name in ("kind", "verdict", "device", "serial", "bench", "state"):
        if (value := getattr(asked, name)) is not None:
            conditions.append(f"runs.{name} = ?")
            told.append(value)
    for sign, limit in ((">=", asked.since), ("<", asked.until)):
        if limit is not None:
            conditions.append(f"runs.time {sign} ?")
            told.append(_seconds(limit))
    if asked.tag is not None:
        conditions.append("runs.key IN (SELECT key FROM tags WHERE tag = ?)")
        told.append(asked.tag)
    if words := (asked.q or "").casefold().split()[:10]:
        each = " AND ".join(["instr(text, ?)"] * len(words))
        conditions.append(f"{_ONE_BY_ONE} {each})")
        told += [word[:_LONGEST] for word in words]
    for condition in asked.where:
        name, sign, number = _condition(condition)
        known = _figures_of(database, name, f"where: {name!r} is no figure")
        which = "= ?" if len(known) == 1 else f"IN ({', '.join('?' * len(known))})"
        conditions.append(
            f"EXISTS (SELECT 1 FROM figures WHERE figures.key = runs.key AND figures.figure {which} AND value {sign} ?)"
        )
        told += [*known, number]
    return conditions, told


def _seconds(when: datetime) -> float:
    try:
        return when.timestamp()
    except (OverflowError, OSError, ValueError):
        raise Problem(422, "since, until: no time that is known here", "give ISO 8601, such as 2025-03-14") from None


def _condition(text: str) -> tuple[str, str, float]:
    parts = _CONDITION.fullmatch(text.strip())
    try:
        number = float(parts[3]) if parts else math.nan
    except ValueError:
        number = math.nan
    if parts is None or not math.isfinite(number):
        raise InputError(f"where: {text[:_LONGEST]!r} is no condition; give one such as angle_error_rms_rad<0.01")
    return parts[1], parts[2], number


def _figure_of(database: sqlite3.Connection, name: str) -> int:
    """The figure of that name; of several units, that which most runs have."""
    known = _figures_of(database, name[:_LONGEST], f"sort: {name[:_LONGEST]!r} is no column and no figure", _COLUMNS)
    if len(known) == 1:
        return known[0]
    counted = "SELECT count(*) FROM figures WHERE figure = ?"
    return max(known, key=lambda figure: int(database.execute(counted, (figure,)).fetchone()[0]))


def _figures_of(database: sqlite3.Connection, name: str, unknown: str, others: Sequence[str] = ()) -> list[int]:
    """The figures of that name, one for each unit.  Raises InputError that begins as `unknown`, with names near it."""
    if rows := database.execute("SELECT figure FROM figure_names WHERE name = ?", (name,)).fetchall():
        return [int(row["figure"]) for row in rows]
    names = [*others, *(row["name"] for row in database.execute("SELECT DISTINCT name FROM figure_names"))]
    if near := get_close_matches(name, names, 3):
        raise InputError(f"{unknown}; did you mean {' or '.join(near)}?")
    raise InputError(f"{unknown}; GET /api/figures lists those there are")


def _rows(database: sqlite3.Connection, found: Iterable[sqlite3.Row], shown: Sequence[str]) -> list[dict[str, Any]]:
    """Rows as they are told, with the figures called `shown`."""
    rows = list(found)
    keys = [row["key"] for row in rows]
    marks = ", ".join("?" * len(keys))
    details = {
        row["key"]: json.loads(row["body"])
        for row in database.execute(f"SELECT key, body FROM details WHERE key IN ({marks})", keys)
    }
    figures: dict[int, dict[str, float]] = {key: {} for key in keys}
    if shown:
        named = ", ".join("?" * len(shown))
        for row in database.execute(
            f"SELECT key, name, value FROM figures JOIN figure_names USING (figure) WHERE key IN ({marks}) "
            f"AND name IN ({named})",
            [*keys, *shown],
        ):
            figures[row["key"]][row["name"]] = row["value"]
    return [_row(row, details.get(row["key"], {}), figures[row["key"]]) for row in rows]


def _row(row: sqlite3.Row, details: dict[str, Any], figures: dict[str, float]) -> dict[str, Any]:
    return {
        "id": row["id"],
        "kind": row["kind"],
        "time": stamp(row["time"]),
        "name": row["name"],
        "device": row["device"],
        "serial": row["serial"],
        "bench": row["bench"],
        "verdict": row["verdict"],
        "parts": details.get("parts", {}),
        "against": details.get("against", {}),
        "seconds": row["seconds"],
        "clock": details.get("clock"),
        "mode": details.get("mode"),
        "link": details.get("link"),
        "note": details.get("note"),
        "tags": details.get("tags", []),
        "figures": figures,
        "folder": row["folder"],
        "state": row["state"],
        "interrupted": row["state"] == "interrupted",
        "reasons": details.get("reasons", []),
        "next": details.get("next"),
        "unreadable": details.get("unreadable"),
        "effects": details.get("effects", []),
        "record": details.get("record"),
        "deleted": bool(row["trashed"]),
    }


def _as_cursor(sort: str, value: Any, key: int) -> str:
    return base64.urlsafe_b64encode(json.dumps([sort, value, key]).encode()).decode().rstrip("=")


def _cursor(text: str, sort: str) -> tuple[str | float | None, int]:
    try:
        told = json.loads(base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)))
        kind, value, key = told
        if kind != sort or not isinstance(key, int) or isinstance(value, bool) or abs(key) >= 1 << 62:
            raise ValueError
        if not isinstance(value, str | float | int | None) or (isinstance(value, int) and abs(value) >= 1 << 62):
            raise ValueError
    except (ValueError, TypeError, RecursionError):
        raise InputError("after: no cursor of this list; give `next` of the page before, with the same sort") from None
    return value, key
