"""What the bench says to the command line, said to who called a function: the arguments have the options' names."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

from hil.errors import InputError, told_to_user
from hil.wire.errors import WireError

_Given = ParamSpec("_Given")
_Answer = TypeVar("_Answer")
_COMMAND = r"\bhil [a-z]+ [^;,)`]*"  # stays as it is: it is for a terminal
_OPTION = re.compile(rf"{_COMMAND}|(?<!\S)--(?P<name>[a-z]+(?:-[a-z]+)*)\b(?P<place>(?=:))?")


@contextmanager
def said_of_arguments() -> Iterator[None]:
    """What a user can mend and is raised inside becomes an InputError that speaks of arguments: `out=` for `--out`.

    Around a call, or as a decorator.  A WireError stays one, and what is no user's fault stays as it is.
    The verbs of the command line call the same functions: `typed` keeps the options for them.
    """
    try:
        yield
    except WireError:
        raise
    except Exception as error:
        if (told := told_to_user(error)) is None:
            raise
        raise InputError(_OPTION.sub(_argument, told), typed=told) from None


def renamed(**names: str) -> Callable[[Callable[_Given, _Answer]], Callable[_Given, _Answer]]:
    """A decorator for a function whose arguments have had other names: an old one is refused with the new one."""

    def around(function: Callable[_Given, _Answer]) -> Callable[_Given, _Answer]:
        @wraps(function)
        def called(*args: _Given.args, **given: _Given.kwargs) -> _Answer:
            if (old := next((name for name in names if name in given), None)) is not None:
                raise InputError(f"{old}: this argument is called {names[old]} now; give {names[old]}={given[old]!r}")
            return function(*args, **given)

        return called

    return around


def _argument(found: re.Match[str]) -> str:
    """The argument for an option; one that begins the line, `--out: …`, is the place itself."""
    if found["name"] is None:
        return found[0]
    return found["name"].replace("-", "_") + ("" if found["place"] is not None else "=")
