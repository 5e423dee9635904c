"""The pages of the reference that say what may be asked of a verb, and how a program ends.

``python -m hil.cli.reference docs/reference`` writes the tables of ``requests.md`` and ``errors.md``, which stand
between two marks: they are read from the declarations and from `hil.errors.ending`.
"""

import errno
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt, MaxLen

from estimator.errors import ModelError
from hil.errors import InputError
from hil.errors.ending import ending_of
from hil.errors.exit_codes import ExitCode
from hil.importing.options import ImportOptions, LocalImportOptions
from hil.loop.options import LocalRunOptions, RunOptions
from hil.options import Keyword, keywords_of
from hil.records.atomic import write_text
from hil.replaying.options import ReplayOptions
from hil.sensors.options import RecordOptions
from hil.service.catalogue.catalogue import Conflict
from hil.service.jobs.uploads import TooLarge
from hil.service.problems import Problem
from hil.sweeping.options import LocalSweepOptions, SweepOptions
from hil.tracing.options import TraceOptions
from hil.wire.errors import LinkError, ProtocolError

BEGIN, END = "<!-- generated: python -m hil.cli.reference docs/reference -->\n", "<!-- end -->\n"
VERBS: dict[str, tuple[type, type]] = {
    "run": (RunOptions, LocalRunOptions),
    "record": (RecordOptions, RecordOptions),
    "import": (ImportOptions, LocalImportOptions),
    "replay": (ReplayOptions, ReplayOptions),
    "trace": (TraceOptions, TraceOptions),
    "sweep": (SweepOptions, LocalSweepOptions),
}
"""Of each verb the options that every caller takes, and those of the machine itself."""

_KINDS: tuple[tuple[str, BaseException], ...] = (
    ("a file, key, option or argument cannot be used: `InputError`", InputError("")),
    ("what the model cannot do: `ModelError`", ModelError("")),
    ("a link, or the board behind it: `WireError`", LinkError("")),
    ("a peer that speaks otherwise: `ProtocolError`", ProtocolError("")),
    ("it cannot be done to this run now: `Conflict`", Conflict("")),
    ("more than is taken: `TooLarge`", TooLarge("")),
    ("a request of the service: `Problem`", Problem(422, "")),
    ("a file of this machine, a full disk: `OSError` that names it", OSError(errno.ENOSPC, "No space left", "place")),
    ("out of memory: `MemoryError`", MemoryError()),
    ("Ctrl-C or SIGTERM: `KeyboardInterrupt`, `hil.Interrupted`", KeyboardInterrupt()),
    ("anything else: a fault of the program", RuntimeError("")),
)
_MEANING = {
    ExitCode.GOOD: "good",
    ExitCode.AGAINST: "the verdict is not good, or a residual stays unexplained",
    ExitCode.BAD_INPUT: "bad input: one line says what and where",
    ExitCode.FAULT: "a fault of the program (bug): the board, the record and the model were not judged",
    ExitCode.INTERRUPTED: "Ctrl-C or SIGTERM",
}


def requests() -> Iterator[str]:
    """Tables of the options."""
    for verb, (everywhere, here) in VERBS.items():
        shared = {one.name for one in keywords_of(everywhere)}
        yield f"\n## hil {verb}\n\n| command line | Python | HTTP, file | value | default | |\n" + "|---" * 6 + "|\n"
        for one in keywords_of(here):
            outside = f"`{one.outside}`" if one.name in shared else "–"
            told = " ".join(one.help.split()).replace("|", "\\|")
            yield (
                f"| `--{one.called.name.replace('_', '-')}` | `{one.name}` | {outside} | {_value(one)} | "
                f"{_default(one)} | {told} |\n"
            )


def endings() -> Iterator[str]:
    """Tables of the exit codes, and of what leads to them."""
    yield "\n| exit code | |\n|---|---|\n"
    yield from (f"| {int(code)} | {_MEANING[code]} |\n" for code in ExitCode)
    yield "\n| what went wrong | exit code | status over HTTP |\n|---|---|---|\n"
    for what, error in _KINDS:
        ending = ending_of(error)
        over_http = (
            "–" if ending.code is ExitCode.INTERRUPTED else "its own" if isinstance(error, Problem) else ending.status
        )
        yield f"| {what} | {int(ending.code)} | {over_http} |\n"


def page(text: str, tables: Iterator[str]) -> str:
    """`text` with its tables as the program has them."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}{''.join(tables)}{END}{rest.split(END, 1)[1]}"


PAGES = {"requests.md": requests, "errors.md": endings}


def _value(one: Keyword) -> str:
    kinds: tuple[Any, ...] = tuple(kind for kind in get_args(one.type) or (one.type,) if kind is not type(None))
    if one.is_names:
        return "name or names"
    if choices := [choice for kind in kinds for choice in get_args(kind)] or [
        one for one in kinds if isinstance(one, str)
    ]:
        return " · ".join(f"`{choice}`" for choice in choices)
    words = {float: "number", int: "whole number", str: "text", bool: "switch", Path: "file"}
    return " ".join([words[Path if Path in kinds else kinds[0]], *(_limit(limit) for limit in one.limits)]).strip()


def _limit(limit: Any) -> str:
    match limit:
        case Gt(least):
            return f"> {least:g}"
        case Ge(least):
            return f"≥ {least}"
        case Lt(most):
            return f"< {most:g}"
        case Le(most):
            return f"≤ {most:g}" if isinstance(most, float) else f"≤ {most}"
        case MaxLen(most):
            return f"of {most} letters at most"
    return ""


def _default(one: Keyword) -> str:
    return (
        "–"
        if one.default in (None, ())
        else "on"
        if one.default is True
        else "off"
        if one.default is False
        else f"{one.default:g}"
    )


def main(folder: Path) -> None:
    """Write the pages."""
    for name, tables in PAGES.items():
        place = folder / name
        write_text(place, page(place.read_text(encoding="utf-8"), tables()))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
