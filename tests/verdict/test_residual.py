"""What a run that the innovation stopped says of its cause."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.records.estimates import Innovation
from hil.records.runfolder import RunFolder
from hil.verdict.residual import cause
from tests.running import gyro

LINK = "serial:/dev/ttyACM0"


def stopped_after(place: Path, seconds: float) -> RunFolder:
    ticks, found = np.arange(round(100.0 * seconds)), RunFolder(place)
    columns = {"tick": ticks, "nu_x_V": np.full(len(ticks), 0.1), "s_x_V": np.full(len(ticks), 1e-4)}
    vars(found)["innovation"] = Innovation(columns, {"tick_rate_Hz": 100.0, "axes": 1, "columns": {}}, True)
    return found


@pytest.mark.parametrize("mode", ["force", "board"])
def test_a_stop_before_the_scored_window_is_most_often_wiring(tmp_path: Path, mode: str) -> None:
    loop: dict[str, Any] = {"settle_s": 2.0, "mode": mode, "block": 40}
    found = cause(stopped_after(tmp_path, 0.2), gyro.bench(10.0, loop=loop, link={"watchdog_s": 0.2}), LINK)
    assert found is not None
    assert "most often wiring: a sign, exchanged channels, a scale" in found.text
    assert ("that the board's estimator has" in found.text) == (mode == "board")
    assert found.cure.startswith(f"hil identify {LINK} --like {tmp_path}/bench.toml --mass ")
    assert found.cure.endswith(" --arm")


def test_a_stop_after_it_is_not_the_wiring(tmp_path: Path) -> None:
    assert cause(stopped_after(tmp_path, 3.0), gyro.bench(10.0, loop={"settle_s": 2.0}), LINK) is None
