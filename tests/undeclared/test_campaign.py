"""`python -m evaluation.undeclared`: killed it goes on, and comes to what was come to without."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from evaluation.undeclared.__main__ import main
from evaluation.undeclared.population import population
from evaluation.undeclared.record import make
from hil.errors import InputError

SAMPLES = 6_000
WAIT_S = 300.0


def command(folder: Path, *more: str) -> list[str]:
    return [
        *("all", "--n", "6", "--draw", "2", "--samples", str(SAMPLES), "--jobs", "2", "--folder", str(folder)),
        *("--out", str(folder / "figures.json"), "--page", str(folder / "page"), *more),
    ]  # fmt: skip


def answers(folder: Path) -> dict[str, int]:
    """When each record was traced, ns, by name."""
    return {file.parent.name: file.stat().st_mtime_ns for file in folder.glob("*/traced.json")}


@pytest.mark.long
@pytest.mark.timeout(900)
def test_killed_twice_it_comes_to_the_same(tmp_path: Path) -> None:
    """`kill -9` of the whole of it, among the first records and then among the rest."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert main(command(whole)) == 0
    kept: dict[str, int] = {}
    for number in (1, 3):
        with subprocess.Popen(
            [sys.executable, "-m", "evaluation.undeclared", *command(cut)],
            stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True,
        ) as campaign:  # fmt: skip
            until = time.monotonic() + WAIT_S
            while len(answers(cut)) < number:
                assert campaign.poll() is None
                assert time.monotonic() < until
                time.sleep(0.05)
            os.killpg(campaign.pid, signal.SIGKILL)
        assert not (cut / "figures.json").exists()
        assert kept.items() <= answers(cut).items()
        kept = answers(cut)
    assert main(command(cut)) == 0
    assert kept.items() <= answers(cut).items()  # none twice
    assert sorted(answers(cut)) == sorted(order.name for order in population(6, 2))
    assert (whole / "figures.json").read_bytes() == (cut / "figures.json").read_bytes()
    for order in population(6, 2):
        one, other = (folder / order.name / "capture.arrow" for folder in (whole, cut))
        assert one.read_bytes() == other.read_bytes(), order.name


@pytest.mark.slow
def test_a_record_of_another_draw_in_its_place_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    order = population(6, 2)[0]
    make(order, tmp_path, 500)
    with pytest.raises(InputError, match="of another draw or length"):
        make(order, tmp_path, 600)
    assert main(command(tmp_path)) == 2
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith(f"evaluation.undeclared: {tmp_path / order.name / 'truth.json'}: of another draw or length")
    assert "give another --folder" in told


def test_no_record_to_evaluate_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", *command(tmp_path)[1:]]) == 2
    assert "no record of this draw is there" in capsys.readouterr().err
