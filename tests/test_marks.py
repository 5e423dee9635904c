"""What `make test` leaves to `make test-long`, and which files are not loaded for it (tests/conftest.py)."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.conftest import mark_long, pytest_ignore_collect

LONG = "pytestmark = pytest.mark.long\n"
SLOW = "pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]\n"
MIXED = "@pytest.mark.beyond(2)\ndef test_it(case: int) -> None: ...\n"
PLAIN = "def test_it() -> None: ...  # takes not long, realtime or not\n"


class Item:
    """As much of a test as the hook asks for."""

    def __init__(self, nodeid: str, *marks: pytest.MarkDecorator) -> None:
        self.nodeid = nodeid
        self.marks = [mark.mark for mark in marks]

    def iter_markers(self, name: str) -> list[pytest.Mark]:
        return [mark for mark in self.marks if mark.name == name]

    def get_closest_marker(self, name: str) -> pytest.Mark | None:
        return next(iter(self.iter_markers(name)), None)

    def add_marker(self, mark: pytest.MarkDecorator) -> None:
        self.marks.append(mark.mark)


def marked(*items: Any) -> list[set[str]]:
    mark_long(items)
    return [{mark.name for mark in item.marks} - {"beyond"} for item in items]


def test_cases_beyond_a_number_are_long_and_slow() -> None:
    cases = [Item(f"file.py::test_counted[{case}]", pytest.mark.beyond(2)) for case in "abcd"]
    other = Item("file.py::test_other[a]", pytest.mark.beyond(1))  # is counted for itself
    assert marked(*cases, other) == [set(), set(), {"long", "slow"}, {"long", "slow"}, set()]


def test_what_is_long_is_slow() -> None:
    assert marked(Item("file.py::test_one", pytest.mark.long)) == [{"long", "slow"}]


@pytest.mark.parametrize(
    ("text", "wanted", "left_out"),
    [
        (LONG, "realtime and not long", True),
        (LONG, "not realtime and not long", True),
        (LONG, "not slow and not moderate and not realtime", True),
        (LONG, "long and not realtime", False),
        (SLOW, "not slow and not moderate and not realtime", True),
        (SLOW, "not realtime and not long", False),
        (SLOW, "long and not realtime", True),
        (MIXED, "long and not realtime", False),
        (MIXED, "not realtime and not long", False),
        (PLAIN, "long and not realtime", True),
        (PLAIN, "realtime and not long", True),
        (PLAIN, "not realtime and not long", False),
    ],
)
def test_a_file_of_which_nothing_is_left_is_not_loaded(tmp_path: Path, text: str, wanted: str, left_out: bool) -> None:
    path = tmp_path / "test_it.py"
    path.write_text(text)
    config: Any = SimpleNamespace(getoption=lambda _: wanted)
    assert bool(pytest_ignore_collect(path, config)) is left_out
