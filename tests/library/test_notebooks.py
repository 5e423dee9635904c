"""The notebooks in docs/notebooks run from the first cell to the last, and come to what their text says."""

import shutil
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
BOOKS = ROOT / "docs" / "notebooks"
RECORD = ROOT.parent / "shared" / "data" / "silverbox" / "SNLS80mV.csv.gz"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1200),  # a whole trace each
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # of the notebook's own packages
]


def output_of(name: str, place: Path) -> list[str]:
    """What each code cell of a notebook put out, as text, run at `place`."""
    book: Any = nbformat.read(BOOKS / name, as_version=4)
    NotebookClient(book, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(place)}}).execute()
    return [_text(cell) for cell in book.cells if cell.cell_type == "code"]


def _text(cell: Any) -> str:
    parts = [one.get("text") or one.get("data", {}).get("text/plain", "") for one in cell.outputs]
    return "\n".join(parts)


@pytest.mark.long
def test_a_run_and_its_trace(tmp_path: Path) -> None:
    told = "\n".join(output_of("run-and-trace.ipynb", tmp_path))
    assert "failed" in told
    assert "explained" in told
    assert "cubic_stiffness k3x" in told
    ratio = next(line for line in told.splitlines() if "of what it was" in line)
    assert float(ratio.split()[3]) < 0.7


@pytest.mark.long
def test_a_measured_record(tmp_path: Path) -> None:
    if not RECORD.exists():
        pytest.skip("the Silverbox record is not here")
    shutil.copy(RECORD, tmp_path)
    told = "\n".join(output_of("measured-record.ipynb", tmp_path))
    assert "cubic_stiffness" in told
    before, after = next(line for line in told.splitlines() if "→" in line).split("→")
    assert float(after) < float(before)
    assert (tmp_path / "silverbox.mcap").stat().st_size > 0


@pytest.mark.parametrize("name", [path.name for path in sorted(BOOKS.glob("*.ipynb"))])
def test_no_outputs_are_kept(name: str) -> None:
    book: Any = nbformat.read(BOOKS / name, as_version=4)
    assert all(not cell.outputs for cell in book.cells if cell.cell_type == "code")
