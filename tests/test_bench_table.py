"""`python -m benchmarks --speed`: one table at the end, also where something could not be measured."""

import json
import sys
from pathlib import Path

import pytest

from benchmarks import force_mode, speed
from benchmarks.__main__ import main
from benchmarks.row import Row, Say
from hil.errors import InputError


def measured(say: Say) -> list[Row]:
    say("going on")
    return [Row.over("a block", 1.5, "µs", "C step", [0.5, 0.75, 1.0]), Row("alone", 2.0, "µs")]


def too_busy(_: Say) -> list[Row]:
    raise InputError("the run: ended early; run again")


@pytest.mark.parametrize(("last", "code"), [(measured, 0), (too_busy, 1)])
def test_the_table_has_what_was_measured_beside_a_peer(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], last: object, code: int
) -> None:
    kept = tmp_path / "bench.json"
    kept.write_text(json.dumps([{**Row("force_mode: of before", 9.0, "s", "a peer", 3.0)._asdict()}]))
    monkeypatch.setattr(speed, "rows", measured)
    monkeypatch.setattr(force_mode, "rows", last)
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--speed", "--out", str(kept)])
    assert main() == code
    said = capsys.readouterr()
    table = [line for line in said.out.splitlines() if line.startswith("| a block")]
    assert table == ["| a block | 1.5 µs | C step | 0.75 | 0.62 to 0.88 |"] * (2 - code)
    names = [row["name"].partition(":")[0] for row in json.loads(kept.read_text())]
    assert [names.count(name) for name in ("speed", "force_mode")] == [2, 2 - 2 * code]
    assert "of before" not in said.out
    assert ("not measured: force_mode" in said.err) == bool(code)
