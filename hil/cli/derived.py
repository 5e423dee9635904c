"""Options of a verb that are declared once, elsewhere."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from annotated_types import Ge, Le

from hil.library.keywords import with_keywords
from hil.options import Keyword, keywords_of


def with_options(options: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator for a verb that takes them as `**options`; `duration_s` is `--duration` there."""

    def around(verb: Callable[..., None]) -> Callable[..., None]:
        verb.__signature__ = with_keywords(verb, options, _option)  # type: ignore[attr-defined]
        verb.__annotations__ = {}  # where typer looks first
        return verb

    return around


def _option(one: Keyword) -> Any:
    """Whole numbers are held in their limits by the command line, the rest by the bench, in its words."""
    least = next((limit.ge for limit in one.limits if isinstance(limit, Ge)), None)
    most = next((limit.le for limit in one.limits if isinstance(limit, Le)), None)
    more: dict[str, Any] = {"min": least, "max": most} if int in get_args(one.type) else {}
    more |= {"metavar": "NAME"} if one.is_names else {}
    kind = list[str] | None if one.is_names else Path | None if Path in get_args(one.type) else one.type
    flag = one.called.name.replace("_", "-")
    is_switch = bool in (one.type, *get_args(one.type)) and one.default is not False
    names = [f"--{flag}/--no-{flag}" if is_switch else f"--{flag}"]
    names += [f"-{one.called.letter}"] if one.called.letter else []
    return Annotated[kind, typer.Option(*names, help=one.help, **more)]


def as_words(options: type, given: Mapping[str, Any]) -> list[str]:
    """The same on a command line, for another process of the bench."""
    words: list[str] = []
    for one in keywords_of(options):
        if (value := given.get(one.name)) not in (None, False):
            words += [f"--{one.called.name.replace('_', '-')}", *([] if value is True else [str(value)])]
    return words
