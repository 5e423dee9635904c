"""What a run folder says of itself, read for the catalogue: the little that lists need, and all figures."""

import hashlib
import json
import re
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from hil.errors import InputError, printable
from hil.records.atomic import is_occupied, read_json, write_text
from hil.records.blocks import opened, read_opening
from hil.records.direct import DirectRecord
from hil.records.figures import Known, of_run, of_trace
from hil.records.result import load_result
from hil.records.runfolder import RunFolder
from hil.records.runs import PARTS, Kind, beside_runs, listed_kind

State = Literal["done", "running", "interrupted", "recorded", "unreadable"]
"""running: a process works on it; interrupted: it has no figures, or those of a run that was stopped; recorded: from
elsewhere, without figures."""

_STAMPED = re.compile(r"(\d{8}-\d{6})-(.+)", re.DOTALL)
_PLAIN_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,150}")


class Entry(NamedTuple):
    """A run, or what else is listed. `time` in s since 1970; `details` is what rows show besides, JSON values."""

    kind: Kind
    time: float
    name: str
    state: State
    bench: str | None = None
    device: str | None = None
    serial: str | None = None
    verdict: str | None = None
    seconds: float | None = None
    note: str | None = None
    tags: tuple[str, ...] = ()
    details: Mapping[str, Any] = MappingProxyType({})
    figures: Sequence[Known] = ()


def id_of(folder: str) -> str:
    """What a run is called in addresses: the name of its folder, where that is a plain one."""
    if _PLAIN_ID.fullmatch(folder):
        return folder
    return "~" + hashlib.sha256(folder.encode("utf-8", "surrogateescape")).hexdigest()[:24]


def is_run(folder: Path) -> bool:
    return any((folder / part).exists() for part in PARTS)


def read_entry(folder: Path) -> Entry:
    """What a folder says; what cannot be read is said in `details`, and never raised."""
    stamped = _STAMPED.fullmatch(folder.name)
    when, name = (stamped[1], stamped[2]) if stamped else ("", folder.name)
    kind = listed_kind(folder)
    unreadable, marks = "", Marks()
    declared: tuple[str | None, str | None] = None, None
    try:
        marks = read_marks(folder)
    except InputError as error:
        unreadable = str(error)
    try:
        declared = _declared(folder)
    except InputError as error:
        unreadable = str(error)
    blank = Entry(kind, _time(when, folder), printable(name), "unreadable", declared[1])
    try:
        told = _READ.get(kind, _beside)(folder, blank)
    except InputError as error:
        told, unreadable = blank, str(error)
    details = {
        "note": told.note if marks.note is None else marks.note,
        "noted": marks.note is not None,
        "tags": list(marks.tags),
        "unreadable": unreadable or None,
        **told.details,
    }
    return told._replace(
        device=told.device or declared[0], tags=tuple(dict.fromkeys(marks.tags)), details=details
    )  # fmt: skip


def _run(folder: Path, blank: Entry) -> Entry:
    path = folder / "result.json"
    if not path.exists():
        return _without_figures(folder, blank)
    result = load_result(path)
    details = {
        "parts": {name: part.outcome for name, part in result.parts.items()},
        "against": result.against,
        "reasons": list(result.reasons),
        "next": result.next,
        "clock": result.clock,
        "mode": result.mode,
        "link": result.link,
    }
    return blank._replace(
        state="interrupted" if result.verdict == "interrupted" else "done", verdict=result.verdict,
        seconds=result.seconds, serial=result.serial_number or _serial(folder), note=result.operator_note,
        device=None if result.sensor is None else result.sensor.device, details=details, figures=of_run(result),
    )  # fmt: skip


def _trace(folder: Path, blank: Entry) -> Entry:
    from hil.records.diagnosis import load_diagnosis  # knows the estimator's words, which the rest needs not

    found = load_diagnosis(folder / "diagnosis.json")
    details = {
        "record": found.record,
        "effects": [effect.name for effect in found.effects],
        "reasons": list(found.reasons),
    }
    serial = None
    if Path(found.record).name == found.record and (folder.parent / found.record).is_dir():
        serial = _serial(folder.parent / found.record)
    return blank._replace(
        state="done", verdict=found.verdict, serial=serial, device=found.bench, details=details, figures=of_trace(found)
    )


