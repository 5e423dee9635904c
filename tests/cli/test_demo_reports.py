"""`hil demo` draws the page of each run once."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from hil import demo
from hil.records.diagnosis import Coefficient, Effect
from hil.report import page
from hil.tracing import trace as tracing
from hil.tracing.request import Traced, TraceRequest
from tests.cli.diagnoses import explained

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


@pytest.mark.long
@pytest.mark.realtime
def test_in_gain_mode(drawn: Counter[str], tmp_path: Path) -> None:
    folder = demo.in_gain_mode(tmp_path, duration_s=4.0, progress=lambda _: None).last
    assert drawn[folder.name] == 1
    assert set(drawn.values()) == {1}  # one that was late, and repeated, has its own
    assert (folder / "report.html").exists()


HARDENING = Effect(
    name="cubic_stiffness",
    title="cubic stiffness",
    equations=(),
    coefficients={
        "k3x": Coefficient(value=1.0e13, ci95=(0.9e13, 1.1e13), unit="1/(m²·s²)"),
        "k3y": Coefficient(value=3.0e12, ci95=(2.9e12, 3.1e12), unit="1/(m²·s²)"),
    },
    evidence=1000.0,
    compensation="by the drive",
)  # fmt: skip


@pytest.fixture
def traced_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A trace says what it is told to: which effect it is matters to no page's number."""

    def trace(request: TraceRequest, out: Path, **_: object) -> Traced:
        folder = out / "traced"
        folder.mkdir()
        return Traced(folder, explained(effects=(HARDENING,), record=str(request.capture)))

    monkeypatch.setattr(tracing, "trace", trace)


@pytest.mark.usefixtures("traced_at_once")
@pytest.mark.long
def test_before_and_after(drawn: Counter[str], tmp_path: Path) -> None:
    """On a machine that is busy, too: a run that is cut short has its page once."""
    circle = demo.demo(tmp_path, duration_s=12.0, progress=lambda _: None)
    runs = [run.name for run in (circle.before, circle.after) if run is not None]
    assert set(runs) <= set(drawn)
    assert set(drawn.values()) == {1}  # one that was late, and repeated, has its own
