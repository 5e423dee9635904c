"""docs/reference/library.md says what the library's functions take and what its objects have."""

import dataclasses
import inspect
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

import hil
from hil.comparing.diff import Figure, Key

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "library.md").read_text(encoding="utf-8")
SHOWN = dict(re.findall(r"^hil\.(\w+)(\([^>]*\) -> \w+)$", PAGE, re.MULTILINE))
FUNCTIONS = {name: found for name in dir(hil) if inspect.isfunction(found := getattr(hil, name))}


class Shown:
    """A default as the page writes it: a path as its text, a function by its name."""

    def __init__(self, default: Any) -> None:
        self._default = default

    def __repr__(self) -> str:
        if inspect.isfunction(self._default):
            return self._default.__name__
        return f'"{self._default}"' if isinstance(self._default, Path | str) else repr(self._default)


def as_shown(function: Callable[..., Any]) -> str:
    """The signature without the types of its arguments."""
    signature = inspect.signature(function)
    empty = inspect.Parameter.empty
    bare = [
        one.replace(annotation=empty, default=one.default if one.default is empty else Shown(one.default))
        for one in signature.parameters.values()
    ]
    returned = signature.return_annotation
    kind = returned if isinstance(returned, str) else returned.__name__
    return f"{signature.replace(parameters=bare, return_annotation=empty)} -> {kind}"


def attributes(heading: str) -> set[str]:
    """The names that the tables of a section show, `.name` or `a.name`, up to the next heading."""
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {name for cell in cells for name in re.findall(r"`\w*\.(\w+)", cell)}


def public(names: Iterable[str]) -> set[str]:
    return {name for name in names if not name.startswith("_")}


def test_the_page_has_every_function() -> None:
    assert sorted(SHOWN) == sorted(FUNCTIONS)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_a_signature_is_shown_whole_and_as_it_is(name: str) -> None:
    in_a_line = " ".join(SHOWN[name].split()).replace("( ", "(").replace(" )", ")")
    assert in_a_line == as_shown(FUNCTIONS[name])


@pytest.mark.parametrize("kind", [hil.Run, hil.Trace, hil.Sweep])
def test_what_an_object_has_is_on_the_page(kind: type) -> None:
    assert attributes(kind.__name__) >= public(vars(kind))


def test_what_a_comparison_of_methods_has_is_on_the_page() -> None:
    assert attributes("Methods") == {*hil.Methods.model_fields, *hil.MethodRow.model_fields, "of"}


def test_what_a_comparison_of_two_has_is_on_the_page() -> None:
    named = {one.name for kind in (hil.Comparison, Figure, Key) for one in dataclasses.fields(kind)}
    assert attributes("Comparison") == named | {"difference", "uncertainty", "apart", "as_json"}
