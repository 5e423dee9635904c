"""The C board, through its protocol, in lockstep on its pty: states, timing to the tick, lateness, refusals."""

import math
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, ProtocolError
from hil.wire.framing import encode_frame
from hil.wire.links import open_link
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveForce,
    FieldRead,
    Hello,
    NackReason,
    RegisterRead,
    Safe,
    SafeReason,
    SenseFlags,
    State,
    Status,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC

from .process import PATIENCE_S, Host, pty_board, refused, rows, write

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


def test_a_foreign_host_is_told_but_cannot_arm(built: Path) -> None:
    with pty_board(built) as (_, url):
        endpoint = Endpoint(open_link(url))
        for protocol, spec_hash in ((SPEC.protocol + 1, SPEC.hash), (SPEC.protocol, SPEC.hash ^ 1)):
            endpoint.send(Hello(protocol, spec_hash))
            endpoint.poll(PATIENCE_S)
            with pytest.raises(ProtocolError, match="BAD_STATE"):
                client.arm(endpoint)
        endpoint.close()


def test_registers_have_their_defaults_and_limits(host: Host) -> None:
    for name, register in SPEC.registers.items():
        if name != "CLOCK_MODE" and not register.optional:
            assert client.read_register(host.endpoint, name) == register.default
    assert refused(host.say(RegisterRead(0x7FFF))) is NackReason.UNKNOWN_REGISTER
    assert refused(host.say(write("ESTIMATE_EVERY", 8))) is NackReason.UNKNOWN_REGISTER  # it has no estimator
    assert refused(host.say(write("WATCHDOG_TICKS", 0))) is NackReason.OUT_OF_RANGE
    for value in (1.5, math.nan, math.inf, -math.inf, 1e300, -1.0):
        assert refused(host.say(write("WATCHDOG_TICKS", value))) is NackReason.OUT_OF_RANGE
    assert refused(host.say(write("CLOCK_MODE", ClockMode.REAL))) is NackReason.NOT_SUPPORTED
    assert host.set("WATCHDOG_TICKS", 500) == 500
    assert client.read_register(host.endpoint, "WATCHDOG_TICKS") == 500


def test_only_live_registers_while_it_streams(armed: Host) -> None:
    assert refused(armed.say(write("BLOCK", 2))) is NackReason.BAD_STATE
    assert armed.set("DRIVE_LIMIT", 100) == 100


def test_frames_that_make_no_sense_are_refused_and_counted(host: Host) -> None:
    assert host.say_raw(0x7F, b"") is NackReason.UNKNOWN_TYPE
    assert host.say_raw(0x7F, bytes(3000)) is NackReason.UNKNOWN_TYPE  # longer than the board has memory for
    assert host.say_raw(SPEC.messages["DRIVE_FORCE"].type, bytes(11)) is NackReason.BAD_LENGTH
    assert host.say_raw(SPEC.messages["DRIVE_FORCE"].type, bytes(3000)) is NackReason.BAD_LENGTH
    assert host.say_raw(SPEC.messages["STATUS"].type, bytes(SPEC.messages["STATUS"].size)) is NackReason.NOT_SUPPORTED
    damaged = bytearray(encode_frame(1, host.endpoint.tx.seq, 0, b"\1"))
    damaged[9] ^= 4
    host.endpoint.link.send(bytes(damaged))
    (status,) = host.say(Safe(SafeReason.RESIDUAL))
    assert isinstance(status, Status)
    assert status.bad_frames == 5
    assert (status.state, status.reason) == (State.SAFE, SafeReason.RESIDUAL)


def test_lost_and_repeated_frames_are_told_apart(host: Host) -> None:
    host.endpoint.tx.seq += 7
    host.say(RegisterRead(1))
    host.endpoint.tx.seq -= 1
    host.endpoint.send(RegisterRead(1))  # the same number again: no answer
    (status,) = host.say(Safe(SafeReason.HOST_REQUEST))
    assert isinstance(status, Status)
    assert status.lost_seq == 7


