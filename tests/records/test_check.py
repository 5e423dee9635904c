"""Whole records, damaged, cut and mixed ones; and what a repair keeps."""

import json

import pytest

from hil.cli import execute
from hil.records.check import check, repair


def problems(place):
    return {entry.name: entry.problems for entry in check(place) if entry.problems}


def change(path, place, by=1):
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= by
    path.write_bytes(data)


@pytest.mark.moderate
def test_damage_is_told_with_file_and_block(make_run):
    folder, _ = make_run()
    change(folder / "innovation.arrow", 0.5)
    (line,) = problems(folder)["innovation.arrow"]
    assert line.startswith("block ")
    assert "is damaged: its checksum differs" in line


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
