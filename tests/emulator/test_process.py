"""The board as a process on a pty: both clocks, hang-ups, signals, bad input."""

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from device_emulator.__main__ import main
from device_emulator.inprocess import open_board
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed
from hil.wire.inproc import InprocLink
from hil.wire.links import open_link
from hil.wire.messages import ClockMode, LoopMode, SafeReason, State, Status
from hil.wire.sense import Sense
from tests.emulator.gyro import EXAMPLES

pytestmark = pytest.mark.slow  # whole processes

SLOW = str(EXAMPLES / "s-slow.scenario.toml")
PATIENCE_S = 60.0


class Process:
    """An emulator that has said `ready`."""

    def __init__(self, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-W", "error", "-m", "device_emulator", *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.popen.stdout is not None
        ready, _, self.url = self.popen.stdout.readline().strip().partition(" ")
        assert ready == "ready", self.popen.communicate()[1]

    def connect(self) -> Endpoint:
        return Endpoint(open_link(self.url))

    def ends(self) -> tuple[int, str]:
        """Exit code, and what it wrote to standard error."""
        _, said = self.popen.communicate(timeout=PATIENCE_S)
        return self.popen.returncode, said


@pytest.fixture
def start() -> Iterator[Callable[..., Process]]:
    """Starts emulators, and sees them off."""
    with contextlib.ExitStack() as stack:

        def begin(*arguments: str) -> Process:
            process = Process(*arguments)
            stack.callback(process.popen.communicate)
            stack.callback(process.popen.kill)
            return process

        yield begin


def lockstep(endpoint: Endpoint, rows: int) -> list[tuple[int, ...]]:
    """Connect, arm and answer `rows` samples with a drive that depends on what was seen."""
    client.connect(endpoint, PATIENCE_S)
    client.write_register(endpoint, "CLOCK_MODE", ClockMode.LOCKSTEP)
    client.arm(endpoint)
    seen = []
    while len(seen) < rows:
        for row in endpoint.receive_rows(PATIENCE_S):
            seen.append(row)
            tick, vx, vy, *_ = row
            endpoint.send_drive(vy // 4, -vx // 4, tick + 1)
    return seen


def truth_ticks(path: Path) -> list[int]:
    with pa.OSFile(str(path)) as file:
        ticks: list[int] = pa.ipc.open_stream(file).read_all()["tick"].to_pylist()
    return ticks


def test_lockstep_over_a_pty_equals_lockstep_in_process(start: Callable[..., Process], tmp_path: Path) -> None:
    """Also with the process stopped and continued on the way; and a hang-up ends it, truth complete."""
    process = start(SLOW, "--truth", str(tmp_path / "truth.arrow"), "--seed", "3")
    far = process.connect()
    seen = lockstep(far, 100)
    process.popen.send_signal(signal.SIGSTOP)
    process.popen.send_signal(signal.SIGCONT)
    while len(seen) < 300:
        for row in far.receive_rows(PATIENCE_S):
            seen.append(row)
            far.send_drive(row[2] // 4, -row[1] // 4, row[0] + 1)
    far.close()
    assert process.ends() == (0, "device_emulator: the host hung up, and in lockstep the board ends with it\n")
    near = Endpoint(InprocLink(open_board(SLOW, str(tmp_path / "near.arrow"), 3)))
    assert lockstep(near, 300) == seen
    near.close()
    far_ticks, near_ticks = (truth_ticks(tmp_path / name) for name in ("truth.arrow", "near.arrow"))
    assert near_ticks == list(range(301))
    assert far_ticks[:300] == list(range(300))


def test_sigterm_in_lockstep_closes_the_truth(start: Callable[..., Process], tmp_path: Path) -> None:
    process = start(SLOW, "--truth", str(tmp_path / "truth.arrow"), "--truth-every", "10")
    endpoint = process.connect()
    lockstep(endpoint, 50)
    endpoint.receive_rows(PATIENCE_S)  # the answer to our last drive: row 50 is done
    process.popen.send_signal(signal.SIGTERM)
    assert process.ends() == (0, "")
    assert truth_ticks(tmp_path / "truth.arrow") == [0, 10, 20, 30, 40, 50]
    endpoint.close()


def test_sigterm_before_any_host(start: Callable[..., Process]) -> None:
    process = start(SLOW)
    process.popen.send_signal(signal.SIGTERM)
    assert process.ends() == (0, "")


def await_status(endpoint: Endpoint, state: State) -> Status:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        for received in endpoint.poll(1.0):
            if isinstance(received.message, Status) and received.message.state == state:
                return received.message
    raise AssertionError(f"no STATUS {state.name}")


@pytest.mark.realtime
def test_paced_through_watchdog_hang_up_and_a_second_host(start: Callable[..., Process], tmp_path: Path) -> None:
    # At 500 Hz even a machine that stalls for a second loses nothing.
    scenario = tmp_path / "leisurely.scenario.toml"
    scenario.write_text(Path(SLOW).read_text().replace("sample_rate_Hz = 4000.0", "sample_rate_Hz = 500.0"))
    process = start(str(scenario), "--truth", str(tmp_path / "truth.arrow"))
    endpoint = process.connect()
    assert client.connect(endpoint, PATIENCE_S).tick_rate_Hz == 500.0
    client.write_register(endpoint, "CLOCK_MODE", ClockMode.PACED)
    client.write_register(endpoint, "WATCHDOG_TICKS", 500)
    client.arm(endpoint, PATIENCE_S)
    ticks: list[int] = []
    while len(ticks) < 200:
        for tick, *_ in endpoint.receive_rows(PATIENCE_S):
            ticks.append(tick)
            endpoint.send_drive(10, -10, tick + 1)
    assert ticks == list(range(len(ticks)))
    status = await_status(endpoint, State.SAFE)  # we have fallen silent
    assert (status.reason, status.watchdog_trips) == (SafeReason.WATCHDOG, 1)
    time.sleep(0.3)  # while the mass swings on for 150 ticks at least
    armed = client.arm(endpoint, PATIENCE_S)
    first = endpoint.receive_rows(PATIENCE_S)[0][0]
    assert first > status.tick + 150
    assert first == armed.tick + 1
    for nap_s in (0.011, 0.015, 0.019):  # less than it takes until it looks at the time by itself
        client.make_safe(endpoint, SafeReason.LINK_LOST, PATIENCE_S)  # which does not latch
        time.sleep(nap_s)
        endpoint.receive_rows(0.0)  # what came before
        armed = client.arm(endpoint, PATIENCE_S)
        assert endpoint.receive_rows(PATIENCE_S)[0][0] == armed.tick + 1
    endpoint.close()

    second = process.connect()
    client.connect(second, PATIENCE_S)
    status = client.make_safe(second, SafeReason.HOST_REQUEST, PATIENCE_S)
    assert status.tick >= first
    process.popen.send_signal(signal.SIGTERM)
    code, said = process.ends()
    assert code == 0
    assert all(line.startswith("device_emulator: ") for line in said.splitlines())
    kept = truth_ticks(tmp_path / "truth.arrow")
    assert kept == list(range(len(kept)))
    assert len(kept) > status.tick
    second.close()


def test_the_board_ends_with_its_parent() -> None:
    """The parent is killed, so that it can tell nobody."""
    script = (
        "import subprocess, sys, time\n"
        f"command = [sys.executable, '-m', 'device_emulator', {SLOW!r}]\n"
        "child = subprocess.Popen(command, stdout=subprocess.PIPE)\n"
        "print(child.stdout.readline().decode(), flush=True)\n"
        "time.sleep(600)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    try:
        endpoint = Endpoint(open_link(parent.stdout.readline().split()[1]))
        client.connect(endpoint, PATIENCE_S)
    finally:
        parent.kill()
        parent.communicate()
    with pytest.raises(LinkClosed):
        endpoint.poll(PATIENCE_S)
    endpoint.close()


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["none.toml"], "device_emulator: none.toml: cannot read the scenario (No such file or directory)\n"),
        (
            [SLOW, "--truth", "none/truth.arrow"],
            "device_emulator: none/truth.arrow: cannot write the truth file (No such file or directory)\n",
        ),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    arguments: list[str],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert capsys.readouterr() == ("", complaint)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["--seed", "-1"], ["--truth-every", "0"], ["--link", "can"]])
def test_bad_options_are_exit_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        sys.exit(main([SLOW, *arguments]))
    assert ended.value.code == 2


@pytest.mark.long
def test_a_board_whose_parent_died_before_it_served_ends() -> None:
    parent = subprocess.Popen([sys.executable, "-c", ""])
    parent.wait()
    done = subprocess.run(
        [sys.executable, "-m", "device_emulator", SLOW, "--parent", str(parent.pid)],
        capture_output=True,
        timeout=PATIENCE_S,
    )
    assert done.returncode == 0
    assert done.stdout.startswith(b"ready ")


@pytest.mark.realtime
def test_a_stream_nobody_reads_waits_and_then_is_dropped_in_whole_blocks(start: Callable[..., Process]) -> None:
    """8 bytes at 100 kHz for 2 s are more than pty and queue hold together; what is missing is counted at both ends."""
    endpoint = start(str(EXAMPLES / "s-modern-5k.scenario.toml"), "--link", "pty").connect()
    client.connect(endpoint, PATIENCE_S)
    for name, value in (("CLOCK_MODE", ClockMode.PACED), ("LOOP_MODE", LoopMode.GAIN), ("BLOCK", 500)):
        client.write_register(endpoint, name, value)
    client.arm(endpoint)
    time.sleep(2.0)
    ticks = [0]
    while ticks[-1] < 300_000:  # read as it comes from here on
        ticks += [item.tick for item in endpoint.poll(PATIENCE_S) if isinstance(item.message, Sense)]
    status = client.make_safe(endpoint, SafeReason.HOST_REQUEST)
    ticks += [item.tick for item in endpoint.poll(0.0) if isinstance(item.message, Sense)]
    endpoint.close()
    jumps = np.diff(ticks[1:])
    assert status.dropped > 0
    assert not (jumps % 500).any()
    assert np.sum(jumps // 500 - 1) == endpoint.rx.lost == status.dropped
