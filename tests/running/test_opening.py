"""docs/safety.md, "The host", 3: nothing is driven before the sense levels are judged, whatever became of the rows."""

from pathlib import Path
from typing import Any

import pytest

from estimator.observer import Observer
from hil.wire.messages import ClockMode
from tests.running import gyro
from tests.running.closed import HandPaced, board, close_loop

pytestmark = pytest.mark.moderate

ACQUIRED = 400  # ticks of S-slow's acquisition
MODES: dict[str, dict[str, Any]] = {"force": {}, "gain": {"mode": "gain", "block": 20, "estimate_every": 20}}
HOW: dict[str, dict[str, Any]] = {
    "on a quiet line": {},
    "rows were lost": {"lost": range(100, 300)},
    "rows piled up": {"stops": {ACQUIRED - 20: 60}},
    "acquisition is shorter than a cycle": {"acquisition_s": 0.002},
}


def closed(place: Path, mode: str, how: str, gain_off: float) -> tuple[list[bool], int]:
    """Each time the loop was closed or opened, and how many samples were answered; a board whose sense gain is so many
    times the declared one."""
    meddling = dict(HOW[how])
    observer = {"acquisition_s": meddling.pop("acquisition_s")} if "acquisition_s" in meddling else {}
    device = board(gyro.scenario(place / "board.toml"), ClockMode.PACED)
    declared = gyro.bench(0.5, "paced", loop=MODES[mode], observer=observer, link={"watchdog_s": 0.1})
    sense = declared.device.model_copy(update={"amplitude_m": declared.device.amplitude_m / gain_off})
    told: list[bool] = []

    def overhear(observer: Observer) -> None:
        enable = observer.enable_control

        def noted(on: bool) -> None:
            told.append(on)
            enable(on)

        observer.enable_control = noted  # type: ignore[method-assign]

    bench = declared.model_copy(update={"device": sense})
    _, counters = close_loop(HandPaced(device, **meddling), bench, place / "run", overhear)
    return told, counters.samples


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("mode", MODES)
def test_a_board_of_wrong_levels_is_not_driven(tmp_path: Path, mode: str, how: str) -> None:
    told, samples = closed(tmp_path, mode, how, 10.0)
    assert told == [False]
    assert samples < 1000  # the run ended itself


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("mode", MODES)
def test_a_board_of_right_levels_is(tmp_path: Path, mode: str, how: str) -> None:
    told, samples = closed(tmp_path, mode, how, 1.0)
    assert told == [False, True]
    assert samples > 1700
