"""Three emulated gyros on one body: attitude beside an integrator of its own; one board lost stops all."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hil
from estimator.attitude import apart
from hil.bench import Bench, examples, load_bench, override
from hil.bench.mount import load_mount
from hil.errors import InputError
from hil.library.loading import AttitudeRun
from hil.records.attitude import AttitudeRecord
from hil.records.runfolder import RunFolder
from hil.running.several import requests_of, run_several
from hil.toml.reading import toml_value

W, A, C = 2.0 * np.pi * 0.5, 0.4, 0.2
MOUNT = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]])


def rate(t: Any) -> np.ndarray:
    """Of the body: coning about z while it turns."""
    return np.array([A * np.cos(W * t), A * np.sin(W * t), C + 0.0 * t])


def mount_file(path: Path, rows: np.ndarray = MOUNT, u: float = 1e-4) -> Path:
    path.write_text(
        "".join(f"[[axis]]\ndirection = {[float(one) for one in row]}\ndirection_u_rad = {u}\n" for row in rows)
    )
    return path


def board(path: Path, axis: np.ndarray, serial: int, **changes: dict[str, Any]) -> Path:
    """S-slow's board, turned about `axis` with the body."""
    known: dict[str, Any] = tomllib.loads(examples.find("scenario", "s-slow").read_text(encoding="utf-8"))
    for section, keys in changes.items():
        known[section] |= keys
    known["board"] |= {"unique_id": serial}
    known["seed"] = serial
    ax, ay, az = axis.tolist()  # ax A cos Wt + ay A sin Wt = |…| sin(Wt + atan2(ax, ay))
    known["rate"] = {
        "kind": "sine",
        "amplitude_rad_s": A * float(np.hypot(ax, ay)),
        "frequency_Hz": 0.5,
        "phase_rad": float(np.arctan2(ax, ay)),
        "offset_rad_s": az * C,
    }
    lines = [f"seed = {known.pop('seed')}"]
    for section, keys in known.items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def angle(axis: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.column_stack([A / W * np.sin(W * t), -A / W * np.cos(W * t), C * t]) @ axis


def attitude_of(t: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) from the first of the times on, by a Runge-Kutta method of order 8."""

    def slope(at: float, q: np.ndarray) -> np.ndarray:
        x, y, z = rate(at)
        return 0.5 * np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]]) @ q

    return np.asarray(solve_ivp(slope, (t[0], t[-1]), [1.0, 0, 0, 0], "DOP853", t, rtol=1e-10, atol=1e-11).y.T)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_attitude_under_coning_is_as_good_as_the_angles(tmp_path: Path) -> None:
    known = {"drive_delay_u_s": 1e-9, "sense_delay_u_s": 1e-9, "drive_misalignment_u": 1e-6, "drive_gain_u": 1e-4}
    known |= {"sense_gain_ratio_u": 1e-4, "sense_cross_coupling_u": 1e-4}
    declared = load_bench(examples.find("bench", "s-slow"))
    declared = declared.with_(loop={"settle_s": 5.0}, device={"calibration": known})
    links = [f"inproc:{board(tmp_path / f'{k}.scenario.toml', MOUNT[k], 11 + k)}" for k in range(3)]
    run = hil.run(
        [declared] * 3,
        link=links,
        mount=mount_file(tmp_path / "mount.toml"),
        clock="lockstep",
        duration_s=65.0,
        out=tmp_path / "runs",
    )
    assert isinstance(run, AttitudeRun)
    assert run.verdict == "good", [one.verdict for one in run.runs]
    record = AttitudeRecord.read(run.path / "attitude.arrow")
    t = record.header["start_s"] + record.t_s
    assert t[-1] - t[0] > 59.0
    errors = [
        np.abs(one.angle["angle_rad"] - (angle(axis, one.angle.t_s) - angle(axis, t[:1])))[one.angle.t_s >= t[0]].max()
        for one, axis in zip(run.runs, MOUNT, strict=True)
    ]
    off = np.array([apart(q, true) for q, true in zip(record.quaternion, attitude_of(t), strict=True)])
    assert off.max() < 3.0 * max(errors)
    assert run.figures.u_rad is not None
    assert off[-1] < 3.0 * run.figures.u_rad
    assert run.figures.coning_rad == pytest.approx(np.linalg.norm(run.attitude["coning_z_rad"][-1]), rel=0.1)
    assert "quaternion" in run.report().read_text(encoding="utf-8")
    shown = subprocess.run([sys.executable, "-m", "hil", "show", run.path, "--json"], capture_output=True, check=False)
    assert shown.returncode == 0
    assert json.loads(shown.stdout)["quaternion"] == list(run.figures.quaternion or ())


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_page_shows_the_attitude_while_the_runs_last(tmp_path: Path, no_scan: None) -> None:
    declared = load_bench(examples.find("bench", "s-slow")).with_(loop={"settle_s": 1.0})
    links = [f"inproc:{board(tmp_path / f'{k}.scenario.toml', MOUNT[k], 31 + k)}" for k in range(3)]
    requests = requests_of([declared] * 3, links, {"clock": "lockstep", "duration_s": 30.0})
    seen: list[dict[str, Any]] = []

    def look(url: str) -> None:
        with suppress(OSError):  # once the runs have ended
            while True:
                with urlopen(f"{url}attitude.json") as answer:
                    seen.append(json.load(answer))
                time.sleep(0.1)

    def live(url: str) -> None:
        with urlopen(url) as answer:
            assert b"<h1>Attitude</h1>" in answer.read()
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"{url.rpartition('/')[0].rpartition('/')[0]}/attitude.json")
        threading.Thread(target=look, args=(url,)).start()

    run_several(requests, load_mount(mount_file(tmp_path / "m.toml")), tmp_path, live=live, progress=lambda _: None)
    shown = [one for one in seen if "quaternion" in one]
    assert shown
    t = 1.0 + np.array([0.0, shown[-1]["seconds"]])
    assert apart(shown[-1]["quaternion"], attitude_of(t)[-1]) < 0.05


def slow() -> Bench:
    """A gyro of 25 Hz at 500 Hz, on wall time, whose board goes SAFE half a second after its host."""
    changes: dict[str, Any] = {
        "link": {"watchdog_s": 0.5},
        "device": {"stiffness_N_per_m": (24.4, 24.9, 0.2), "damping_N_s_per_m": (8.6e-5, 7.1e-5, 0.0)},
        "controller": {"target_stiffness_N_per_m": 24.67, "virtual_rotation_rad_s": 0.3},
        "loop": {"clock": "paced", "duration_s": 40.0, "settle_s": 4.0},
    }
    changes["device"]["sample_rate_Hz"] = 500.0
    return override(load_bench(examples.find("bench", "s-slow")), changes, "test")


@pytest.mark.realtime
@pytest.mark.timeout(180)
def test_a_lost_board_brings_all_to_safe_in_their_watchdogs_time(tmp_path: Path) -> None:
    truth = {"stiffness_N_per_m": [25.17, 24.18, 0.247], "damping_N_s_per_m": [1.73e-4, 1.41e-4, 8e-6]}
    emulators = []
    try:
        links = []
        for k in range(3):
            path = board(tmp_path / f"{k}.toml", MOUNT[k], 21 + k, truth=truth, board={"sample_rate_Hz": 500.0})
            emulators.append(
                subprocess.Popen(
                    [sys.executable, "-m", "device_emulator", path, "--link", "pty"], stdout=subprocess.PIPE, text=True
                )
            )
            assert emulators[k].stdout is not None
            links.append(emulators[k].stdout.readline().split()[1])  # type: ignore[union-attr]
        killed: list[float] = []

        def kill() -> None:
            deadline = time.monotonic() + 60.0
            while time.monotonic() < deadline:
                captures = list((tmp_path / "runs").glob("*/*/capture.arrow"))
                if len(captures) == 3 and all(one.stat().st_size > 20_000 for one in captures):
                    break
                time.sleep(0.05)
            killed.append(time.monotonic())
            os.kill(emulators[1].pid, signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        run = hil.run([slow()] * 3, link=links, mount=mount_file(tmp_path / "m.toml"), arm=True, out=tmp_path / "runs")
        killer.join()
    finally:
        for emulator in emulators:
            emulator.kill()
            emulator.wait()
            assert emulator.stdout is not None
            emulator.stdout.close()
    assert isinstance(run, AttitudeRun)
    stop = run.figures.stop
    assert stop is not None
    assert stop.by == "y"
    assert set(stop.safe_after_s) == {"x", "z"}
    assert stop.unconfirmed == ("y",)
    assert max(stop.safe_after_s.values()) < 0.5
    assert run.verdict != "good"
    for one in (run.runs[0], run.runs[2]):
        safety = one.result.parts["safety"]
        assert safety.outcome == "good", safety
        # Of the last row that shows a drive: on the host's clock, by the exchanges of the run.
        folder = RunFolder(one.path)
        assert folder.clock is not None
        assert folder.capture is not None
        mid = 0.5 * (folder.clock.columns["t_send_ns"][-1] + folder.clock.columns["t_receive_ns"][-1])
        at = 1e-9 * mid + (folder.capture.tick[-1] - folder.clock.tick[-1]) / 500.0
        assert at - killed[0] < 0.5


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (np.diag([1.0, 1.0, 2.0]), "a unit vector is expected, its length is 2"),
        (np.array([[1.0, 0, 0], [0, 1.0, 0], [0.6, 0.8, 0]]), "lie in one plane"),
        (np.eye(3)[[0, 0]], "lie in one plane or along one line"),
        (np.vstack([np.eye(3), np.eye(3)[:1]]), "axis"),
    ],
)
def test_a_mount_that_gives_no_attitude_is_refused_in_one_line(tmp_path: Path, rows: np.ndarray, told: str) -> None:
    with pytest.raises(InputError, match=told) as raised:
        load_mount(mount_file(tmp_path / "mount.toml", rows))
    assert "\n" not in str(raised.value)


def test_what_does_not_go_together_is_refused_before_anything_runs(tmp_path: Path) -> None:
    mount = mount_file(tmp_path / "mount.toml")
    for benches, more, told in (
        (["s-slow"] * 3, {}, "mount: missing"),
        (["s-slow"] * 2, {"mount": mount}, "it has 3 tables"),
        (["s-slow"] * 4, {"mount": mount}, "4 bench files; up to 3"),
        (["s-slow"] * 3, {"mount": mount, "link": ["pty:s-slow"]}, "1 given for 3"),
        (["s-slow"] * 3, {"mount": mount, "truth": tmp_path / "t.arrow"}, "truth: is of one board"),
        (["s-slow", "s-slow", "s-classic"], {"mount": mount}, "gyros of one body need one"),
        (
            ["s-slow"] * 3,
            {"mount": mount, "link": ["serial:/dev/pts/9"] * 3, "arm": True},
            "two bench files lead to it",
        ),
        ("s-slow", {"link": ["pty:s-slow"]}, "a list goes with a list"),
    ):
        with pytest.raises(InputError, match=told):
            hil.run(benches, out=tmp_path / "runs", **more)  # type: ignore[arg-type]
    assert not (tmp_path / "runs").exists()
