"""Generated files are as the declarations have them, and pages say the program's numbers in their text."""

import shutil
from pathlib import Path

import pytest
from pydantic import Field, create_model

from tools.__main__ import main
from tools.generated import PAGES, SAID, WHOLE, text_of
from tools.markdown import filled, keys_table, table
from tools.schemas import schema_of

ROOT = Path(__file__).parents[1]
NAMES = [*PAGES, *WHOLE]


@pytest.mark.moderate
@pytest.mark.parametrize("name", NAMES)
def test_a_generated_file_is_current(name: str) -> None:
    now = (ROOT / name).read_text(encoding="utf-8")
    assert now == text_of(name, now), "run: python -m tools"
    assert all(f"<!-- generated: {part} -->" in now for part in PAGES.get(name, ()))


@pytest.mark.parametrize("name", ["bench", "campaigns", "maps", "scenario"])
def test_every_key_of_a_file_says_what_it_means(name: str) -> None:
    assert "|  |" not in (ROOT / "docs" / "reference" / f"{name}.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SAID)
def test_a_page_says_the_numbers_of_the_program(name: str) -> None:
    page = " ".join((ROOT / name).read_text(encoding="utf-8").split())
    assert [one for one in SAID[name]() if one not in page] == []


@pytest.mark.moderate
def test_what_has_changed_is_written_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in NAMES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    old = tmp_path / "docs" / "safety.md"
    page = old.read_text(encoding="utf-8")
    old.write_text(filled(page, {"state_table": lambda: "old"}), encoding="utf-8")
    main(tmp_path)
    assert capsys.readouterr().out == "docs/safety.md\n"
    assert old.read_text(encoding="utf-8") == page
    main(tmp_path)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("least", [1, 1.0])
def test_a_limit_is_written_one_way(least: float) -> None:
    """Python may take either for the other, by which of two equal annotations it came to first."""
    assert '"exclusiveMinimum": 1,\n' in schema_of(create_model("Model", key=(float, Field(gt=least))))


def test_a_key_is_shown_as_a_file_has_it() -> None:
    assert "| `outside` | number | – | what it is |" in keys_table(
        create_model("Model", inside_kg=(float | None, Field(None, alias="outside", description="what it is")))
    )


def test_a_bar_in_a_cell_is_no_bar_of_the_table() -> None:
    assert table(("a", "b"), [("|x|", 1)]) == "| a | b |\n| --- | --- |\n| \\|x\\| | 1 |"
