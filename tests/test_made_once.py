"""What processes of a test run share is made by one of them, whole."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.made_once import made_once


class Places:
    """`tmp_path_factory` of one process of several."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self._folder = folder

    def getbasetemp(self) -> Path:
        return self._folder


def test_one_makes_it_and_all_have_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTEST_XDIST_WORKER", "gw0")
    made: list[Path] = []

    def make(folder: Path) -> None:
        made.append(folder)
        (folder / "file").write_text("whole")

    processes = [Places(tmp_path / f"popen-gw{number}") for number in range(4)]
    with ThreadPoolExecutor(len(processes)) as pool:
        folders = list(pool.map(lambda place: made_once(place, "thing", make), processes))  # type: ignore[arg-type]
    assert len(made) == 1
    assert set(folders) == {tmp_path / "thing"}
    assert (folders[0] / "file").read_text() == "whole"


def test_what_was_half_made_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    place = Places(tmp_path / "alone")

    def fail(folder: Path) -> None:
        (folder / "half").touch()
        raise OSError("full")

    with pytest.raises(OSError, match="full"):
        made_once(place, "thing", fail)  # type: ignore[arg-type]
    folder = made_once(place, "thing", lambda folder: (folder / "whole").touch())  # type: ignore[arg-type]
    assert folder == tmp_path / "alone" / "thing"
    assert [file.name for file in folder.iterdir()] == ["whole"]
