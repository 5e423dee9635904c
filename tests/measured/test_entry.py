"""`python -m evaluation.measured` without any record: what it says, keeps and writes."""

import json
import subprocess
import sys

import numpy as np
import pytest

from estimator.diagnosis import Verdict
from evaluation.measured.__main__ import keep
from evaluation.measured.outcome import MeasuredRow, Outcome, rms, verdict_of
from evaluation.measured.page import write_page

ROW = MeasuredRow("box", "test", "free-run RMSE", "mV", 7.0, 0.25, "explained", ["cubic_stiffness"])


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "evaluation.measured", *arguments], capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_a_folder_that_is_not_there_is_one_line(tmp_path):
    done = run("--data", str(tmp_path / "none"), "--out", str(tmp_path / "m.json"))
    assert done.returncode == 2
    assert "no such folder; say where the records are with --data or GYROHIL_DATA" in done.stderr
    assert not (tmp_path / "m.json").exists()


@pytest.mark.slow
def test_absent_records_are_named_and_nothing_is_written_over(tmp_path):
    (tmp_path / "m.json").write_text(json.dumps([ROW._asdict()]))
    page = tmp_path / "measured.md"
    page.write_text("as it was")
    done = run("emps", "--data", str(tmp_path), "--out", str(tmp_path / "m.json"), "--page", str(page))
    assert done.returncode == 1
    assert f"emps: skipped, {tmp_path / 'emps'} is not there" in done.stderr
    assert json.loads((tmp_path / "m.json").read_text()) == [ROW._asdict()]
    assert page.read_text() == "as it was"


def test_rows_of_a_record_replace_its_old_ones(tmp_path):
    path = tmp_path / "runs" / "m.json"
    keep(path, [Outcome("Box", [ROW], [])])
    keep(path, [Outcome("Other", [ROW._replace(record="other")], [])])
    keep(path, [Outcome("Box", [ROW._replace(after=0.2)], [])])
    assert [(row["record"], row["after"]) for row in json.loads(path.read_text())] == [("other", 0.25), ("box", 0.2)]


@pytest.mark.parametrize(
    ("before", "after", "effects", "verdict"),
    [
        (1.1, 1.1, [], Verdict.ADEQUATE),
        (9.0, 9.0, [], Verdict.UNEXPLAINED),
        (9.0, 1.1, ["a"], Verdict.EXPLAINED),
        (9.0, 1.2, ["a"], Verdict.PARTLY),
        (90.0, 20.0, ["a"], Verdict.PARTLY),
        (90.0, 70.0, ["a"], Verdict.UNEXPLAINED),
        (0.9, 1.0, ["a"], Verdict.UNEXPLAINED),
    ],
)
def test_verdict_by_what_is_left(before, after, effects, verdict):
    assert verdict_of(before, after, 1.0, effects) is verdict


def test_the_page_holds_table_and_words(tmp_path):
    write_page(tmp_path / "docs" / "measured.md", [Outcome("Box", [ROW, ROW], ["Some words."], 12.3)])
    text = (tmp_path / "docs" / "measured.md").read_text()
    assert "| box | test | free-run RMSE, mV | 7 | 0.25 | explained | cubic_stiffness | 12 |" in text
    assert "| box | test | free-run RMSE, mV | 7 | 0.25 | explained | cubic_stiffness |  |" in text  # once a record
    assert text.endswith("\n## Box\n\nSome words.\n")


def test_rms_leaves_out_what_is_no_number():
    assert rms(np.array([3.0, np.nan, -3.0])) == 3.0
