"""`hil identify` as a process: consent first, SAFE on every way out, no file behind a board that is gone."""

import json
import signal
from pathlib import Path

import pytest

from hil.bench.examples import find
from hil.cli.identify import identify
from tests.cli.conftest import Start, finished
from tests.cli.test_processes import wait_for

pytestmark = pytest.mark.slow  # whole processes


def test_another_board_is_not_armed_without_consent(forked: Start, tmp_path: Path) -> None:
    code, out, err = finished(forked("identify", "serial:/dev/no-such-port", "-o", "my.bench.toml"))
    assert (code, out) == (2, "")
    assert err.splitlines()[-1].endswith("arming a board needs --arm")
    assert not (tmp_path / "my.bench.toml").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_experiment_ends_in_safe(start: Start, tmp_path: Path, number: signal.Signals) -> None:
    host = start("identify", "pty:s-slow", "-o", "my.bench.toml")
    wait_for(host, "search: run")
    host.send_signal(number)
    code, out, err = finished(host)
    assert (code, out) == (130, "")
    assert "SAFE was confirmed" in err
    assert not (tmp_path / "my.bench.toml").exists()


def test_a_board_that_goes_away_ends_it_in_one_line(forked: Start, tmp_path: Path) -> None:
    scenario = tmp_path / "gone.scenario.toml"
    text = find("scenario", "s-slow").read_text(encoding="utf-8")
    scenario.write_text(f"{text}\n[faults]\nunplugged_s = 1.0\n", encoding="utf-8")
    code, out, err = finished(forked("identify", f"pty:{scenario}", "-o", "my.bench.toml"))
    assert (code, out) == (2, "")
    assert "Traceback" not in err
    assert "the record so far" in err.splitlines()[-1]
    assert not (tmp_path / "my.bench.toml").exists()


def test_the_first_example_finds_the_board_and_its_file_alone_runs(forked: Start, tmp_path: Path) -> None:
    text = find("scenario", "s-still").read_text(encoding="utf-8")
    example = (identify.__doc__ or "").partition("hil identify ")[2].splitlines()[0]
    code, out, err = finished(forked("identify", *example.split(), "--json"))
    assert code == 0, err
    found = json.loads(out)
    assert found["faults"] == []
    assert found["latency_ticks"] == {"measured": 1, "identity": 1}
    declared = {"resonance_1": 500.5, "resonance_2": 499.5, "azimuth": 0.6, "q_1": 800.0, "q_2": 1000.0, "rate": 0.0}
    assert "500.5 Hz along 0.6 rad, 499.5 Hz across" in text
    assert "Q 800 and 1000 along the same axes" in text
    for name, value in declared.items():
        one = found["constants"][name]
        assert abs(one["value"] - value) < 4.0 * one["u"], name
    following = err.splitlines()[-1].partition("next: hil ")[2].split()
    code, out, err = finished(forked(*following))
    assert code == 0, out + err


def test_link_and_records_are_one_of_two(forked: Start) -> None:
    code, _, err = finished(forked("identify"))
    assert code == 2
    assert "give the link of a board, or --record RUN" in err
