"""`hil demo` draws the page of each run once."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from hil import demo
from hil.report import page

pytestmark = pytest.mark.slow


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often the page of each run folder was drawn; the pages themselves are left empty, which takes no time."""
    count: Counter[str] = Counter()

    def render(folder: Any, *_: object) -> str:
        count[folder.path.name] += 1
        return "<!doctype html>"

    monkeypatch.setattr(page, "render", render)
    return count


@pytest.mark.realtime
def test_in_gain_mode(drawn: Counter[str], tmp_path: Path) -> None:
    folder = demo.in_gain_mode(tmp_path, duration_s=4.0, progress=lambda _: None)
    assert drawn == {folder.name: 1}
    assert (folder / "report.html").exists()


def test_before_and_after(drawn: Counter[str], tmp_path: Path) -> None:
    """On a machine that is busy, too: a run that is cut short has its page once."""
    circle = demo.demo(tmp_path, duration_s=12.0, progress=lambda _: None)
    runs = [run.name for run in (circle.before, circle.after) if run is not None]
    assert drawn == dict.fromkeys(runs, 1)
