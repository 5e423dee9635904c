"""The C board, through its protocol, in lockstep on its pty: states, timing to the tick, lateness, refusals."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed
from hil.wire.links import open_link
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveForce,
    FieldRead,
    NackReason,
    RegisterRead,
    SafeReason,
    SenseFlags,
    State,
    Status,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC

from .process import PATIENCE_S, Host, pty_board, refused, rows

pytestmark = pytest.mark.slow


@pytest.fixture
def host(built: Path) -> Iterator[Host]:
    with pty_board(built) as (_, url):
        host = Host(url)
        yield host
        host.close()


@pytest.fixture
def armed(host: Host) -> Host:
    """The host; row 0 has been heard."""
    status, sense = host.say(Arm(), 2)
    assert isinstance(status, Status)
    assert (status.state, status.tick) == (State.ARMED, 0)
    assert isinstance(sense, Sense)
    return host


def test_identity_and_field_table(host: Host) -> None:
    identity = host.identity
    assert (identity.protocol, identity.spec_hash) == (SPEC.protocol, SPEC.hash)
    assert (identity.tick_rate_Hz, identity.axes, identity.latency_ticks) == (4000.0, 2, 1)
    assert identity.sense_scale_V == 0.25 / 2**15
    assert identity.drive_scale_mps2 == 10.0 / 2**15
    assert Capabilities(identity.capabilities) >= Capabilities.FORCE_MODE | Capabilities.LOCKSTEP | Capabilities.PACED
    assert client.read_field_table(host.endpoint) == SPEC.table
    assert refused(host.say(FieldRead(len(SPEC.table)))) is NackReason.OUT_OF_RANGE


def test_a_block_of_many_rows(host: Host) -> None:
    host.set("BLOCK", 682)
    _, sense = host.say(Arm(), 2)
    assert isinstance(sense, Sense)
    assert sense.codes.shape == (682, 4)
    amplitude = abs(sense.codes[:, 0]).max()
    assert 12000 < amplitude < 15000  # 100 µm × 1000 V/m and the offset, in codes of 7.6 µV


def test_unasked_status(host: Host) -> None:
    host.set("STATUS_EVERY", 2)
    heard = [host.say(Arm(), 3), host.say(DriveForce(1, 1, 1), 2), host.say(DriveForce(1, 1, 2), 2)]
    assert [[type(message) for message in messages] for messages in heard] == [
        [Status, Sense, Status],  # armed; row 0
        [Status, Sense],  # running; row 1
        [Sense, Status],  # row 2
    ]


def test_bench_time_in_lockstep(armed: Host) -> None:
    for tick in range(1, 5):
        armed.say(DriveForce(0, 0, tick), 2 if tick == 1 else 1)
    assert armed.say(TimeSync(123, 0)) == [TimeSync(123, 1_000_000)]


def test_the_converter_clips_at_both_ends_and_says_so(armed: Host) -> None:
    """Driven in its own rhythm with all there is, the mass soon swings beyond ±250 µm."""
    seen = [0]
    flags = 0
    for tick in range(1, 400):
        rising = len(seen) < 2 or seen[-1] > seen[-2]
        heard = armed.say(DriveForce(32767 if rising else -32767, 0, tick), 2 if tick == 1 else 1)
        seen += [row[0] for row in rows(heard)]
        flags |= heard[-1].flags if isinstance(heard[-1], Sense) else 0
    assert (min(seen), max(seen)) == (-32768, 32767)
    assert flags & SenseFlags.CLIPPED


def test_lockstep_ends_with_its_host(built: Path) -> None:
    with pty_board(built) as (process, url):
        Host(url).close()
        assert process.wait(PATIENCE_S) == 0


@pytest.mark.realtime
def test_paced_goes_safe_and_awaits_the_next_host(built: Path) -> None:
    with pty_board(built) as (process, url):
        host = Host(url, ClockMode.PACED)
        host.endpoint.send(Arm())
        heard = host.hear(20)
        assert sum(isinstance(message, Sense) for message in heard) >= 10
        host.close()
        again = Endpoint(open_link(url))
        client.connect(again, PATIENCE_S)
        status = client.make_safe(again, SafeReason.LINK_LOST)
        assert status.reason == SafeReason.LINK_LOST
        assert status.tick >= 10
        time.sleep(0.02)
        assert client.arm(again).tick >= status.tick + 80  # ticks are wall time, watched or not
        again.close()
        assert process.poll() is None


def test_stopping_the_board_does_not_change_a_lockstep_record(built: Path) -> None:
    def record(pause: bool) -> list[list[int]]:
        with pty_board(built) as (process, url):
            host = Host(url)
            heard = host.say(Arm(), 2)
            for tick in range(1, 200):
                if pause and tick == 100:
                    os.kill(process.pid, signal.SIGSTOP)
                    with pytest.raises(subprocess.TimeoutExpired):
                        process.wait(0.1)
                    os.kill(process.pid, signal.SIGCONT)
                heard += host.say(DriveForce(tick, -tick, tick), 2 if tick == 1 else 1)
            host.close()
            return rows(heard)

    assert record(pause=False) == record(pause=True)


def test_a_link_that_hangs_up_raises_on_the_host(built: Path) -> None:
    with pty_board(built) as (process, url):
        host = Host(url)
        process.kill()
        process.wait(PATIENCE_S)
        with pytest.raises(LinkClosed):
            host.say(RegisterRead(1))
        host.close()


@pytest.mark.parametrize("words", [["--rate"], ["--rate", "fast"], ["--nonsense", "1"], ["1"]])
def test_bad_arguments_are_one_line(built: Path, words: list[str]) -> None:
    done = subprocess.run([built / "pty_board", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith("pty_board: expected")
    assert done.stderr.count("\n") == 1
