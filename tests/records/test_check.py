"""Whole records, damaged, cut and mixed ones; and what a repair keeps."""

import json
import shutil

import numpy as np
import pytest

from hil.cli import execute
from hil.errors import InputError
from hil.records.capture import read_capture
from hil.records.check import check, repair
from tests.records.synthetic_run import Options, write_run


def problems(place):
    return {entry.name: entry.problems for entry in check(place) if entry.problems}


def change(path, place, by=1):
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= by
    path.write_bytes(data)


@pytest.mark.moderate
def test_a_whole_run(make_run):
    folder, truth = make_run()
    assert problems(folder) == {}
    entries = {entry.name: entry for entry in check(folder)}
    assert entries["capture.arrow"].rows == 8000
    assert entries["capture.arrow"].seconds == pytest.approx(7999 / 4000)
    assert {"capture.arrow", "innovation.arrow", "estimates.arrow", "bench.toml", "result.json"} <= entries.keys()
    assert [(entry.problems, entry.remarks) for entry in check(truth)] == [([], [])]


@pytest.mark.moderate
def test_damage_is_told_with_file_and_block(make_run):
    folder, _ = make_run()
    change(folder / "innovation.arrow", 0.5)
    (line,) = problems(folder)["innovation.arrow"]
    assert line.startswith("block ")
    assert "is damaged: its checksum differs" in line


@pytest.mark.moderate
def test_a_header_that_is_damaged_is_told_in_a_folder_too(make_run):
    folder, _ = make_run()
    change(folder / "estimates.arrow", 0.0, 255)
    assert list(problems(folder)) == ["estimates.arrow"]


@pytest.mark.moderate
def test_an_interrupted_run_is_told(make_run):
    folder, _ = make_run(interrupted=True)
    found = problems(folder)
    assert found["capture.arrow"] == ["interrupted: it ends after row 8000, without an end marker"]


@pytest.mark.moderate
def test_files_of_two_runs_are_told(make_run, tmp_path):
    folder, _ = make_run()
    write_run(tmp_path / "longer", Options(seconds=3.0))
    write_run(tmp_path / "faster", Options(rate_Hz=5000.0))
    shutil.copy(tmp_path / "longer" / "innovation.arrow", folder)
    shutil.copy(tmp_path / "faster" / "estimates.arrow", folder)
    found = problems(folder)
    assert "ticks 0 to 11999, the capture 0 to 7999" in found["innovation.arrow"][0]
    assert "of 5000 samples a second, the capture of 4000" in found["estimates.arrow"][0]
    shutil.copy(tmp_path / "longer" / "result.json", folder)
    assert problems(folder)["result.json"] == ["speaks of 12000 samples, the capture has 8000: of another run"]


def test_gaps_are_counted(tmp_path):
    from hil.records.capture import board_layout
    from hil.records.stream import BlockWriter

    layout = board_layout(tick_rate_Hz=1000.0, axes=2, latency_ticks=1, sense_scale_V=1.0, drive_scale=1.0)
    rows = np.zeros(1000, layout.dtype)
    rows["tick"] = np.arange(1000) + 5 * (np.arange(1000) >= 300) + 7 * (np.arange(1000) >= 800)
    with BlockWriter(tmp_path / "capture.arrow", layout) as writer:
        writer.push(rows)
    (entry,) = check(tmp_path / "capture.arrow")
    assert (entry.lost, entry.gaps, entry.problems) == (12, 2, [])
    assert entry.remarks == ["12 samples are missing, in 2 gaps"]


@pytest.mark.moderate
def test_a_repair_keeps_the_blocks_before_the_damage_and_the_original(make_run):
    folder, _ = make_run()
    path = folder / "capture.arrow"
    whole = read_capture(path)
    change(path, 0.6)
    damaged = path.read_bytes()
    kept = repair(path)
    assert kept == folder / "capture.repaired.arrow"
    assert path.read_bytes() == damaged
    record = read_capture(kept)
    assert 0.4 * 8000 < len(record) < 0.6 * 8000
    assert len(record) % 1024 == 0
    assert not record.complete
    np.testing.assert_array_equal(record.sense_V, whole.sense_V[: len(record)])
    with pytest.raises(InputError, match="exists already"):
        repair(path)


@pytest.mark.slow
def test_a_run_is_repaired_into_a_folder_of_its_own(make_run):
    folder, _ = make_run()
    change(folder / "capture.arrow", 0.6)
    data = (folder / "estimates.arrow").read_bytes()
    (folder / "estimates.arrow").write_bytes(data[: len(data) // 2])
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    kept = repair(folder)
    assert kept.name == f"{folder.name}-repaired"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert not (kept / "result.json").exists()
    assert (kept / "innovation.arrow").read_bytes() == before["innovation.arrow"]
    assert all("interrupted" in line or "of another run" in line for lines in problems(kept).values() for line in lines)
    assert execute(["score", str(kept), "--truth", str(folder.parent / f"{folder.name}-truth.arrow")]) in (0, 1)


@pytest.mark.moderate
def test_what_cannot_be_repaired(make_run, tmp_path):
    folder, _ = make_run()
    with pytest.raises(InputError, match="nothing to repair"):
        repair(folder)
    path = folder / "capture.arrow"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match="cut inside its header"):
        repair(path)
    with pytest.raises(InputError, match="no record in it"):
        check(tmp_path)


@pytest.mark.moderate
def test_the_command_line(make_run, capsys):
    folder, _ = make_run()
    assert execute(["check", str(folder)]) == 0
    assert "capture.arrow" in capsys.readouterr().out
    change(folder / "capture.arrow", 0.5)
    assert execute(["check", str(folder), "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert not told["whole"]
    assert [file["name"] for file in told["files"] if not file["whole"]] == ["capture.arrow"]
    assert execute(["check", str(folder), "--repair"]) == 1
    assert f"{folder.name}-repaired" in capsys.readouterr().err
    assert execute(["check", str(folder / "gone.arrow")]) == 2
    assert execute(["check", str(folder), "--out", "x"]) == 2
    assert all("\n" not in line for line in capsys.readouterr().err.splitlines())


@pytest.mark.moderate
@pytest.mark.parametrize("verb", ["replay", "export", "score"])
def test_a_damaged_record_is_refused_by_every_verb_in_one_line(make_run, capsys, verb):
    folder, truth = make_run()
    change(folder / "capture.arrow", 0.5)
    more = {"replay": ["--bench", "s-slow"], "export": ["-o", str(folder / "x.csv")], "score": ["--truth", str(truth)]}
    assert execute([verb, str(folder), *more[verb]]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "capture.arrow: block " in line
    assert "is damaged: its checksum differs; hil check --repair keeps the" in line
