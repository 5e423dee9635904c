"""Numbers look alike on page and terminal: powers of ten as print sets them, never as a computer writes them."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
import typer

from estimator import diagnosis as traced
from estimator.written import gains, significant
from hil.cli.show import finish
from hil.cli.show_diagnosis import print_diagnosis
from hil.records.diagnosis import to_model
from hil.records.result import Parameter, load_result, save_result
from hil.report.page import write_report
from hil.scoring.score import score
from tests.records.synthetic_run import Options, write_run
from tests.records.test_diagnosis import answer, written

pytestmark = pytest.mark.slow  # whole pages


def as_a_computer_writes(text: str) -> list[str]:
    """Numbers such as 5.3e+07, with what stands before; of a page without styles, listings and paths of drawings."""
    text = re.sub(r"<style>.*?</style>|<pre.*?</pre>|<[^>]*>", " ", text, flags=re.DOTALL)
    return re.findall(r".{0,40}\de[+-]?\d.{0,10}", text)


def lost_and_beaten() -> traced.Diagnosis:
    """One that was carried in vain, and one that lost by a great deal: reasons with long numbers."""
    rejected = tuple(
        traced.Rejected(name, f"it {gains(gain)}", {}, 6e4, gain)
        for name, gain in (("quintic", 5.321e7), ("drag", -8.7e8))
    )
    return replace(answer(), rejected=rejected, angle_moved=5.5e-9)


def test_of_a_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = lost_and_beaten()
    assert as_a_computer_writes(written(tmp_path, found)) == []
    print_diagnosis(to_model(found, record="ride", bench="S-test"))
    out = capsys.readouterr().out
    assert as_a_computer_writes(out) == []
    assert "it raises 2 ln L by 5.32 × 10⁷" in out
    assert "%" not in re.sub(r"\u00a0%|95 %", "", out)  # one style for per cent
    assert significant(123_456.0) == "123\u202f000"


@pytest.mark.long
def test_of_a_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "20250314-092653-bench"
    truth = write_run(folder, Options())
    result = score(folder, truth)
    form = Parameter(value=1.000211e13, ci95=(1.0e13, 1.0004e13), unit="1/(m²·s²)", truth=9.999407e12)
    known = result.parameters | {"k3x": form, "t": Parameter(value=2e-7, ci95=(1e-7, 3e-7), unit="s")}
    save_result(folder / "result.json", load_result(folder / "result.json").model_copy(update={"parameters": known}))
    assert as_a_computer_writes(write_report(folder, truth).read_text(encoding="utf-8")) == []
    with pytest.raises(typer.Exit):
        finish(folder, as_json=False)
    out = capsys.readouterr().out
    assert as_a_computer_writes(out) == []
    (row,) = [line.split() for line in out.splitlines() if line.startswith("k3x")]
    assert row == ["k3x", "10.0021", "10.0000", "10.0040", "9.9994", "10¹²", "1/(m²·s²)"]
    (row,) = [line.split() for line in out.splitlines() if line.startswith("phi_x")]
    assert row[-1] == "mV"
    assert "%" not in re.sub(r"\u00a0%|95 %", "", out)  # one style for per cent
