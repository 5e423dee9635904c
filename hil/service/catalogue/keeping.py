"""The catalogue kept up to date while the service lasts, by a thread that looks at the folders."""

import logging
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from hil.comparing.diff import Figure, keys_apart, same_record
from hil.errors import InputError
from hil.records.runfolder import RunFolder
from hil.service import series
from hil.service.catalogue.catalogue import Catalogue, Looked
from hil.service.catalogue.queries import figures_of, key_of

_EVERY_S = 2.0
_WHOLE_S = 60.0  # between two looks at every folder …
_REST = 10  # times as long as a quick look takes, nobody looks
_SHARE = 50  # … and at least so many times as long as such a look takes
_END_S = 30.0
_LOG = logging.getLogger("hil.service")


@contextmanager
def kept(catalogue: Catalogue, told: Callable[[Looked], None]) -> Iterator[None]:
    """Keep it up to date for the length of the block; `told` what each look came to that found something."""
    ending = threading.Event()
    thread = threading.Thread(target=_keep, args=(catalogue, told, ending), name="catalogue", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join(_END_S)


def _keep(catalogue: Catalogue, told: Callable[[Looked], None], ending: threading.Event) -> None:
    next_whole_s, wait_s = 0.0, 0.0
    while not ending.wait(wait_s):
        began_s = time.monotonic()
        whole = began_s >= next_whole_s
        try:
            found = catalogue.look(whole=whole, stop=ending.is_set)
        except (OSError, sqlite3.Error) as error:  # a disk that is full, a folder that went away: they may come back
            _LOG.warning("the runs could not be looked at: %s", error)
            found = Looked(0, 0, ())
        took_s = time.monotonic() - began_s
        if whole:
            next_whole_s = time.monotonic() + max(_WHOLE_S, _SHARE * took_s)
        wait_s = _EVERY_S if whole else max(_EVERY_S, _REST * took_s)
        if found.changed or found.gone:
            told(found)


def compare(catalogue: Catalogue, a: str, b: str) -> dict[str, Any]:
    """Figures with difference b − a, its uncertainty (95 %) and which of the two is better; the channels that both
    have; the bench keys that differ. Raises Unknown for an unknown run, InputError for two of different kinds.
    """
    database = catalogue.database
    keys = [key_of(catalogue, run) for run in (a, b)]
    kinds = [database.execute("SELECT kind FROM runs WHERE key = ?", (key,)).fetchone()[0] for key in keys]
    if kinds[0] != kinds[1]:
        raise InputError(f"{a} is a {kinds[0]}, {b} a {kinds[1]}; compare two runs, or two traces")
    folders = [catalogue.path_of(run) for run in (a, b)]
    same = kinds[0] == "run" and same_record(*(folder / "capture.arrow" for folder in folders))
    first, second = (figures_of(database, key) for key in keys)
    figures = [
        _side_by_side(name, first.get(name), second.get(name), same) for name in dict.fromkeys([*first, *second])
    ]
    told = [{one.name: None for one in series.channels(folder)} for folder in folders]
    benches = [RunFolder(folder).bench for folder in folders]
    return {
        "a": a,
        "b": b,
        "kind": kinds[0],
        "same_record": same,
        "figures": figures,
        "channels": [name for name in told[0] if name in told[1]],
        "bench": [key.as_json() for key in keys_apart(*benches)],
    }


def _side_by_side(name: str, a: dict[str, Any] | None, b: dict[str, Any] | None, same: bool) -> dict[str, Any]:
    known = a or b or {}
    alike = a is None or b is None or a["unit"] == b["unit"]
    one = Figure(
        name, known["unit"], a["value"] if a else None, b["value"] if b and alike else None,
        a["u"] if a else None, b["u"] if b and alike else None, same,
    )  # fmt: skip
    return {**one.as_json("u_a", "u_b"), "better": _better(one, known["better"])}


def _better(one: Figure, rule: str | None) -> str | None:
    """`a` or `b`; None where neither is, or where nobody can say."""
    if rule is None or one.a is None or one.b is None or one.a == one.b or one.apart is False:
        return None
    badness = [{"less": value, "more": -value, "one": abs(value - 1.0)}[rule] for value in (one.a, one.b)]
    if badness[0] == badness[1]:
        return None
    return "a" if badness[0] < badness[1] else "b"
