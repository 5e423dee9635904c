"""Options of a verb that are declared once, elsewhere."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from annotated_types import Ge, Le

from hil.library.keywords import Keyword, with_keywords


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
    bounds: dict[str, Any] = {"min": least, "max": most} if int in get_args(one.type) else {}
    kind = Path | None if Path in get_args(one.type) else one.type
    flag = one.name.removesuffix("_s").replace("_", "-")
    return Annotated[kind, typer.Option(f"--{flag}", help=one.help, **bounds)]
