"""The folder of a campaign: nothing lost, nothing twice, the same bytes whatever happened on the way."""

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from hil.errors import InputError
from hil.sweeping import kept as keeping
from hil.sweeping.columns import schema
from hil.sweeping.kept import Kept, read_rows
from hil.sweeping.tasks import Done
from tests.campaigns.conftest import bytes_in
from tests.campaigns.small import plan, small

PROGRAM = "a program"


def done(run: int, attempt: int = 0) -> Done:
    """A row as a run of that number would give it: figures by the number alone, another wall time each time."""
    row = {"outcome": "ran", "reason": None, "samples": 1600, "angle_error_rms_rad": 1e-3 / (run + 1), "nees": None}
    return Done(run, row, {"seconds": 1.0 + attempt, "host": "h", "pid": attempt})


def fill(folder: Path, runs: Sequence[int], attempt: int = 0) -> None:
    with Kept.opened(folder, plan(), PROGRAM) as kept:
        for run in runs:
            kept.add(done(run, attempt))


@pytest.fixture
def whole(tmp_path: Path) -> dict[str, bytes]:
    fill(tmp_path / "whole", range(8))
    return bytes_in(tmp_path / "whole")


@pytest.mark.parametrize("mark", ["result.json", "estimates.arrow", "diagnosis.json", "comparison.json"])
def test_no_campaign_is_made_where_a_run_is(tmp_path: Path, mark: str) -> None:
    for name in (mark, "report.html"):
        (tmp_path / name).write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"is there, and its report would be replaced; give another --out"):
        fill(tmp_path, [0])
    assert {file.name for file in tmp_path.iterdir()} == {mark, "report.html"}


def test_where_no_folder_can_be_made_is_told_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    for place in ("file", "file/below"):
        with pytest.raises(InputError, match=rf"{place}: no folder can be made there \(.+\); give another --out"):
            fill(tmp_path / place, [0])


@pytest.mark.moderate
def test_results_are_three_files_with_all_rows_in_order(tmp_path: Path, whole: dict[str, bytes]) -> None:
    assert list(whole) == [f"results/file=0000{k}/rows.parquet" for k in range(3)]
    table = read_rows(tmp_path / "whole", schema(plan().campaign))
    assert table["run"].to_pylist() == list(range(8))
    assert table["angle_error_rms_rad"].to_pylist() == [1e-3 / (run + 1) for run in range(8)]
    assert table["noise_V"].to_pylist() == [3e-5] * 4 + [9e-4] * 4
    assert table["seed"].to_pylist() == [one.seed for one in plan().runs()]
    assert not (tmp_path / "whole" / "journal.jsonl").exists()


@pytest.mark.moderate
def test_a_damaged_file_is_named_and_its_runs_are_made_again(tmp_path: Path, whole: dict[str, bytes]) -> None:
    """Cut off, or one bit of it another, wherever it may be: told, or of no consequence."""
    folder, columns = tmp_path / "whole", schema(plan().campaign)
    first = folder / "results" / "file=00000" / "rows.parquet"
    good, generator = read_rows(folder, columns), np.random.default_rng(5)
    data, told = first.read_bytes(), list[str]()
    for position in generator.integers(0, len(data), 150):
        flipped = bytearray(data)
        flipped[position] ^= 1 << int(generator.integers(8))
        first.write_bytes(flipped)
        try:
            assert read_rows(folder, columns).equals(good)
        except InputError as damage:
            told.append(str(damage))
    assert len(told) > 50
    assert all(line.startswith(f"{first}: damaged (") for line in told)
    first.write_bytes(data[:5000])
    with pytest.raises(InputError, match=r"rows\.parquet: damaged .+; remove it, and hil sweep makes its runs again"):
        read_rows(folder, columns)
    first.unlink()
    fill(folder, range(3))
    assert bytes_in(folder) == whole


