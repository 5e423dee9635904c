"""What is generated from the spec is written where one says, else where it belongs, and is what is committed."""

import runpy
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRITTEN = {
    "docs": ("docs", ("wire.md", "safety.md", "reference/field-table.tsv")),
    "golden": ("tests/wire/golden.json", ("",)),
    "c_header": ("firmware/src", ("hil_spec.h", "hil_spec.c")),
    "dbc": ("firmware/gyrohil.dbc", ("",)),
}


def generate(monkeypatch: pytest.MonkeyPatch, name: str, *arguments: str) -> None:
    module = f"hil.wire.generate.{name}"
    monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    runpy.run_module(module, run_name="__main__")


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("name", list(WRITTEN))
def test_what_is_written_is_what_is_committed(
    name: str, named: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, files = WRITTEN[name]
    there = Path("elsewhere") / Path(place).name if named else Path(place)
    (tmp_path / there).parent.mkdir(parents=True, exist_ok=True)
    if files != ("",):
        (tmp_path / there / "reference").mkdir(parents=True)
    if name == "docs":
        page = (ROOT / "docs" / "safety.md").read_text(encoding="utf-8")
        begin, end = page.index("<!-- transitions -->"), page.index("<!-- /transitions -->")
        (tmp_path / there / "safety.md").write_text(page[: begin + 20] + "\n\nold\n\n" + page[end:], encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    generate(monkeypatch, name, *([str(there)] if named else []))
    for file in files:
        assert (tmp_path / there / file).read_bytes() == (ROOT / place / file).read_bytes(), file
    shutil.rmtree(tmp_path / there.parts[0])
    assert not list(tmp_path.iterdir())  # and nothing elsewhere


@pytest.mark.parametrize("name", list(WRITTEN))
def test_what_is_imported_writes_nothing(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, f"hil.wire.generate.{name}", raising=False)
    runpy.run_module(f"hil.wire.generate.{name}", run_name="imported")
    assert not list(tmp_path.iterdir())
