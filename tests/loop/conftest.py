"""What all tests of the loop share."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _strict(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warnings are errors in the processes that tests start, too."""
    monkeypatch.setenv("PYTHONWARNINGS", "error")


@pytest.fixture
def no_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the page for people, which costs more than the short run it tells of."""

    def written(_: Path) -> None:
        pass

    monkeypatch.setattr("hil.report.write_report", written)


@pytest.fixture
def no_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the scan that closes a run, where nobody asks whether the model is complete."""

    def scanned(*_: object) -> None:
        pass

    monkeypatch.setattr("hil.closing_scan.scan_run", scanned)
