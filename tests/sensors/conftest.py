"""Adapters as a package that was just installed would bring them."""

from collections.abc import Callable
from pathlib import Path

import pytest

Install = Callable[[str, str], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """`install(name, "module:Class")`: an entry point of the group hil.boards, for the length of the test."""

    def put(name: str, target: str) -> None:
        folder = tmp_path / "site" / f"board_{name}-1.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: board-{name}\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[hil.boards]\n{name} = {target}\n")
        monkeypatch.syspath_prepend(str(folder.parent))

    return put
