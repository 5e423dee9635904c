"""A drive and the sample that would have told of it, both lost: the samples after them tell."""

from pathlib import Path

import numpy as np
import pytest

from hil.running.loop import force
from hil.wire.messages import ClockMode
from tests.running import gyro
from tests.running.closed import HandPaced, angle_errors, board, close_loop

LOST = range(1000, 3900, 97)


def error_rad(folder: Path) -> float:
    """Largest angle error of a second of S-slow in which every 97th sample is lost, and the drive before it as well."""
    folder.mkdir()
    truth = folder / "truth.arrow"
    there = board(gyro.scenario(folder / "board.toml"), ClockMode.PACED, truth)
    link = HandPaced(there, lost=LOST, unheard={tick - 2 for tick in LOST})  # acts on the interval that ends at tick
    run, counters = close_loop(link, gyro.bench(1.0, "paced", loop={"settle_s": 0.25}), folder / "run")
    assert counters.lost == len(LOST)
    return float(np.abs(angle_errors(run, truth, 0.25)).max())


@pytest.mark.slow
def test_what_was_held_while_a_sample_was_missing_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    knowing = error_rad(tmp_path / "knowing")
    monkeypatch.setattr(force, "MARGIN", np.inf)
    assert knowing < 0.5 * error_rad(tmp_path / "not-knowing")
    assert knowing < 5e-3
