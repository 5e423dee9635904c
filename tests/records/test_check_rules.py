"""`hil check` and `--repair`, promise by promise: docs/reference/run-folder.md (Blocks and checksums)."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.errors import InputError
from hil.records.capture import board_layout
from hil.records.check import Checked, check, repair
from hil.records.estimates import estimates_layout, innovation_layout
from hil.records.layout import Layout
from hil.records.stream import BlockWriter

RATE_HZ = 1000.0


def layout_of(stem: str, rate_Hz: float = RATE_HZ, every: int = 1) -> Layout:
    if stem == "capture":
        return board_layout(tick_rate_Hz=rate_Hz, axes=2, latency_ticks=1, sense_scale_V=1.0, drive_scale=1.0)
    if stem == "innovation":
        return innovation_layout(tick_rate_Hz=rate_Hz, axes=2)
    return estimates_layout(("x_m",), tick_rate_Hz=rate_Hz, every=every, angle=False)


def write(folder: Path, stem: str, ticks: Any, *, whole: bool = True, **layout: Any) -> Path:
    """A record of these ticks; not `whole`: its writer was interrupted."""
    folder.mkdir(exist_ok=True)
    made = layout_of(stem, **layout)
    rows = np.zeros(len(ticks), made.dtype)
    rows["tick"] = ticks
    path = folder / f"{stem}.arrow"
    writer = BlockWriter(path, made)
    writer.push(rows)
    writer.__exit__(*((None, None, None) if whole else (KeyboardInterrupt, None, None)))
    return path


def entries(folder: Path) -> dict[str, Checked]:
    return {entry.name: entry for entry in check(folder)}


def problems(folder: Path) -> dict[str, list[str]]:
    return {name: entry.problems for name, entry in entries(folder).items() if entry.problems}


def damage(path: Path, place: float = 0.5) -> None:
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("every", [1, 10])
def test_a_whole_record_has_its_length_and_no_gap(tmp_path: Path, every: int) -> None:
    """Estimates of every tenth sample have no gaps for that."""
    write(tmp_path, "capture", range(500, 2501))
    write(tmp_path, "estimates", range(500, 2501, every), every=every)
    found = entries(tmp_path)
    for name in ("capture.arrow", "estimates.arrow"):
        entry = found[name]
        assert (entry.seconds, entry.lost, entry.gaps, entry.problems, entry.remarks) == (2.0, 0, 0, [], [])
        assert entry.whole
        assert entry.complete
    assert found["estimates.arrow"].rows == 2000 // every + 1


@pytest.mark.parametrize("stem", ["capture", "innovation"])
def test_what_is_missing_is_counted_and_not_held_against_it(tmp_path: Path, stem: str) -> None:
    ticks = [*range(10), *range(11, 20), *range(25, 30)]
    (entry,) = check(write(tmp_path, stem, ticks))
    assert (entry.rows, entry.lost, entry.gaps, entry.problems) == (24, 6, 2, [])
    assert entry.remarks == ["6 samples are missing, in 2 gaps"]
    assert entry.seconds == pytest.approx(29 / RATE_HZ)


@pytest.mark.parametrize("stem", ["capture", "innovation", "estimates"])
@pytest.mark.parametrize(("ticks", "back"), [([0, 1, 1, 2], 1), ([0, 5, 3, 4, 2], 2)])
def test_rows_that_do_not_come_after_one_another_are_held_against_it(
    tmp_path: Path, stem: str, ticks: list[int], back: int
) -> None:
    (entry,) = check(write(tmp_path, stem, ticks))
    assert entry.problems == [f"{back} rows do not come after the one before them"]
    assert not entry.whole


@pytest.mark.parametrize(
    ("first", "last", "wrong"),
    [(100, 200, False), (100, 150, False), (120, 200, False), (99, 200, True), (100, 201, True), (300, 400, True)],
)
@pytest.mark.parametrize("stem", ["innovation", "estimates"])
def test_what_was_estimated_lies_within_what_was_captured(
    tmp_path: Path, stem: str, first: int, last: int, wrong: bool
) -> None:
    write(tmp_path, "capture", range(100, 201))
    write(tmp_path, stem, range(first, last + 1))
    words = f"ticks {first} to {last}, the capture 100 to 200: of another run, or rows of one are missing"
    assert problems(tmp_path) == ({f"{stem}.arrow": [words]} if wrong else {})


def test_an_interrupted_capture_may_end_before_what_was_estimated(tmp_path: Path) -> None:
    write(tmp_path, "capture", range(100, 201), whole=False)
    write(tmp_path, "estimates", range(100, 301))
    assert list(problems(tmp_path)) == ["capture.arrow"]
    write(tmp_path, "estimates", range(50, 301))
    assert "estimates.arrow" in problems(tmp_path)


@pytest.mark.parametrize(("rate_Hz", "wrong"), [(RATE_HZ, False), (1.01 * RATE_HZ, True), (0.99 * RATE_HZ, True)])
def test_files_of_one_run_have_one_rate(tmp_path: Path, rate_Hz: float, wrong: bool) -> None:
    write(tmp_path, "capture", range(100))
    write(tmp_path, "innovation", range(100), rate_Hz=rate_Hz)
    found = problems(tmp_path)
    assert list(found) == (["innovation.arrow"] if wrong else [])
    if wrong:
        assert found["innovation.arrow"][0].startswith(f"of {rate_Hz:g} samples a second, the capture of 1000")


def result(folder: Path, samples: int, complete: bool) -> None:
    about = {"version": 2, "run": folder.name, "seconds": 0.1, "samples": samples, "complete": complete}
    (folder / "result.json").write_text(json.dumps(about))


@pytest.mark.parametrize(
    ("samples", "says", "whole", "words"),
    [
        (100, True, True, ""),
        (100, False, True, ""),
        (100, False, False, ""),
        (101, True, True, "speaks of 101 samples, the capture has 100: of another run"),
        (100, True, False, "speaks of a complete record, the capture is not"),
    ],
)
def test_figures_speak_of_the_record_beside_them(
    tmp_path: Path, samples: int, says: bool, whole: bool, words: str
) -> None:
    write(tmp_path, "capture", range(100), whole=whole)
    result(tmp_path, samples, says)
    assert problems(tmp_path).get("result.json", []) == ([words] if words else [])


def test_of_a_damaged_capture_the_rows_say_nothing_of_the_figures(tmp_path: Path) -> None:
    damage(write(tmp_path, "capture", range(100)))
    result(tmp_path, 100, True)
    assert list(problems(tmp_path)) == ["capture.arrow"]


def test_texts_that_are_none_are_told(tmp_path: Path) -> None:
    write(tmp_path, "capture", range(100))
    (tmp_path / "bench.toml").write_text("[device\n")
    (tmp_path / "result.json").write_text("{")
    found = problems(tmp_path)
    assert found["bench.toml"][0].startswith("not TOML (")
    assert len(found["result.json"]) == 1
    assert str(tmp_path) not in found["result.json"][0]


def test_a_file_that_is_no_record_is_refused_alone(tmp_path: Path) -> None:
    write(tmp_path, "capture", range(100))
    (tmp_path / "estimates.arrow").write_text("no Arrow stream at all, by any means")
    assert list(problems(tmp_path)) == ["estimates.arrow"]
    with pytest.raises(InputError, match=r"estimates\.arrow"):
        check(tmp_path / "estimates.arrow")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no record in it"):
        check(tmp_path / "empty")


# -------------------------------------------------------------------------------------------------------------- repair


def test_a_repair_keeps_every_whole_block_and_reads_as_interrupted(tmp_path: Path) -> None:
    path = write(tmp_path, "capture", range(10_000))
    damage(path, 0.7)
    before = path.read_bytes()
    (found,) = check(path)
    kept = repair(path)
    assert path.read_bytes() == before
    (entry,) = check(kept)
    assert entry.rows == found.rows > 5000
    assert entry.problems == [f"interrupted: it ends after row {found.rows}, without an end marker"]
    assert before.startswith(kept.read_bytes())


def test_an_interrupted_record_may_be_repaired_and_a_whole_one_not(tmp_path: Path) -> None:
    cut = write(tmp_path / "a", "capture", range(3000), whole=False)
    assert check(repair(cut, tmp_path / "kept.arrow"))[0].rows == 3000
    with pytest.raises(InputError, match="nothing to repair"):
        repair(write(tmp_path / "b", "capture", range(3000)))


@pytest.mark.moderate
def test_repair_of_one_broken_file_keeps_the_others(tmp_path: Path) -> None:
    run = tmp_path / "run"
    damage(write(run, "capture", range(10_000)), 0.7)
    whole = write(run, "innovation", range(4000))
    (run / "estimates.arrow").write_text("no record")
    (run / "bench.toml").write_text("[loop]\n")
    (run / "notes").mkdir()
    (run / "report.html").write_text("<p>")
    result(run, 10_000, True)
    kept = repair(run)
    assert kept == tmp_path / "run-repaired"
    assert sorted(path.name for path in kept.iterdir()) == ["bench.toml", "capture.arrow", "innovation.arrow"]
    assert (kept / "innovation.arrow").read_bytes() == whole.read_bytes()
    with pytest.raises(InputError, match="exists already"):
        repair(run)
    shutil.rmtree(kept)
    assert repair(run, tmp_path / "elsewhere") == tmp_path / "elsewhere"


def test_where_the_header_is_damaged_nothing_can_be_kept(tmp_path: Path) -> None:
    path = write(tmp_path, "capture", range(100))
    damage(path, 0.02)
    with pytest.raises(InputError):
        repair(path, tmp_path / "kept.arrow")
    assert not (tmp_path / "kept.arrow").exists()
