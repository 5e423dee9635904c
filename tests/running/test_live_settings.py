"""Settings that change while the loop runs (docs/reference/service.md, Settings): what follows is what a bench file
with them does; what has to wait says why.
"""

import json
import socket
from pathlib import Path

import numpy as np
import pytest

from hil.bench import Bench, load_bench
from hil.bench.examples import find
from hil.errors import InputError
from hil.progress import Progress
from hil.records.capture import read_capture
from hil.records.changes import note_change, read_changes
from hil.records.runfolder import RunFolder
from hil.replaying.replay import replay
from hil.running.process.live_settings import at_once, in_force, with_settings
from hil.running.request import RunRequest
from hil.running.run import run
from tests.running.test_replay import assert_same

RATE = 4000  # of S-slow, samples a second
ASKED = {"amplitude": 0.8e-4, "virtual_rotation": -4.0, "target_stiffness": 1.04 * 1579.1, "dither": 0.0}


def declared() -> Bench:
    loop = {"clock": "lockstep", "duration_s": 6.0, "settle_s": 3.0}
    return load_bench(find("bench", "s-slow")).with_(loop=loop, controller={"virtual_reversal_s": 0.0})


def test_what_waits_for_the_next_start_says_why() -> None:
    bench = declared()
    begun = in_force(bench)
    assert begun["virtual_rotation"] == bench.controller.virtual_rotation_rad_s
    assert not any(at_once(bench, ASKED).values())
    assert "at most" in at_once(bench, {"target_stiffness": 1.3 * begun["target_stiffness"]})["target_stiffness"]
    assert at_once(bench, {"amplitude": 2.0 * begun["amplitude"]})["amplitude"]
    stepped = bench.with_(controller={"stiffness_step": 0.01})
    assert "stiffness_step" in at_once(stepped, {"target_stiffness": begun["target_stiffness"]})["target_stiffness"]
    fast = load_bench(find("bench", "s-modern-5k"))
    told = at_once(fast, {**in_force(fast), "virtual_rotation": 1.0})
    assert told["dither"]
    assert told["target_stiffness"]
    assert not told["virtual_rotation"]
    assert not told["amplitude"]
    assert all(at_once(bench.with_(controller={"enabled": False}), ASKED).values())
    assert in_force(with_settings(bench, ASKED)) == pytest.approx(ASKED)


def settled(folder: Path, bench: Bench) -> dict[str, float]:
    """Of the last two seconds: half axis of the pattern, its turning, the drive's stiffness; no estimate in it."""
    capture = read_capture(folder / "capture.arrow")
    rows = np.flatnonzero(capture.tick >= 4 * RATE)
    place = capture.sense_V / np.array(bench.device.sense_gains_V_per_m)
    parts = place[rows].reshape(-1, 400, 2)  # a tenth of a second
    centred = parts - parts.mean(axis=1, keepdims=True)
    xx, yy = (centred**2).mean(axis=1).T
    xy = (centred[:, :, 0] * centred[:, :, 1]).mean(axis=1)
    angle = 0.5 * np.unwrap(np.arctan2(2 * xy, xx - yy))
    motion = np.column_stack([np.ones(len(rows)), place[rows - 1]])
    force = np.linalg.lstsq(motion, capture.drive[rows, 0], rcond=None)[0]
    return {
        "amplitude": float(np.sqrt(2 * (xx + yy)).mean()),
        "turning": float(np.polyfit(0.1 * np.arange(len(angle)), angle, 1)[0]),
        "stiffness": float(-force[1]),
    }


