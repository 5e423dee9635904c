"""Keywords of a function that are declared once, elsewhere: in its signature and its help, refused where unknown."""

import inspect
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar, get_args, get_origin, get_type_hints

from hil.loop.options import Help

_Given = ParamSpec("_Given")
_Answer = TypeVar("_Answer")


class Keyword(NamedTuple):
    """One option: its name, its type, its limits, its help, and what it is where it is not given."""

    name: str
    type: Any
    limits: tuple[Any, ...]
    help: str
    default: Any


def keywords_of(options: type) -> Iterator[Keyword]:
    """The options that a TypedDict declares, in its order."""
    for name, hint in get_type_hints(options, include_extras=True).items():
        kind, *said = get_args(hint)
        inner = next((one for one in get_args(kind) if get_origin(one) is Annotated), None)
        limits = () if inner is None else get_args(inner)[1:]
        bare = kind if inner is None else get_args(inner)[0] | None
        yield Keyword(name, bare, limits, next(str(one) for one in said if isinstance(one, Help)), _default(bare))


def _default(kind: Any) -> Any:
    return False if kind is bool else None


def takes(options: type) -> Callable[[Callable[_Given, _Answer]], Callable[_Given, _Answer]]:
    """A decorator for a function that takes them as `**options`."""

    def around(function: Callable[_Given, _Answer]) -> Callable[_Given, _Answer]:
        known = list(keywords_of(options))
        own = [one for one in inspect.signature(function).parameters.values() if one.kind is not one.VAR_KEYWORD]
        more = [
            inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=one.type)
            for one in known
        ]
        signature = inspect.Signature([*own, *more], return_annotation=inspect.signature(function).return_annotation)

        @wraps(function)
        def called(*args: _Given.args, **given: _Given.kwargs) -> _Answer:
            try:
                signature.bind(*args, **given)
            except TypeError as error:  # as Python says it of any function
                raise TypeError(f"{function.__name__}() {error}") from None
            return function(*args, **given)

        called.__signature__ = signature  # type: ignore[attr-defined]
        told = "".join(f"\n    {one.name}: {one.help}" for one in known)
        called.__doc__ = f"{inspect.cleandoc(function.__doc__ or '')}\n\nOptions:\n{told}\n"
        return called

    return around