@pytest.mark.moderate
@pytest.mark.parametrize("seed", range(5))
def test_any_order_and_any_number_of_ends_give_the_same_bytes(
    tmp_path: Path, whole: dict[str, bytes], seed: int
) -> None:
    generator = np.random.default_rng(seed)
    folder = tmp_path / "cut"
    attempt = 0
    while True:
        attempt += 1
        with Kept.opened(folder, plan(), PROGRAM) as kept:
            waiting = generator.permutation(list(kept.to_do()))[: generator.integers(1, 4)]
            for run in waiting:
                assert kept.add(done(int(run), attempt))
                assert not kept.add(done(int(run), attempt + 100))
        if not len(waiting):
            break
    assert bytes_in(folder) == whole
    runs = [json.loads(line)["run"] for line in (folder / "wall.jsonl").read_text().splitlines()]
    assert sorted(runs) == list(range(8))


@pytest.mark.moderate
def test_a_kill_at_any_byte_of_the_journal_loses_that_line_alone(tmp_path: Path, whole: dict[str, bytes]) -> None:
    fill(tmp_path / "half", [0, 1, 3, 4, 6])  # no file is full
    journal = (tmp_path / "half" / "journal.jsonl").read_bytes()
    ends = [place + 1 for place, byte in enumerate(journal) if byte == 10]
    assert len(ends) == 5
    for cut in (0, 1, ends[0] - 1, ends[0], ends[1] + 7, ends[3] - 1, len(journal) - 1):
        folder = tmp_path / f"cut-{cut}"
        shutil.copytree(tmp_path / "half", folder)
        (folder / "journal.jsonl").write_bytes(journal[:cut])
        with Kept.opened(folder, plan(), PROGRAM) as kept:
            there = sum(end <= cut for end in ends)
            assert kept.missing == 8 - there
            for run in list(kept.to_do()):
                kept.add(done(run, 1))
        assert bytes_in(folder) == whole


@pytest.mark.moderate
def test_rows_that_are_in_a_file_and_still_in_the_journal_are_there_once(
    tmp_path: Path, whole: dict[str, bytes]
) -> None:
    fill(tmp_path / "a", [0, 1])
    early = (tmp_path / "a" / "journal.jsonl").read_bytes()
    fill(tmp_path / "a", [2, 5])
    with (tmp_path / "a" / "journal.jsonl").open("ab") as journal:  # a kill between the file and the journal
        journal.write(early)
    (tmp_path / "a" / "results" / "file=00001").mkdir()
    (tmp_path / "a" / "results" / "file=00001" / ".rows.parquet.x.part").write_bytes(b"torn")
    fill(tmp_path / "a", [3, 4, 6, 7])
    assert bytes_in(tmp_path / "a") == whole


@pytest.mark.moderate
def test_a_long_journal_is_written_anew_without_what_is_in_files(
    tmp_path: Path, whole: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeping, "_LONGEST_JOURNAL", 300)
    fill(tmp_path / "a", [0, 1, 4, 2, 7])
    lines = [json.loads(line) for line in (tmp_path / "a" / "journal.jsonl").read_text().splitlines()]
    assert sorted(line["run"] for line in lines) == [4, 7]
    fill(tmp_path / "a", [3, 5, 6])
    assert bytes_in(tmp_path / "a") == whole


@pytest.mark.moderate
def test_another_campaign_program_or_process_is_refused(tmp_path: Path) -> None:
    fill(tmp_path, [0])
    with pytest.raises(InputError, match="another campaign"), Kept.opened(tmp_path, plan(small(seed=9)), PROGRAM):
        pass
    with pytest.raises(InputError, match="another version of the program"), Kept.opened(tmp_path, plan(), "other"):
        pass
    with (
        Kept.opened(tmp_path, plan(), PROGRAM),
        pytest.raises(InputError, match="another hil sweep is at work"),
        Kept.opened(tmp_path, plan(), PROGRAM),
    ):
        pass
    with Kept.opened(tmp_path, plan(small(report={"worst": 3})), PROGRAM) as kept:  # what is reported is no other run
        assert kept.missing == 7


def test_a_column_tells_what_it_means(tmp_path: Path, whole: dict[str, bytes]) -> None:
    field = pq.read_schema(tmp_path / "whole" / "results/file=00000/rows.parquet").field("noise_V")
    assert field.metadata[b"meaning"] == b"scenario.sense.noise_V, bench.device.sense.noise_V"
