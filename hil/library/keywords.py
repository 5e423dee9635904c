"""Keywords of a function that are declared once, elsewhere: in its signature and its help, refused where unknown."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from hil.options import Keyword, keywords_of

_Given = ParamSpec("_Given")
_Answer = TypeVar("_Answer")


def with_keywords(
    function: Callable[..., Any], options: type, annotation: Callable[[Keyword], Any] = lambda one: one.type
) -> inspect.Signature:
    """The signature of a function that takes them as `**options`, with each of them in it."""
    signature = inspect.signature(function)
    own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
    more = [
        inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=annotation(one))
        for one in keywords_of(options)
    ]
    return signature.replace(parameters=[*own, *more])


def takes(options: type) -> Callable[[Callable[_Given, _Answer]], Callable[_Given, _Answer]]:
    """A decorator for a function that takes them as `**options`."""

    def around(function: Callable[_Given, _Answer]) -> Callable[_Given, _Answer]:
        signature = with_keywords(function, options)

        @wraps(function)
        def called(*args: _Given.args, **given: _Given.kwargs) -> _Answer:
            try:
                signature.bind(*args, **given)
            except TypeError as error:  # as Python says it of any function
                raise TypeError(f"{function.__name__}() {error}") from None
            return function(*args, **given)

        called.__signature__ = signature  # type: ignore[attr-defined]
        told = "".join(f"\n    {one.name}: {one.help}" for one in keywords_of(options))
        called.__doc__ = f"{inspect.cleandoc(function.__doc__ or '')}\n\nOptions:\n{told}\n"
        return called

    return around
