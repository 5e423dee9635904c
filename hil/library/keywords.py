"""Keywords of a function that are declared once, elsewhere: in its signature and its help, refused where unknown."""

import inspect
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from hil.errors import InputError, told_to_user
from hil.options import Keyword, keywords_of
from hil.wire.errors import WireError

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


_COMMAND = r"\bhil [a-z]+ [^;,)`]*"  # stays as it is: it is for a terminal
OPTION = re.compile(rf"{_COMMAND}|(?<!\S)--(?P<name>[a-z][A-Za-z0-9]*(?:-[A-Za-z0-9]+)*)\b(?P<place>(?=:))?")


def said_of_arguments(function: Callable[_Given, _Answer]) -> Callable[_Given, _Answer]:
    """A decorator: errors of the function speak of its arguments, see `in_arguments_of`."""

    @wraps(function)
    def called(*args: _Given.args, **given: _Given.kwargs) -> _Answer:
        with in_arguments_of(function):
            return function(*args, **given)

    return called


@contextmanager
def in_arguments_of(function: Callable[..., Any]) -> Iterator[None]:
    """What a user can mend and is raised inside becomes an InputError that speaks of the arguments of `function`.

    The words come from its signature: `--out` is said as `out=`, `--map` as `mapping=`.  An option that is no argument
    of it stays an option.  A WireError stays one, and what is no user's fault stays as it is.
    The verbs of the command line call the same functions: `typed` keeps the options for them.
    """
    try:
        yield
    except WireError:
        raise
    except Exception as error:
        if (told := told_to_user(error)) is None:
            raise
        known = tuple(inspect.signature(function).parameters)
        raise InputError(OPTION.sub(lambda found: _argument(found, known), told), typed=told) from None


def _argument(found: re.Match[str], known: tuple[str, ...]) -> str:
    """The argument for an option: that of its name, or the only one that begins with it, as `duration_s` does with
    `--duration`.  One that begins the line, `--out: …`, is the place itself.
    """
    if found["name"] is None:
        return found[0]
    name = found["name"].replace("-", "_")
    matching = [name] if name in known else [one for one in known if one.startswith(name)]
    if len(matching) != 1:
        return found[0]
    return matching[0] + ("" if found["place"] is not None else "=")
