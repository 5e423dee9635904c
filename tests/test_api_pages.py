"""docs/api describes every public name of `hil`, and no other."""

import re
from pathlib import Path

import hil

PAGES = sorted((Path(__file__).parents[1] / "docs" / "api").glob("*.md"))


def test_the_pages_of_the_api_have_every_public_name_once() -> None:
    named = [name for page in PAGES for name in re.findall(r"^::: hil\.(\w+)$", page.read_text(), re.MULTILINE)]
    assert sorted(named) == sorted(name for name in hil.__all__ if name != "__version__")


def test_open_is_described_though_a_star_does_not_import_it() -> None:
    assert "::: hil.library.verbs.open_live\n" in "".join(page.read_text() for page in PAGES)
    assert hil.open.__module__ == "hil.library.verbs"
