"""Options of a verb that are declared once, elsewhere."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_args

import typer
from annotated_types import Ge, Le

from hil.library.keywords import Keyword, keywords_of


def with_options(options: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator for a verb that takes them as `**options`; `duration_s` is `--duration` there."""

    def around(verb: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(verb).parameters.values()
        more = [
            inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=_option(one))
            for one in keywords_of(options)
        ]
        signature = inspect.Signature([*(each for each in own if each.kind is not each.VAR_KEYWORD), *more])
        verb.__signature__ = signature  # type: ignore[attr-defined]
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