def _beside(folder: Path, blank: Entry) -> Entry:
    found = beside_runs(folder)
    told = {"reasons": list(found.reasons)}
    return blank._replace(state="done", verdict=found.verdict, seconds=found.seconds, details=told)


def _without_figures(folder: Path, blank: Entry) -> Entry:
    if is_occupied(folder):
        return blank._replace(state="running", serial=_serial(folder))
    ended = not (folder / "bench.toml").exists() and _is_complete(folder / "capture.arrow")
    return blank._replace(state="recorded" if ended else "interrupted", serial=_serial(folder))


_READ: dict[Kind, Callable[[Path, Entry], Entry]] = {"run": _run, "trace": _trace}


def _is_complete(capture: Path) -> bool:
    with suppress(InputError), DirectRecord(capture, "capture") as record:
        return record.complete
    return False


def _serial(folder: Path) -> str | None:
    """Of the board, by the header of the capture."""
    path = folder / "capture.arrow"
    with suppress(InputError, OSError, AttributeError, TypeError, ValueError), opened(path, "capture") as file:
        identity = read_opening(path, file, "capture").header.get("identity") or {}
        if isinstance(number := identity.get("unique_id"), int):
            return f"{number:016x}"
    return None


def _declared(folder: Path) -> tuple[str | None, str | None]:
    """Names that the bench file as run gives the device and the bench."""
    run = RunFolder(folder)
    try:
        return _names(run.bench_text) if run.bench_text else (None, None)
    except (ValueError, RecursionError):
        raise InputError(f"{run.bench_path}: not TOML; restore the file as run") from None


@lru_cache(maxsize=512)
def _names(told: str) -> tuple[str | None, str | None]:
    """[device] name and [loop] bench or name: of a file that hil wrote, by these tables alone; TOML is slow to read."""
    named = []
    for section in ("device", "loop"):
        part = re.search(rf"^\[{section}\]$(.*?)^\[", told, re.DOTALL | re.MULTILINE)
        table = tomllib.loads(part[1]) if part else tomllib.loads(told).get(section, {})
        name = (table.get("bench") or table.get("name")) if isinstance(table, dict) else None
        named.append(printable(name) if isinstance(name, str) else None)
    return named[0], named[1]


def _time(stamp: str, folder: Path) -> float:
    with suppress(ValueError, OverflowError):
        return time.mktime(time.strptime(stamp, "%Y%m%d-%H%M%S"))
    for part in PARTS:
        with suppress(OSError):
            return (folder / part).stat().st_mtime
    return 0.0


def as_json(details: Mapping[str, Any]) -> str:
    return json.dumps(dict(details), ensure_ascii=False, allow_nan=False, separators=(",", ":"))


FILE = "marks.json"
Tag = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=60, pattern=r"^[^\x00-\x1f\x7f]+$")
]


class Marks(BaseModel):
    """What people say of a run."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    version: int = Field(default=1, ge=1, le=1)
    tags: tuple[Tag, ...] = Field(default=(), max_length=50)
    note: Annotated[str, StringConstraints(max_length=10_000)] | None = Field(
        default=None, description="Stands for the operator's note of result.json; null where that one is meant"
    )


def read_marks(folder: Path) -> Marks:
    """Those of a run; none where there is no file. Raises InputError where it is no file of marks."""
    path = folder / FILE
    try:
        return Marks.model_validate_json(read_json(path))
    except FileNotFoundError:
        return Marks()
    except (OSError, ValidationError, ValueError):
        raise InputError(f"{path}: tags and note cannot be read; correct or remove the file") from None


def write_marks(folder: Path, marks: Marks) -> None:
    """Write them, whole or not at all; no file is left where there is nothing to say."""
    path = folder / FILE
    if marks == Marks():
        path.unlink(missing_ok=True)
    else:
        write_text(path, marks.model_dump_json(indent=1) + "\n")
