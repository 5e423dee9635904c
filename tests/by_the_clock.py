"""Tests by the clock on the wall, side by side: files of them may, but for one that needs the machine to itself.

`pytest.mark.realtime(alone=True)` says so. The processes of pytest-xdist settle it among themselves by file locks; who
waits to be alone keeps others from beginning.
"""

import fcntl
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import pytest


class Floor:
    """Shared by the files of tests that may run side by side, or one file's own; for one process of `run`."""

    def __init__(self, run: str, place: Path | None = None) -> None:
        folder = (place or Path(tempfile.gettempdir())) / f"gyrohil-tests-{run}"
        folder.mkdir(exist_ok=True)
        self._gate, self._floor = folder / "gate", folder / "floor"
        self._held: IO[str] | None = None
        self._alone: set[Path] = set()

    def note(self, items: Sequence[pytest.Item]) -> None:
        """Which files need the machine to themselves."""
        self._alone |= {
            item.path for item in items if any(m.kwargs.get("alone") for m in item.iter_markers("realtime"))
        }

    def enter(self, path: Path) -> None:
        """Wait for others where it must; nothing for a file that is there already."""
        if self._held is not None:
            return
        with self._gate.open("w") as gate:
            fcntl.flock(gate, fcntl.LOCK_EX)
            self._held = self._floor.open("w")
            fcntl.flock(self._held, fcntl.LOCK_EX if path in self._alone else fcntl.LOCK_SH)

    def leave(self) -> None:
        """The file is done."""
        if self._held is not None:
            self._held.close()
            self._held = None
