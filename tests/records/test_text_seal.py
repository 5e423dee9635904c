"""Bench file and figures of a run are sealed as its records are: what was changed since is told by every verb."""

import json
from pathlib import Path

import pytest
from crc32c import crc32c

from hil.errors import InputError
from hil.records.atomic import is_sealed, require_unchanged, sealed
from hil.records.check import check
from hil.records.result import load_result
from hil.records.runfolder import RunFolder
from hil.records.runs import listed

BENCH = '[device]\nname = "gyro"\n\n[loop]\nname = "night"\n\n[observer]\nmemory_s = 1.0\n'


@pytest.fixture
def run(make_run) -> Path:
    """The folder of a short run with figures."""
    folder, _ = make_run(seconds=0.3)
    return folder


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def problems(folder: Path) -> dict[str, list[str]]:
    return {entry.name: entry.problems for entry in check(folder) if entry.problems}


def test_the_checksum_is_that_of_the_file_with_its_digits_zero(run: Path) -> None:
    data = (run / "result.json").read_bytes()
    seal = json.loads(data)["seal"]
    assert seal.startswith("CRC-32C ")
    assert seal[8:] == f"{crc32c(data.replace(seal.encode(), b'CRC-32C 00000000')):08x}"


def test_what_was_written_is_whole_and_reads_as_before(run: Path) -> None:
    assert problems(run) == {}
    assert load_result(run / "result.json").verdict == "good"
    assert "[device]" in RunFolder(run).bench_text


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("result.json", '"verdict": "good"', '"verdict": "failed"'),
        ("result.json", '"lost": 0', '"lost": 1'),
        ("result.json", "CRC-32C ", "CRC-32C f"),
        ("bench.toml", "\n[loop]\n", "\n[loop]\nseed = 9\n"),
        ("bench.toml", "\n[loop]\n", "\n"),
        ("bench.toml", "# sealed: ", "# "),
        ("bench.toml", "# sealed: CRC-32C ", "# sealed: CRC-32C F"),
    ],
)
def test_a_change_is_told_by_check_and_by_the_list(run: Path, name: str, old: str, new: str) -> None:
    edit(run / name, old, new)
    assert list(problems(run)) == [name]
    if old != "# sealed: ":  # without any trace of a seal only the sealed figures beside it tell
        (one,) = listed(run.parent)
        assert "changed since it was written" in one.unreadable
        assert one.verdict == ""


def test_every_changed_bit_of_a_text_is_found() -> None:
    data = sealed(BENCH).encode()
    for place in range(len(data) * 8):
        changed = bytearray(data)
        changed[place // 8] ^= 1 << place % 8
        if is_sealed(bytes(changed)):
            with pytest.raises(InputError, match="changed since it was written"):
                require_unchanged(bytes(changed), "bench.toml", "restore it")


def test_a_changed_bench_file_is_not_taken_for_the_one_as_run(run: Path) -> None:
    edit(run / "bench.toml", "\n[loop]\n", "\n[loop]\nseed = 9\n")
    with pytest.raises(InputError, match=r"bench\.toml: changed .*copy it and give --bench"):
        _ = RunFolder(run).bench


def test_files_from_before_there_was_a_seal_still_read(run: Path) -> None:
    (run / "bench.toml").write_text(RunFolder(run).bench_text.split("\n", 1)[1], encoding="utf-8")
    figures = json.loads((run / "result.json").read_text(encoding="utf-8"))
    del figures["seal"]
    (run / "result.json").write_text(json.dumps(figures), encoding="utf-8")
    assert problems(run) == {}
    assert [remark for entry in check(run) for remark in entry.remarks].count(
        "without a checksum: a changed figure would not show"
    ) == 2
    assert load_result(run / "result.json").verdict == "good"


def test_a_sealed_text_that_is_sealed_again_has_one_seal() -> None:
    assert sealed(sealed(BENCH)) == sealed(BENCH)
