"""docs/reference/library.md says what the library's functions take and what its objects have."""

import dataclasses
import re
from collections.abc import Iterable
from pathlib import Path

import pytest

import hil
from hil.comparing.diff import Figure, Key

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "library.md").read_text(encoding="utf-8")


def attributes(heading: str) -> set[str]:
    """The names that the tables of a section show, `.name` or `a.name`, up to the next heading."""
    section = PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {name for cell in cells for name in re.findall(r"`\w*\.(\w+)", cell)}


def public(names: Iterable[str]) -> set[str]:
    return {name for name in names if not name.startswith("_")}


@pytest.mark.parametrize("kind", [hil.Run, hil.Trace, hil.Sweep])
def test_what_an_object_has_is_on_the_page(kind: type) -> None:
    assert attributes(kind.__name__) >= public(vars(kind))


def test_what_a_comparison_of_methods_has_is_on_the_page() -> None:
    assert attributes("Methods") == {*hil.Methods.model_fields, *hil.MethodRow.model_fields, "of"}


def test_what_a_comparison_of_two_has_is_on_the_page() -> None:
    named = {one.name for kind in (hil.Comparison, Figure, Key) for one in dataclasses.fields(kind)}
    assert attributes("Comparison") == named | {"difference", "uncertainty", "apart", "as_json"}