@pytest.mark.usefixtures("no_report", "no_scan")  # of the records alone
@pytest.mark.long
def test_from_then_on_the_loop_is_as_if_the_bench_file_said_so(tmp_path: Path) -> None:
    bench = declared()
    link = f"inproc:{find('scenario', 's-slow')}"
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        ours.send(json.dumps(ASKED).encode())
        changed = run(RunRequest(bench, link), tmp_path, control=theirs, progress=lambda _: None).folder
        said = []
        while data := socket.recv_fds(ours, 1 << 16, 4)[0]:
            said.append(json.loads(data))
    as_declared = run(RunRequest(with_settings(bench, ASKED), link), tmp_path, progress=lambda _: None).folder
    unchanged = run(RunRequest(bench, link), tmp_path, progress=lambda _: None).folder
    assert changed is not None
    assert as_declared is not None
    assert unchanged is not None
    (told,) = [one for one in said if "changed" in one]
    assert told["changed"] == pytest.approx(ASKED)
    assert told["tick"] <= RATE // 5  # a tenth of a second of bench time, from the first sample on
    found, wanted, before = (settled(folder, bench) for folder in (changed, as_declared, unchanged))
    assert found["amplitude"] == pytest.approx(0.8e-4, rel=0.01)
    assert before["amplitude"] == pytest.approx(1e-4, rel=0.01)
    assert found["turning"] == pytest.approx(wanted["turning"], abs=0.05)
    assert abs(found["turning"] - before["turning"]) > 5.0  # from 3 to −4 rad/s
    assert found["stiffness"] == pytest.approx(wanted["stiffness"], rel=0.02)
    assert found["stiffness"] - before["stiffness"] == pytest.approx(0.04 * bench.target_stiffness_per_s2, rel=0.2)
    assert [one["track"] for one in said if "track" in one]
    assert any(one.get("safe", {}).get("reason") == "HOST_REQUEST" for one in said)


@pytest.mark.long
@pytest.mark.usefixtures("no_report")
def test_a_replay_changes_them_at_the_same_samples(tmp_path: Path) -> None:
    bench = declared().with_(loop={"duration_s": 1.5, "settle_s": 0.5})
    asked = [ASKED]
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def ask_again(progress: Progress) -> None:
        """Later, so that each has a tick of its own."""
        if progress.stage == "run" and progress.done > 0.4 * progress.total and len(asked) == 1:
            asked.append({"virtual_rotation": 1.5})
            ours.send(json.dumps(asked[-1]).encode())

    with ours:
        ours.send(json.dumps(asked[0]).encode())
        link = f"inproc:{find('scenario', 's-slow')}"
        folder = run(RunRequest(bench, link), tmp_path / "live", control=theirs, progress=ask_again).folder
        assert folder is not None
        while data := socket.recv_fds(ours, 1 << 16, 4)[0]:
            if "changed" in (said := json.loads(data)):
                note_change(folder, said["tick"], said["changed"])
    changes = read_changes(folder)
    assert [change.settings["virtual_rotation"] for change in changes] == [-4.0, 1.5]

    def replayed(into: str) -> RunFolder:
        again = replay(folder / "capture.arrow", bench, tmp_path / into, progress=lambda _: None).folder
        assert again is not None
        return RunFolder(again)

    once, twice = replayed("once"), replayed("twice")
    assert_same(RunFolder(folder), once)
    for part in ("estimates.arrow", "innovation.arrow", "changes.jsonl"):
        assert (once.path / part).read_bytes() == (twice.path / part).read_bytes()
    assert read_changes(once.path) == changes
    (folder / "changes.jsonl").unlink()
    with pytest.raises(AssertionError, match="angle_rad"):
        assert_same(RunFolder(folder), replayed("without"))


def test_a_file_of_changes_that_is_none_is_told_by_its_line(tmp_path: Path) -> None:
    (tmp_path / "changes.jsonl").write_text('{"tick": 7, "dither": 0.1}\n{"tick": 9}\n{"tick": 1')
    with pytest.raises(InputError, match=r"changes\.jsonl: line 2 is no change of settings"):
        read_changes(tmp_path)
    (tmp_path / "changes.jsonl").write_text('{"tick": 7, "dither": 0.1}\n{"tick": 1')
    assert read_changes(tmp_path) == [(7, {"dither": 0.1})]
