"""The signatures of the library's functions, on its reference page."""

import inspect
from pathlib import Path
from textwrap import fill
from typing import Any

import hil

_WIDTH = 112


class _Shown:
    """A default as the page has it: a path as its text, a function by its name."""

    def __init__(self, default: Any) -> None:
        self._default = default

    def __repr__(self) -> str:
        if inspect.isfunction(self._default):
            return self._default.__name__
        return f'"{self._default}"' if isinstance(self._default, Path | str) else repr(self._default)


def signatures() -> str:
    """Each function with its arguments, without their types, in the order of their modules."""
    functions = {name: found for name in dir(hil) if inspect.isfunction(found := getattr(hil, name))}
    told = (_signature(*one) for one in sorted(functions.items(), key=_place))
    return "\n".join(["```python", *told, "```"])


def _place(one: tuple[str, Any]) -> tuple[bool, str, int]:
    function = inspect.unwrap(one[1])
    return function.__module__ != "hil.library.verbs", function.__module__, function.__code__.co_firstlineno


def _signature(name: str, function: Any) -> str:
    signature = inspect.signature(function)
    empty = inspect.Parameter.empty
    bare = [
        one.replace(annotation=empty, default=one.default if one.default is empty else _Shown(one.default))
        for one in signature.parameters.values()
    ]
    returned = signature.return_annotation
    kind = returned if isinstance(returned, str) else returned.__name__
    arguments = str(signature.replace(parameters=bare, return_annotation=empty))
    if len(arguments) < _WIDTH:
        return f"hil.{name}{arguments} -> {kind}"
    inner = fill(arguments[1:-1], _WIDTH, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
    return f"hil.{name}(\n{inner}\n) -> {kind}"
