"""A setting lives for one run of one lease; what would drive is told whole before, and is what reaches the board."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from hil.records.capture import read_capture
from tests.service.serving import Serving, serving
from tests.service.test_board import Operator, until

SETTINGS = {"amplitude": 150e-6, "dither": 0.0, "virtual_rotation": -2.0}
BENCH = "short"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    """A service beside a bench file of a second in lockstep."""
    place = tmp_path_factory.mktemp("settings")
    text = find("bench", "s-slow").read_text()
    for old, new in (('clock = "paced"', 'clock = "lockstep"\nseed = 1'), ("settle_s = ", "settle_s = 0.1 #"),
                     ("duration_s = ", "duration_s = 0.5 #")):  # fmt: skip
        assert text.count(old) == 1
        text = text.replace(old, new)
    (place / f"{BENCH}.bench.toml").write_text(text)
    with serving(place / "runs") as running:
        yield running


@pytest.fixture
def operator(bench: Serving) -> Iterator[Operator]:
    operator = Operator(bench)
    connected(operator)
    yield operator
    operator.ask("POST", "/api/board/disconnect")
    given_back(operator)


def connected(operator: Operator) -> None:
    operator.ask("POST", "/api/board/connect", json={"link": "pty:s-slow", "bench": BENCH})


def given_back(operator: Operator) -> None:
    operator.ask("DELETE", "/api/lease")


def driven(operator: Operator, **given: Any) -> tuple[Path, bytes]:
    """The run's folder, and what the board says that it applied, sample by sample."""
    run = operator.ask("POST", "/api/board/start", json={"consent": True, **given})["run"]
    until(lambda: operator.state["run"] is None and not operator.state["stage"], 240.0)
    folder = operator.service.folder / run
    capture = read_capture(folder / "capture.arrow")
    drive = [values for name, values in capture.columns.items() if name.startswith(("ux_", "uy_"))]
    assert len(drive) == 2
    return folder, np.stack(drive).tobytes()


def told(operator: Operator, **given: Any) -> dict[str, str]:
    said = operator.ask("POST", "/api/board/drives", json=given)
    return {fact["name"]: fact["value"] for fact in said["drives"]}


@pytest.mark.long
@pytest.mark.parametrize("left", ["another lease", "another board", "the next run but one"])
def test_a_setting_of_before_drives_nothing(operator: Operator, left: str) -> None:
    declared = load_bench(operator.service.folder.parent / f"{BENCH}.bench.toml")
    fresh, drive = driven(operator)
    connected(operator)  # in lockstep the board has left with its host
    said = operator.ask("PATCH", "/api/board/settings", json=SETTINGS)
    assert set(said["at_next_start"]) == set(SETTINGS)
    assert operator.state["next_settings"] == SETTINGS
    assert "150 µm" in told(operator)["amplitude"]
    if left == "another lease":
        given_back(operator)
        operator.lease = Operator(operator.service).lease
    elif left == "another board":
        operator.ask("POST", "/api/board/disconnect")
        connected(operator)
    else:
        operator.ask("PATCH", "/api/board/settings", json=SETTINGS)
        changed, other = driven(operator)
        assert load_bench(changed / "bench.toml").device.amplitude_m == SETTINGS["amplitude"]
        assert other != drive
        connected(operator)
    assert operator.state["next_settings"] == {}
    assert told(operator)["amplitude"] == f"{1e6 * declared.device.amplitude_m:g} µm"
    again, drive_again = driven(operator)
    assert drive_again == drive, "the board was driven otherwise than by its bench file"
    assert (again / "bench.toml").read_text() == (fresh / "bench.toml").read_text()


@pytest.mark.slow
def test_without_a_board_there_is_nothing_to_set(bench: Serving) -> None:
    operator = Operator(bench)
    headers = {"x-lease": operator.lease}
    refused = bench.ask("PATCH", "/api/board/settings", json={"amplitude": 1e-4}, headers=headers)
    given_back(operator)
    assert refused.status_code == 409
    assert "no board" in refused.json()["error"]


def test_the_watchdog_that_applies_is_shown_where_none_is_declared(operator: Operator) -> None:
    text = find("bench", "s-slow").read_text()
    assert text.count("watchdog_s = 0.02") == 1
    assert told(operator, bench_toml=text.replace("watchdog_s = 0.02", ""))["watchdog"] == "0.02 s"
    assert told(operator, bench_toml=text.replace("watchdog_s = 0.02", "watchdog_s = 0.03"))["watchdog"] == "0.03 s"


def test_a_setting_that_the_board_cannot_have_is_refused(operator: Operator) -> None:
    """By the name of the link that was connected; a start that brings it is refused with the same reason."""
    headers = {"x-lease": operator.lease}
    patch = operator.service.ask("PATCH", "/api/board/settings", json={"amplitude": 1.0}, headers=headers)
    body = {"consent": True, "settings": {"amplitude": 1.0}}
    start = operator.service.ask("POST", "/api/board/start", json=body, headers=headers)
    for refused in (patch, start):
        assert refused.status_code == 409
        assert refused.json()["error"].startswith("with amplitude = 1: pty:s-slow")
        assert "the board's converter ends at" in refused.json()["error"]
        assert refused.json()["remedy"] == "correct gain or amplitude"
    assert operator.state["next_settings"] == {}
    operator.ask("PATCH", "/api/board/settings", json={"amplitude": 1.2e-4})
    assert operator.state["next_settings"] == {"amplitude": 1.2e-4}


@pytest.mark.slow
def test_a_start_is_held_to_what_was_shown(operator: Operator) -> None:
    asked = {"bench": BENCH, "settings": {"dither": 0.1}}
    shown = operator.ask("POST", "/api/board/drives", json=asked)
    assert {"name": "dither", "value": "0.1 m/s² rms (a setting; the bench file says 0.3 m/s² rms)"} in shown["drives"]
    operator.ask("PATCH", "/api/board/settings", json={"amplitude": 120e-6})  # by somebody who shares the lease
    headers = {"x-lease": operator.lease}
    body = {**asked, "consent": True, "agreed": shown["digest"]}
    refused = operator.service.ask("POST", "/api/board/start", json=body, headers=headers)
    assert refused.status_code == 409
    assert "amplitude 120 µm" in refused.json()["error"]
    assert operator.state["run"] is None
    now = operator.ask("POST", "/api/board/drives", json=asked)["digest"]
    folder, _ = driven(operator, **asked, agreed=now)
    run = load_bench(folder / "bench.toml")
    assert (run.device.amplitude_m, run.controller.dither_mps2) == (120e-6, 0.1)
    assert json.loads((folder / "result.json").read_text())["samples"] > 0