def test_a_drive_acts_on_the_interval_that_begins_at_its_tick(armed: Host) -> None:
    """Computed from row 0 with a latency of 1 it begins at tick 1, so row 2 is the first that shows it."""
    status, first = armed.say(DriveForce(11, -12, 1), 2)
    assert isinstance(status, Status)
    assert status.state == State.RUNNING
    (second,) = armed.say(DriveForce(21, -22, 2))
    (third,) = armed.say(DriveForce(31, -32, 3))
    assert [row[2:] for row in rows([first, second, third])] == [[0, 0], [11, -12], [21, -22]]


def test_a_drive_may_wait_for_its_tick_and_be_replaced(armed: Host) -> None:
    armed.say(DriveForce(5, 5, 4), 2)
    armed.say(DriveForce(6, 6, 4))
    heard = [armed.say(DriveForce(tick, tick, tick))[0] for tick in (5, 6, 7)]
    assert [row[2:] for row in rows(heard)] == [[0, 0], [0, 0], [6, 6]]


def test_late_drives_are_counted_and_the_last_one_is_held(armed: Host) -> None:
    armed.say(DriveForce(7, 8, 1), 2)
    heard = [armed.say(DriveForce(9, 9, 1))[0] for _ in range(3)]
    assert [row[2:] for row in rows(heard)] == [[7, 8], [7, 8], [7, 8]]
    assert [message.flags & SenseFlags.HELD for message in heard if isinstance(message, Sense)] == [0, 1, 1]
    (status,) = armed.say(Safe(SafeReason.HOST_REQUEST))
    assert isinstance(status, Status)
    assert (status.late, status.held) == (3, 2)


def test_codes_are_bounded_and_told(armed: Host) -> None:
    armed.set("DRIVE_LIMIT", 100)
    armed.say(DriveForce(2**31 - 1, -(2**31), 1), 2)
    (sense,) = armed.say(DriveForce(100, -100, 2))
    (after,) = armed.say(DriveForce(0, 0, 3))
    assert isinstance(sense, Sense)
    assert isinstance(after, Sense)
    assert rows([sense])[0][2:] == [100, -100]
    assert (sense.flags, after.flags) == (SenseFlags.SATURATED, 0)


def test_the_converters_range_bounds_too(armed: Host) -> None:
    armed.say(DriveForce(10**6, -(10**6), 1), 2)
    assert rows(armed.say(DriveForce(0, 0, 2)))[0][2:] == [32767, -32767]


def test_watchdog_brings_it_to_safe_and_arm_back(host: Host) -> None:
    host.set("WATCHDOG_TICKS", 3)
    host.say(Arm(), 2)
    host.say(DriveForce(7, 8, 1), 2)
    for _ in range(2):  # late ones do not feed it
        host.say(DriveForce(7, 8, 0))
    (status,) = host.say(DriveForce(7, 8, 0))
    assert isinstance(status, Status)
    assert (status.state, status.reason, status.watchdog_trips) == (State.SAFE, SafeReason.WATCHDOG, 1)
    assert refused(host.say(DriveForce(7, 8, 5))) is NackReason.BAD_STATE
    before = status.tick
    status, sense = host.say(Arm(), 2)
    assert isinstance(status, Status)
    assert status.state == State.ARMED
    assert status.tick == before
    assert rows([sense])[0][2:] == [0, 0]


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


def test_hello_while_it_runs_is_a_restarted_host(armed: Host) -> None:
    armed.say(DriveForce(7, 8, 1), 2)
    client.connect(armed.endpoint)
    (status,) = armed.say(Safe(SafeReason.LINK_LOST))  # which asks, and changes nothing
    assert isinstance(status, Status)
    assert (status.state, status.reason) == (State.SAFE, SafeReason.LINK_LOST)


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
