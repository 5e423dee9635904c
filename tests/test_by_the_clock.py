"""Files of tests by the clock side by side, and those that need the machine to themselves."""

import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.by_the_clock import Floor

ONE, OTHER, LONELY = Path("one"), Path("other"), Path("lonely")


def item(path: Path, **arguments: bool) -> Any:
    mark = pytest.mark.realtime(**arguments).mark
    return SimpleNamespace(path=path, iter_markers=lambda name: [mark] if name == "realtime" else [])


@pytest.fixture
def floors(tmp_path: Path) -> Iterator[tuple[Floor, Floor, Floor]]:
    """Those of three processes, one file of which is to be alone."""
    made = Floor("run", tmp_path), Floor("run", tmp_path), Floor("run", tmp_path)
    for floor in made:
        floor.note([item(ONE), item(OTHER, alone=False), item(LONELY, alone=True)])
    yield made
    for floor in made:
        floor.leave()


def enters(floor: Floor, path: Path) -> threading.Event:
    """Set once it has."""
    done = threading.Event()

    def enter() -> None:
        floor.enter(path)
        done.set()

    threading.Thread(target=enter, daemon=True).start()
    return done


def test_files_are_beside_one_another(floors: tuple[Floor, Floor, Floor]) -> None:
    first, second, _ = floors
    first.enter(ONE)
    second.enter(OTHER)
    second.enter(OTHER)  # its next test


def test_one_that_is_to_be_alone_waits_and_holds_back_those_after_it(floors: tuple[Floor, Floor, Floor]) -> None:
    first, second, third = floors
    first.enter(ONE)
    alone = enters(second, LONELY)
    assert not alone.wait(0.1)
    late = enters(third, OTHER)
    assert not late.wait(0.1)
    first.leave()
    assert alone.wait(10.0)
    assert not late.wait(0.1)
    second.leave()
    assert late.wait(10.0)
