"""Whole runs on boards with faults: they keep going or stop safely, say what happened, and nothing diverges."""

from pathlib import Path

import numpy as np
import pytest

from device_emulator.scenario import load
from hil.bench import Bench
from hil.boards.emulation import emulator
from hil.progress import untold
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from tests.running import gyro
from tests.running.closed import angle_errors
from tests.wire.multicast import group

pytestmark = pytest.mark.usefixtures("no_report")

BAD_LINE = (
    "lost = 0.02\ncorrupted = 0.002\nduplicated = 0.01\nreordered = 0.01\ndelayed = 0.01\ndelay_s = [0.0, 0.002]\n"
)


def faulty(path: Path, faults: str) -> Path:
    """S-slow's scenario with a `[faults]` table."""
    gyro.scenario(path)
    path.write_text(f"{path.read_text()}\n[faults]\n{faults}\n")
    return path


def go(declared: Bench, link: str, out: Path, truth: Path | None = None) -> tuple[RunFolder, Result]:
    done = run(RunRequest(declared, link, {"truth": truth}), out, progress=untold)
    assert done.folder is not None
    folder = RunFolder(done.folder)
    assert folder.result is not None
    return folder, folder.result


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", [7, 8])
def test_a_bad_line_is_survived_and_told(tmp_path: Path, seed: int) -> None:
    scenario, truth = faulty(tmp_path / "board.toml", BAD_LINE), tmp_path / "truth.arrow"
    declared = gyro.bench(2.0, loop={"seed": seed}, limits={"late_fraction": 0.1})
    folder, result = go(declared, f"inproc:{scenario}", tmp_path / "runs", truth)
    assert result.verdict == "good", result.reasons
    counters = result.counters
    assert result.lost == counters["lost"] == counters["frames_lost"] > 200
    assert counters["frames_damaged"] > 5
    assert counters["board_lost_seq"] > 200
    answers = result.answers
    assert answers is not None
    assert answers.lost_to_board > 100
    assert result.remarks[0].startswith(f"{answers.lost_to_host} samples (")
    assert any("damaged frames were dropped" in remark for remark in result.remarks)
    assert np.abs(angle_errors(folder, truth, 1.0)).max() < 0.01
    innovation = folder.innovation
    assert innovation is not None
    late = innovation.t_s > 1.0
    assert np.sqrt(np.mean((innovation.nu_V[late] / innovation.sd_V[late]) ** 2)) < 1.2


@pytest.mark.slow
def test_samples_lost_beyond_the_limit_fail_the_run(tmp_path: Path) -> None:
    scenario = faulty(tmp_path / "board.toml", 'lost = 0.05\ntoward = "host"')
    declared = gyro.bench(1.0, limits={"lost_fraction": 0.02})
    _, result = go(declared, f"inproc:{scenario}", tmp_path / "runs")
    assert result.verdict == "failed"
    assert any("of the samples lost, [limits] lost_fraction is 2.00\u00a0%" in reason for reason in result.reasons)


@pytest.mark.long
@pytest.mark.usefixtures("no_scan")  # of the records alone
def test_the_same_seed_is_the_same_record_on_every_link(tmp_path: Path) -> None:
    """In lockstep bench time decides what a lost frame does, so neither link nor speed can change the record."""
    scenario, declared = faulty(tmp_path / "board.toml", BAD_LINE), gyro.bench(1.0)
    here, _ = go(declared, f"inproc:{scenario}", tmp_path / "here")
    for kind, link in (("pty", "pty"), ("udp", f"udp:{group(3)}")):
        with emulator(scenario, link=link, seed=declared.loop.seed) as board:
            there, _ = go(declared, board.url, tmp_path / kind)
        assert here.capture_path.read_bytes() == there.capture_path.read_bytes(), kind


@pytest.mark.slow
def test_an_unplugged_board_stops_the_run(tmp_path: Path) -> None:
    scenario = faulty(tmp_path / "board.toml", "unplugged_s = 0.25")
    folder, result = go(gyro.bench(1.0), f"inproc:{scenario}", tmp_path / "runs")
    assert (result.verdict, result.samples, result.complete) == ("unsafe", 1000, True)
    assert "cut the supply" in result.reasons[0]  # nobody knows what the board does now
    assert "unplugged" in result.reasons[0]
    assert folder.capture is not None


