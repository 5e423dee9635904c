"""How a program ends is decided in one place."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DECIDES = ("hil/errors/",)
SECOND_PLACES = {
    "told_to_user(": {"hil/library/keywords.py", "hil/pytest_plugin.py"},  # only whether it is a user's
    "fault_line(": {"hil/service/problems.py"},  # without its own words, which a client need not know
    "kept_fault(": set(),
    '"a fault of hil': set(),
}  # fmt: skip


def sources() -> list[Path]:
    return [one for one in sorted((ROOT / "hil").rglob("*.py")) if not str(one.relative_to(ROOT)).startswith(DECIDES)]


@pytest.mark.parametrize("words", SECOND_PLACES)
def test_no_second_place_decides_how_an_error_is_told(words: str) -> None:
    found = {str(one.relative_to(ROOT)) for one in sources() if words in one.read_text(encoding="utf-8")}
    assert found == SECOND_PLACES[words]


def test_no_program_ends_by_a_number() -> None:
    ends = re.compile(r"(?:sys\.exit|os\._exit|typer\.Exit)\((?:code=)?-?\d")
    assert [str(one.relative_to(ROOT)) for one in sources() if ends.search(one.read_text(encoding="utf-8"))] == []
