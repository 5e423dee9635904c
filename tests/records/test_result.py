"""result.json: its published schema, its round trip, and what is refused."""

import errno
import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from hil.errors import InputError
from hil.records.result import Parameter, Result, load_result, save_result
from hil.records.runfolder import RunFolder
from hil.records.summary import percentiles, summarise
from tests.records.synthetic_run import NOISE_V

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
PROMISED = [
    "run",
    "link",
    "clock",
    "seconds",
    "samples",
    "lost",
    "late",
    "angle_error_rms_rad",
    "rate_error_rms_rad_s",
    "parameters",
    "innovation_rms",
    "noise_floor",
    "turnaround_us",
    "diagnosis",
]


@pytest.mark.moderate
def test_every_promised_key_is_written(make_run):
    folder, _ = make_run()
    written = json.loads((folder / "result.json").read_text())
    assert written.keys() >= set(PROMISED)
    assert written["turnaround_us"].keys() == {"p50", "p99", "p999"}
    assert written["diagnosis"] is None


@pytest.mark.moderate
def test_a_summary_tells_what_the_records_hold(make_run):
    folder, _ = make_run(result=False)
    result = summarise(RunFolder(folder))
    assert (result.run, result.samples, result.lost, result.late) == ("20250314-092653-bench", 8000, 0, 4)
    assert result.seconds == pytest.approx(7999 / 4000)
    assert result.innovation_rms == pytest.approx(NOISE_V, rel=0.05)
    assert result.noise_floor == pytest.approx(NOISE_V, rel=0.02)
    assert result.turnaround_us.p50 == pytest.approx(38, rel=0.05)
    assert result.parameters["kxx"].truth is None
    assert result.complete


@pytest.mark.moderate
def test_records_that_are_not_there_leave_nulls(make_run):
    folder, _ = make_run(result=False)
    for name in ("innovation", "timing", "capture"):
        (folder / f"{name}.arrow").unlink()
    result = summarise(RunFolder(folder))
    assert (result.samples, result.complete) == (0, False)
    assert result.innovation_rms is None
    assert result.turnaround_us is None
    assert result.seconds == pytest.approx(1.9975)


def test_percentiles_of_nothing():
    assert percentiles(np.empty(0)) is None


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_figure_is_finite_or_null(value):
    with pytest.raises(ValidationError):
        Parameter(value=value, ci95=(0, 1), unit="V")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "result.json: the whole file: "),
        ("[]", "result.json: the whole file: "),
        ('{"run": "a", "samples": 1, "seconds": -1, "complete": true}', "result.json: seconds: "),
        ('{"run": "a", "samples": 1, "seconds": 1, "complete": true, "mood": 1}', "result.json: mood: "),
        ('{"run": "a"}', "result.json: seconds: "),
    ],
)
def test_a_damaged_file_is_told_with_its_key(tmp_path, text, complaint):
    path = tmp_path / "result.json"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as refusal:
        load_result(path)
    assert "\n" not in str(refusal.value)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_result(tmp_path / "result.json")


def test_writing_is_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "result.json"
    save_result(path, Result(run="first", seconds=1, samples=1, complete=True))
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError(errno.ENOSPC, "no space left on device")

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(OSError, match="no space"):
        save_result(path, Result(run="second", seconds=1, samples=1, complete=True))
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.json"]
