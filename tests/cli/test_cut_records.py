"""A record that was cut is never used in silence: each verb says the same of it."""

import json
import re
from pathlib import Path

import pytest

from hil.records.atomic import occupied
from hil.records.capture import read_capture
from tests.cli.conftest import Hil

WHOLE = 12000


def halved(recorded: Path) -> int:
    """Cut the capture of a run to half of its bytes; the rows that are left."""
    capture = recorded / "capture.arrow"
    data = capture.read_bytes()
    capture.write_bytes(data[: len(data) // 2])
    rows = len(read_capture(capture))
    assert 0 < rows < WHOLE
    return rows


def words(rows: int) -> str:
    return f"the record was interrupted: it ends after row {rows}, without an end marker"


@pytest.mark.moderate
def test_every_verb_says_that_a_record_was_cut(hil: Hil, recorded: Path) -> None:
    code, out, err = hil("export", str(recorded), "--to", "csv", "-o", "whole.csv")
    assert "interrupted" not in out + err
    _, out, _ = hil("ls")
    assert "interrupted" not in out
    whole = (recorded / "capture.arrow").read_bytes()
    rows = halved(recorded)
    for kind in ("csv", "parquet", "mat", "mcap"):
        code, out, err = hil("export", str(recorded), "--to", kind, "-o", f"a.{kind}")
        assert (code, f"capture: {words(rows)}" in out + err) == (0, True), kind
    _, out, _ = hil("export", str(recorded / "capture.arrow"), "--to", "csv", "-o", "b.csv", "--json")
    assert json.loads(out)["cut"] == [f"capture: {words(rows)}"]
    code, out, _ = hil("ls")
    assert (code, words(rows) in out) == (0, True)
    _, out, _ = hil("ls", "--json")
    assert json.loads(out)["runs"][0]["cut"] == words(rows)
    _, out, err = hil("score", str(recorded), "--truth", "truth.arrow", "--json")
    assert f"capture.arrow: {words(rows)}" in json.loads(out)["remarks"]
    cut = (recorded / "capture.arrow").read_bytes()
    (recorded / "capture.arrow").write_bytes(whole)
    _, out, err = hil("score", str(recorded), "--truth", "truth.arrow", "--json")
    assert "interrupted" not in " ".join(json.loads(out)["remarks"])
    (recorded / "capture.arrow").write_bytes(cut)
    _, out, err = hil("replay", str(recorded / "capture.arrow"), "--bench", "short.bench.toml", "--json")
    assert json.loads(out)["reasons"][0] == words(rows)


@pytest.mark.slow
@pytest.mark.usefixtures("no_report")
def test_what_is_made_of_a_cut_record_says_so(hil: Hil, recorded: Path, short_bench: str) -> None:
    record, bench = recorded / "capture.arrow", Path(short_bench)
    bench.write_text(bench.read_text(encoding="utf-8").replace("settle_s = 2.0", "settle_s = 0.5"), encoding="utf-8")
    _, out, _ = hil("characterise", str(recorded), "--json")
    assert "interrupted" not in out
    rows = halved(recorded)
    _, out, _ = hil("characterise", str(recorded), "--json")
    assert json.loads(out)["remarks"][0] == f"{record}: {words(rows)}"
    _, out, _ = hil("compare", str(record), "--bench", short_bench, "--json", "--no-report")
    assert json.loads(out)["remarks"][0] == words(rows)


@pytest.mark.slow
def test_a_trace_says_that_its_record_was_cut(hil: Hil, recorded: Path, short_bench: str) -> None:
    rows = halved(recorded)
    record = str(recorded / "capture.arrow")
    _, out, err = hil("trace", record, "--bench", short_bench, "--no-report")
    assert words(rows) in re.sub(r"\s+", " ", out + err)


@pytest.mark.moderate
def test_a_run_without_figures_is_listed_with_what_there_is(hil: Hil, recorded: Path) -> None:
    (recorded / "result.json").unlink()
    _, out, _ = hil("ls")
    assert "no figures" in out
    assert "the record is whole: `hil replay` computes its figures" in out
    with occupied(recorded):  # as a run that goes on
        _, out, _ = hil("ls")
    assert out.split()[-3:] == ["no", "verdict", "yet"]
    rows = halved(recorded)
    _, out, _ = hil("ls")
    assert f"{words(rows)}: `hil replay` computes its figures" in out
