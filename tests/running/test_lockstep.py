"""Lockstep: a run is what its seed makes it, however it reached the board and whatever stood still meanwhile."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.records.runfolder import RunFolder
from hil.running.recording.recorder import record_here
from hil.running.request import RunRequest
from hil.running.run import run
from hil.running.safety.preflight import configure
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.messages import SafeReason
from tests.running import closed, gyro
from tests.running.closed import close_loop, waiting
from tests.running.processes import Host, alive, children, stopped, until

pytestmark = pytest.mark.usefixtures("no_report")

# The patience of the host with a board is far below the time for which one is stopped here.
DECLARED = gyro.bench(4.0, link={"timeout_s": 0.5})
STOP_S = 1.5


def captured(declared: Bench, link: str, out: Path) -> bytes:
    """The record of a run, byte by byte."""
    folder = run(RunRequest(declared, link), out, progress=lambda _: None).folder
    assert folder is not None
    return RunFolder(folder).capture_path.read_bytes()


@pytest.mark.moderate
def test_the_same_again_is_the_same_record(tmp_path: Path) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    first, again = (close_loop(waiting(scenario), gyro.bench(), tmp_path / name)[0] for name in ("first", "again"))
    for path in (first.capture_path, first.estimates_path, first.innovation_path):
        assert path.read_bytes() == (again.path / path.name).read_bytes()


@pytest.mark.moderate
def test_the_dither_follows_the_seed(tmp_path: Path) -> None:
    """The board's own noise does not, in this process: what differs is what the host adds to the drive, ± 0.3 m/s²."""
    scenario = gyro.scenario(tmp_path / "board.toml")

    def drives(name: str, seed: int | None) -> NDArray[np.float64]:
        declared = override(gyro.bench(), {"loop": {"seed": seed}}, "test")
        capture = close_loop(waiting(scenario), declared, tmp_path / name)[0].capture
        assert capture is not None
        return capture.drive

    seven, again, eight, none = drives("7", 7), drives("again", 7), drives("8", 8), drives("none", None)
    assert np.array_equal(seven, again)
    for other in (eight, none):
        begin = int(np.argmax(np.any(seven != other, axis=1)))
        acquired = round(0.1 * gyro.RATE_HZ)
        assert acquired <= begin < acquired + 10  # not before the control law is switched on, and soon after
        jump = np.abs((seven - other)[begin])
        assert np.all((jump < 0.01) | (np.abs(jump - 0.6) < 0.01))  # the signs differ, nothing else yet


@pytest.mark.long
@pytest.mark.usefixtures("no_scan")  # of the records alone
def test_one_seed_is_one_record_on_any_link(tmp_path: Path) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    declared = gyro.bench(1.0)
    first, again, far = (
        captured(declared, f"{kind}:{scenario}", tmp_path / "runs") for kind in ("inproc", "inproc", "pty")
    )
    assert again == first
    assert far == first
    other = override(declared, {"loop": {"seed": 8}}, "test")
    assert captured(other, f"inproc:{scenario}", tmp_path / "runs") != first


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The record of a run in which nothing stands still."""
    place = tmp_path_factory.mktemp("undisturbed")
    scenario = gyro.scenario(place / "board.toml")
    with pytest.MonkeyPatch.context() as patch:  # what `_strict` and `no_scan` do, for all of this module
        patch.setenv("PYTHONWARNINGS", "error")
        patch.setattr("hil.running.closing_scan.scan_run", lambda *_: None)
        folder = run(
            RunRequest(DECLARED, f"inproc:{scenario}"), place / "runs", report=False, progress=lambda _: None
        ).folder
    assert folder is not None
    return RunFolder(folder).capture_path.read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("standing", ["device_emulator", "hil.running.process.worker", "hil"])
def test_stopping_a_process_changes_nothing(tmp_path: Path, undisturbed: bytes, standing: str) -> None:
    """The board, the loop, or the command itself, stopped for longer than a host is patient in real time."""
    scenario = gyro.scenario(tmp_path / "board.toml")
    with Host(tmp_path / "host", DECLARED, f"pty:{scenario}") as host:
        host.await_stage("run")
        with stopped(host.process.pid if standing == "hil" else host.child(standing), STOP_S):
            assert not host.capture.complete
        code, said = host.ends()
        assert code in (0, 1), said
        assert host.folder.capture_path.read_bytes() == undisturbed


@pytest.mark.slow
def test_all_ends_when_the_host_is_killed(tmp_path: Path) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    with Host(tmp_path / "host", gyro.bench(60.0), f"pty:{scenario}") as host:
        host.await_record()
        others = children(host.process.pid)
        assert len(others) == 2  # the loop and the board
        host.process.kill()
        until(lambda: not any(map(alive, others)))
        assert len(host.capture) > 0
        assert not host.capture.complete


@pytest.mark.parametrize("mode", [{}, {"mode": "gain", "block": 20, "estimate_every": 20}], ids=["force", "gain"])
def test_a_host_that_stood_still_is_no_silence_of_the_board(tmp_path: Path, mode: dict[str, Any]) -> None:
    """A board in lockstep has nothing to say until it is answered; what came just before says that it is there."""
    bench = gyro.bench(0.2, loop={"clock": "lockstep", **mode}, link={"timeout_s": 0.1})
    endpoint = Endpoint(closed.waiting(gyro.scenario(tmp_path / "board.toml")))
    identity = client.connect(endpoint)
    observer = Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    registers = configure(endpoint, identity, bench)
    folder = tmp_path / "run"
    folder.mkdir()
    stalls = [0.3]
    with record_here(folder, closed.run_layouts(observer, bench, identity)) as recording:
        loop = closed.make_loop(endpoint, identity, bench, observer, recording.tracks, registers)
        said = loop._said

        def slowly() -> Any:
            found = said()
            if found and stalls:  # the machine takes the processor away
                time.sleep(stalls.pop())
            return found

        loop._said = slowly  # type: ignore[method-assign]
        loop.arm()
        loop.run(round(0.2 * identity.tick_rate_Hz), lambda _: None, 100)
        loop.finish(SafeReason.HOST_REQUEST)
    endpoint.close()
    assert not stalls
    assert (loop.counters.rearmed, loop.counters.lost) == (0, 0)
