"""The Python of the README, word for word."""

import re
from pathlib import Path
from typing import Any

import pytest

import hil
from benchmarks import readme
from hil.bench import examples
from hil.errors import InputError
from tests.cli.conftest import in_lockstep

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
FIND = examples.find


@pytest.mark.long
@pytest.mark.timeout(900)  # a whole trace
def test_the_block_of_the_readme_does_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    short = tmp_path / "s-undeclared.bench.toml"  # five seconds show the effect as well as the example's length
    short.write_text(in_lockstep("s-undeclared", duration_s=5.0, settle_s=2.0), encoding="utf-8")
    monkeypatch.setattr(
        examples, "find", lambda kind, name, **places: short if kind == "bench" else FIND(kind, name, **places)
    )
    monkeypatch.chdir(tmp_path)
    shown: dict[str, Any] = {}
    exec(compile(block, "README.md", "exec"), shown)
    run, trace, better = shown["run"], shown["trace"], shown["better"]
    assert run.bench.loop.duration_s == 5.0
    assert trace.verdict == "explained"
    assert trace.report().exists()
    assert len(trace.plot().axes) == 2
    assert hil.load_trace(trace.path).diagnosis == trace.diagnosis
    assert [effect.name for effect in trace.effects] == ["cubic_stiffness"]
    assert better.bench.effects.named.keys() == {"cubic_stiffness"}
    assert better.innovation.since(2.0).values.std() < 0.7 * run.innovation.since(2.0).values.std()
    assert capsys.readouterr().out.startswith("explained [")


FIGURES = {"angle_error_rms_rad": 0.522, "rate_error_rms_rad_s": 0.279, "score": {"turns": 1.71}}
COEFFICIENTS = {
    "k3x": {"value": 10.0004e12, "ci95": [9.9996e12, 10.0012e12], "unit": "1/(m²·s²)"},
    "k3y": {"value": 2.9999e12, "ci95": [2.9997e12, 3.0001e12], "unit": "1/(m²·s²)"},
}
DIAGNOSIS = {
    "held_out": {"before": {"ratio": 2.496}, "after": {"ratio": 1.008}},
    "effects": [{"name": "cubic_stiffness", "coefficients": COEFFICIENTS}],
}
FOUND = readme.Found(FIGURES, DIAGNOSIS, FIGURES | {"angle_error_rms_rad": 0.00092}, {"k3x": 10e12, "k3y": 3e12})


def test_the_table_is_made_of_the_figures() -> None:
    assert readme.table(FOUND).splitlines()[2:] == [
        "| residual over noise floor, on the part held out | 2.50 | 1.01 |",
        "| angle error, rms, in 1.7 rotations | 522 mrad | 0.92 mrad |",
        "| rate error, rms | 0.279 rad/s | 0.279 rad/s |",
        "| found: cubic stiffness k3x, k3y / 10¹² 1/(m²·s²), truth 10 and 3 |  | 10.00040 ± 0.00080, "
        "2.99990 ± 0.00020 |",
    ]


def test_the_table_of_the_readme_is_one_that_the_command_writes() -> None:
    """In all but its digits, and under the commands that it is made by."""
    begin, end = README.index(readme.BEGIN) + len(readme.BEGIN), README.index(readme.END)
    written, made = (re.sub(r"\d+(\.\d+)?", "#", rows.strip()) for rows in (README[begin:end], readme.table(FOUND)))
    assert written == made
    verbs = [words[:3] for words in readme.commands(README)]
    assert verbs == [
        ["hil", "run", "s-undeclared"],
        ["hil", "trace", "last"],
        ["hil", "run", "better.bench.toml"],
    ]
    rows = readme.table(FOUND)
    assert readme.with_table(readme.with_table(README, rows), rows) == readme.with_table(README, rows)
    with pytest.raises(InputError, match="no block of hil commands"):
        readme.commands("nothing")
