"""What all tests of the loop share."""

import pytest


@pytest.fixture(autouse=True)
def _strict(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warnings are errors in the processes that tests start, too."""
    monkeypatch.setenv("PYTHONWARNINGS", "error")
