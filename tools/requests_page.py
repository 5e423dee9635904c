"""Tables of the pages that say what may be asked of a verb, and how a program ends."""

import errno
from pathlib import Path
from typing import Any, get_args

from annotated_types import Ge, Gt, Le, Lt, MaxLen

from estimator.errors import ModelError
from hil.characterising.options import CharacteriseOptions, LocalCharacteriseOptions
from hil.errors import InputError
from hil.errors.ending import ExitCode, ending_of
from hil.identifying.options import IdentifyOptions, LocalIdentifyOptions
from hil.importing.options import ImportOptions, LocalImportOptions
from hil.options import Keyword, keywords_of
from hil.replaying.options import ReplayOptions
from hil.running.options import LocalRunOptions, RunOptions
from hil.sensors.options import LocalRecordOptions, RecordOptions
from hil.service.catalogue.catalogue import Conflict
from hil.service.jobs.uploads import TooLarge
from hil.service.problems import Problem
from hil.sweeping.options import LocalSweepOptions, SweepOptions
from hil.tracing.options import TraceOptions
from hil.wire.errors import LinkError, ProtocolError
from tools.markdown import table

VERBS: dict[str, tuple[type, type]] = {
    "run": (RunOptions, LocalRunOptions),
    "record": (RecordOptions, LocalRecordOptions),
    "identify": (IdentifyOptions, LocalIdentifyOptions),
    "characterise": (CharacteriseOptions, LocalCharacteriseOptions),
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


def requests() -> str:
    """The options of each verb."""
    return "\n\n".join(f"## hil {verb}\n\n{_options(*classes)}" for verb, classes in VERBS.items())


def endings() -> str:
    """The exit codes, and what leads to them."""
    codes = ((int(code), _MEANING[code]) for code in ExitCode)
    rows = []
    for what, error in _KINDS:
        ending = ending_of(error)
        status = "its own" if isinstance(error, Problem) else ending.status
        rows.append((what, int(ending.code), "–" if ending.code is ExitCode.INTERRUPTED else status))
    return f"{table(('exit code', ''), codes)}\n\n{table(('what went wrong', 'exit code', 'status over HTTP'), rows)}"


def _options(everywhere: type, here: type) -> str:
    shared = {one.name for one in keywords_of(everywhere)}
    rows = (
        (
            f"`--{one.called.name.replace('_', '-')}`",
            f"`{one.name}`",
            f"`{one.outside}`" if one.name in shared else "–",
            _value(one),
            _default(one),
            " ".join(one.help.split()),
        )
        for one in keywords_of(here)
    )
    return table(("command line", "Python", "HTTP, file", "value", "default", ""), rows)


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
