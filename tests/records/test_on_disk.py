"""What is said of a record after a failure is read from the disk, not from what was meant to be there."""

from pathlib import Path

import pytest

from hil.bench import examples, load_bench
from hil.progress import Progress
from hil.records.direct import on_disk
from hil.records.result import load_result
from hil.running.concluding import Interrupted, Made, conclude
from hil.running.request import RunRequest


def interrupt(_: Progress) -> None:
    raise KeyboardInterrupt


def interrupted_figures(folder: Path, meant_s: float = 0.5) -> str:
    """What a Ctrl-C during the closing scan says of a run of which the loop counted 10,000 samples."""
    counters = {"samples": 10_000, "lost": 0}
    bench = load_bench(examples.find("bench", "s-slow")).with_(loop={"duration_s": meant_s, "settle_s": 0.1})
    with pytest.raises(Interrupted) as told:
        conclude(
            Made(
                folder,
                bench,
                {"counters": counters, "safety": {"armed": False, "confirmed": None}},
                RunRequest(bench, "pty:s-slow"),
            ),
            progress=interrupt,
        )
    return str(told.value)


def test_a_record_without_its_end_is_not_called_whole(make_run) -> None:
    folder, _ = make_run(seconds=0.5)
    capture = folder / "capture.arrow"
    data = capture.read_bytes()
    capture.write_bytes(data[: int(0.9 * len(data))])  # what a full disk left
    rows = on_disk(capture).rows
    assert 0 < rows < 2000
    (folder / "result.json").unlink()
    said = interrupted_figures(folder)
    assert "the record is whole" not in said
    assert said.startswith(f"the record was interrupted: it ends after row {rows}, without an end marker: ")
    result = load_result(folder / "result.json")
    assert (result.samples, result.complete, result.verdict) == (rows, False, "interrupted")


def test_a_whole_record_is_called_whole(make_run) -> None:
    folder, _ = make_run(seconds=0.5)
    (folder / "result.json").unlink()
    assert interrupted_figures(folder).startswith("the record is whole: ")
    result = load_result(folder / "result.json")
    assert (result.samples, result.complete) == (2000, True)


def test_a_record_that_ended_early_is_whole_so_far(make_run) -> None:
    folder, _ = make_run(seconds=0.5)
    (folder / "result.json").unlink()
    assert interrupted_figures(folder, 1.0).startswith("whole up to tick 2000 of 4000: ")


def test_without_a_record_nothing_is_called_recorded(tmp_path: Path) -> None:
    assert on_disk(tmp_path / "capture.arrow").told() == "no whole block was recorded"