@pytest.mark.slow
def test_an_unplugged_pty_hangs_up(tmp_path: Path) -> None:
    scenario = faulty(tmp_path / "board.toml", "unplugged_s = 0.25")
    with emulator(scenario) as board:
        _, result = go(gyro.bench(1.0), board.url, tmp_path / "runs")
        assert board.process.wait(10.0) == 0
    assert (result.verdict, result.complete) == ("unsafe", True)
    assert "the other end hung up" in result.reasons[0]
    assert 900 < result.samples <= 1001


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("link", ["inproc", "pty"])
def test_a_brown_out_stops_the_run_and_is_named(tmp_path: Path, link: str) -> None:
    scenario = faulty(tmp_path / "board.toml", "[[faults.brown_out]]\nstart_s = 0.2\nduration_s = 0.05")
    _, result = go(gyro.bench(1.0), f"{link}:{scenario}", tmp_path / "runs")
    assert result.verdict == "interrupted"
    assert "the board restarted: " in result.reasons[0]
    assert "; check the board's supply" in result.reasons[0]
    assert result.samples == 801


@pytest.mark.slow
def test_a_stall_is_survived(tmp_path: Path) -> None:
    scenario = faulty(tmp_path / "board.toml", "[[faults.stall]]\nstart_s = 0.5\nduration_s = 0.1")
    truth = tmp_path / "truth.arrow"
    folder, result = go(gyro.bench(1.5), f"inproc:{scenario}", tmp_path / "runs", truth)
    assert result.counters["rearmed"] == 1
    assert any(remark.startswith("the board went to SAFE once and was armed again") for remark in result.remarks)
    estimates = folder.estimates
    assert estimates is not None
    assert np.abs(estimates["energy_ratio"][estimates.t_s > 1.0] - 1.0).max() < 0.05


@pytest.mark.slow
def test_a_stuck_channel_is_named(tmp_path: Path) -> None:
    stuck = '[[faults.stuck]]\naxis = "x"\nstart_s = 0.5\nduration_s = 0.1'
    scenario = faulty(tmp_path / "board.toml", stuck)
    _, result = go(gyro.bench(1.0), f"inproc:{scenario}", tmp_path / "runs")
    assert result.verdict == "failed"
    told = "channel x repeated one code for 0.1 s from 0.4998 s on: it is stuck"
    assert any(told in reason for reason in result.reasons), result.reasons


@pytest.mark.slow
def test_a_saturated_channel_is_named(tmp_path: Path) -> None:
    saturated = '[[faults.saturated]]\naxis = "y"\nstart_s = 0.3\nduration_s = 0.5\nlimit_V = 0.05'
    scenario = faulty(tmp_path / "board.toml", saturated)
    _, result = go(gyro.bench(1.0), f"inproc:{scenario}", tmp_path / "runs")
    assert result.verdict == "failed"
    assert any("channel y went no further than 0.05 V" in reason for reason in result.reasons), result.reasons


@pytest.mark.long
@pytest.mark.realtime
def test_on_wall_time_handshake_and_run_survive_a_bad_line(tmp_path: Path) -> None:
    """Requests are repeated, watchdogs rearmed; the emulator says at the end what it did."""
    gyro.unhurried_scenario(tmp_path / "board.toml")
    path = tmp_path / "board.toml"
    path.write_text(path.read_text() + "\n[faults]\nlost = 0.1\ncorrupted = 0.05\n")
    declared = gyro.unhurried_bench(3.0, link={"timeout_s": 4.0, "watchdog_s": 0.5}, limits={"lost_fraction": 0.5})
    with emulator(path) as board:
        _, result = go(declared, board.url, tmp_path / "runs")
        board.stop()
        words = board.last_words()
    assert result.complete
    assert result.samples + result.lost == 1200
    assert result.counters["frames_lost"] > 60
    assert words.startswith("faults inflicted: corrupted_to_board")


@pytest.mark.long
@pytest.mark.realtime
def test_what_a_board_counted_before_is_not_this_runs(tmp_path: Path) -> None:
    """Its counters count since its power-up; drives are lost in its first second only."""
    path = gyro.unhurried_scenario(tmp_path / "board.toml")
    path.write_text(path.read_text() + '\n[faults]\nlost = 0.1\ntoward = "board"\nuntil_s = 1.0\n')
    declared = gyro.unhurried_bench(1.5, limits={"late_fraction": 1.0})
    with emulator(path) as board:
        (_, first), (_, second) = (go(declared, board.url, tmp_path / name) for name in ("first", "second"))
    assert first.counters["board_lost_seq"] > 10
    assert second.counters["board_lost_seq"] == 0


def test_the_scenario_names_its_mistakes(tmp_path: Path) -> None:
    path = faulty(tmp_path / "board.toml", 'lsot = 0.1\n[[faults.stuck]]\naxis = "x"\nstart_s = 1.0\nduration_s = 1.0')
    with pytest.raises(ValueError, match=r"board.toml: \[faults\] lsot: unknown key; did you mean lost\?"):
        load(path)
