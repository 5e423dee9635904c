"""A package beside the bench, as pip would install it: for this process and for those it starts."""

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Install = Callable[[str, str, str, str], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Installs a module of that text with one entry point: group, name, object of the module, text."""
    site = tmp_path / "site"

    def put(group: str, name: str, target: str, text: str) -> None:
        folder = site / f"brought_{name}-1.0.dist-info"
        folder.mkdir(parents=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: brought-{name}\nVersion: 1.0\n")
        (folder / "entry_points.txt").write_text(f"[{group}]\n{name} = brought_{name}:{target}\n")
        (site / f"brought_{name}.py").write_text(text)
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, f"brought_{name}", raising=False)  # of the test before
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]))

    return put
