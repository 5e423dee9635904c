"""The firmware, through its protocol: states, timing to the tick, lateness, watchdog, registers, refusals."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import Scenario
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveForce,
    Hello,
    Identity,
    Message,
    Nack,
    NackReason,
    RegisterWrite,
    Safe,
    SafeReason,
    SenseFlags,
    State,
    Status,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC
from hil.wire.stream import Received, Receiver, Transmitter
from tests.emulator.gyro import scenario


class Host:
    """A host that says single messages and reads the answers. Nobody waits: the board has no clock."""

    def __init__(self, what: Scenario, clocks: tuple[ClockMode, ...] = (ClockMode.LOCKSTEP,)) -> None:
        self.board = Board(what, Device(what), clocks)
        self.tx = Transmitter()
        self.rx = Receiver()

    def say(self, message: Message) -> list[Message]:
        return self.heard(self.board.exchange(self.tx.encode(message, 0)))

    def heard(self, data: bytes) -> list[Message]:
        return [received.message for received in self.received(data)]

    def received(self, data: bytes) -> list[Received]:
        return self.rx.feed(data)

    def set(self, name: str, value: float) -> list[Message]:
        return self.say(RegisterWrite(SPEC.registers[name].id, value))

    def armed(self) -> "Host":
        """The same host, its board armed."""
        self.say(Hello(SPEC.protocol, SPEC.hash))
        self.say(Arm())
        assert self.board.state is State.ARMED
        return self

    def tick(self) -> list[Message]:
        """What a board on wall time says at its next deadline."""
        return self.heard(self.board.block())


def paced(what: Scenario | None = None) -> Host:
    return Host(what or scenario(), (ClockMode.PACED, ClockMode.LOCKSTEP))


def codes(messages: list[Message]) -> list[list[int]]:
    """Rows [vx, vy, ux, uy] of all SENSE among the messages."""
    return [row for m in messages if isinstance(m, Sense) for row in m.codes.tolist()]


def drives(messages: list[Message]) -> list[tuple[int, int]]:
    return [(row[2], row[3]) for row in codes(messages)]


def flags(messages: list[Message]) -> list[int]:
    return [m.flags for m in messages if isinstance(m, Sense)]


def nack(messages: list[Message]) -> NackReason:
    (answer,) = messages
    assert isinstance(answer, Nack)
    return NackReason(answer.reason)


# -------------------------------------------------------------------------------- identity and states


def test_hello_is_answered_by_identity() -> None:
    what = scenario({"sense": {"adc_bits": 18}, "drive": {"latency_samples": 3}})
    (identity,) = Host(what).say(Hello(SPEC.protocol, SPEC.hash))
    assert identity == Identity(
        protocol=SPEC.protocol,
        spec_hash=SPEC.hash,
        unique_id=0x5107,
        firmware=0x10000,
        tick_rate_Hz=4000.0,
        axes=2,
        sense_bits=18,
        drive_bits=16,
        sense_scale_V=0.5 / 2**18,
        drive_scale_mps2=10.0 / 2**15,
        latency_ticks=3,
        capabilities=Capabilities.FORCE_MODE | Capabilities.GAIN_MODE | Capabilities.LOCKSTEP,
    )
    (identity,) = paced().say(Hello(SPEC.protocol, SPEC.hash))
    assert isinstance(identity, Identity)
    assert identity.capabilities & Capabilities.PACED


def test_ticks_go_on_counting_after_safe() -> None:
    host = Host(scenario()).armed()
    for tick in range(5):
        host.say(DriveForce(1, 1, tick + 1))
    host.say(Safe(SafeReason.LINK_LOST))
    ticks = [r.tick for r in host.received(host.board.exchange(host.tx.encode(Arm(), 0)))]
    assert ticks == [5, 6]  # STATUS at the last row, SENSE with the next


# -------------------------------------------------------------------------------- timing to the tick


@pytest.fixture(params=[0, 1, 3])
def latency(request: pytest.FixtureRequest) -> Iterator[int]:
    return request.param


def with_latency(latency: int) -> Scenario:
    return scenario({"truth": {"position_m": [0.0, 0.0]}, "drive": {"latency_samples": latency}})


def test_an_impulse_acts_over_one_interval_and_shows_at_its_end(latency: int) -> None:
    """Computed from row 4, effective at tick 4 + L, it acts until 5 + L: seen moving from row 5 + L on."""
    host = Host(with_latency(latency)).armed()
    rows = []
    for row in range(20):
        force = 30000 if row == 4 else 0
        rows += codes(host.say(DriveForce(force, -force, row + latency)))
    echo = np.array(rows)[:, 2:]
    expected = np.zeros((20, 2), int)
    expected[4 + latency] = 30000, -30000  # `rows` begins with row 1
    np.testing.assert_array_equal(echo, expected)
    moving = np.abs(np.array(rows)[:, :2]).max(axis=1) > 0
    np.testing.assert_array_equal(moving, np.arange(20) >= 4 + latency)


def test_the_wire_shows_what_the_device_does_under_the_echoed_drive(latency: int) -> None:
    """Whole random runs: sense codes equal those of a bare device driven by the echo."""
    what = with_latency(latency)
    host = Host(what)
    host.say(Hello(SPEC.protocol, SPEC.hash))
    rows = codes(host.say(Arm()))
    random = np.random.default_rng(2)
    for row in range(150):
        ux, uy = random.integers(-32767, 32768, 2).tolist()
        rows += codes(host.say(DriveForce(ux, uy, row + latency)))
    seen = np.array(rows)
    np.testing.assert_array_equal(Device(what).rows(seen[:, 2:]), seen[:, :2])
    assert host.board.status()[2:8] == (0, 0, 0, 0, 0, 0)


def test_a_second_drive_for_the_same_tick_replaces_the_first() -> None:
    host = paced().armed()
    host.tick()
    host.say(DriveForce(1, 1, 1))
    host.say(DriveForce(2, 2, 1))
    host.tick()
    assert drives(host.tick()) == [(2, 2)]


def test_same_seed_same_bytes() -> None:
    def stream() -> bytes:
        host = Host(scenario({"sense": {"noise_V": 1e-4}, "truth": {"temperature_K": 300.0}})).armed()
        said = host.board.exchange(host.tx.encode(TimeSync(5, 0), 0))
        for row in range(100):
            said += host.board.exchange(host.tx.encode(DriveForce(row, -row, row + 1), row))
        return said

    assert stream() == stream()


def test_bytes_may_come_in_any_portions() -> None:
    def stream(size: int) -> bytes:
        host = Host(scenario())
        messages: list[Message] = [Hello(SPEC.protocol, SPEC.hash), Arm()]
        messages += [DriveForce(row, -row, row + 1) for row in range(20)]
        data = b"".join(host.tx.encode(message, 0) for message in messages)
        return b"".join(host.board.exchange(data[i : i + size]) for i in range(0, len(data), size))

    assert stream(1) == stream(7) == stream(10_000)


# -------------------------------------------------------------------------------- late, held, watchdog


def test_a_drive_in_time_is_neither_late_nor_held() -> None:
    """With latency 3 the answer to row m may come until row m + 2 is out."""
    host = paced(scenario({"drive": {"latency_samples": 3}})).armed()
    for row in range(30):
        host.tick()
        if row >= 2:
            host.say(DriveForce(row, 0, row - 2 + 3))
    assert (host.board.status().late, host.board.status().held) == (0, 0)


def test_coasting_moves_the_mass_and_counts_the_ticks() -> None:
    what = scenario()
    host = paced(what).armed()
    host.tick()
    host.say(Safe(SafeReason.LINK_LOST))
    host.board.coast(100)
    host.say(Arm())
    (received,) = host.received(host.board.block())
    assert received.tick == 101
    bare = Device(what).rows(np.zeros((102, 2)))
    assert codes([received.message])[0][:2] == bare[101].tolist()


# -------------------------------------------------------------------------------- codes and flags


def test_a_clipping_converter_is_flagged() -> None:
    host = Host(scenario({"sense": {"adc_full_scale_V": 0.05}}))
    host.say(Hello(SPEC.protocol, SPEC.hash))
    sense = host.say(Arm())[-1]
    assert isinstance(sense, Sense)
    assert sense.flags == SenseFlags.CLIPPED
    assert sense.codes[0, 0] == -(2**23)


@pytest.mark.parametrize(("bits", "width"), [(16, 2), (17, 3), (24, 3)])
def test_codes_take_the_bytes_they_need(bits: int, width: int) -> None:
    host = Host(scenario({"sense": {"adc_bits": bits}}))
    host.say(Hello(SPEC.protocol, SPEC.hash))
    sense = host.say(Arm())[-1]
    assert isinstance(sense, Sense)
    assert sense.width == width


def test_blocks_hold_consecutive_rows_and_one_answer_each() -> None:
    what = scenario()
    host = Host(what)
    host.say(Hello(SPEC.protocol, SPEC.hash))
    host.set("BLOCK", 10)
    host.set("STATUS_EVERY", 15)
    rows = codes(host.say(Arm()))
    statuses: list[Any] = []
    for block in range(6):
        heard = host.say(DriveForce(100 * block, 0, 10 * block + 10))
        rows += codes(heard)
        statuses += [m.tick for m in heard if isinstance(m, Status) and m.state == State.RUNNING]
    seen: NDArray[np.int64] = np.array(rows)
    assert len(seen) == 70
    np.testing.assert_array_equal(seen[:, 2], [0] * 11 + [100 * (k // 10) for k in range(59)])
    np.testing.assert_array_equal(Device(what).rows(seen[:, 2:]), seen[:, :2])
    assert host.board.status().held == 0
    assert statuses == [9, 19, 39, 49, 69]  # the first for the change of state


def test_a_block_without_its_drive_is_held_once() -> None:
    host = paced()
    host.say(Hello(SPEC.protocol, SPEC.hash))
    host.set("BLOCK", 10)
    host.say(Arm())
    host.tick()
    host.say(DriveForce(5, 5, 10))
    assert [flags(host.tick()) for _ in range(3)] == [[0], [SenseFlags.HELD], [SenseFlags.HELD]]
    assert host.board.status().held == 2


# -------------------------------------------------------------------------------- registers, refusals


def test_no_latency_needs_lockstep() -> None:
    host = paced(with_latency(0))
    host.say(Hello(SPEC.protocol, SPEC.hash))
    assert nack(host.say(Arm())) is NackReason.NOT_SUPPORTED
    host.set("CLOCK_MODE", ClockMode.LOCKSTEP)
    assert len(codes(host.say(Arm()))) == 1


def test_time_sync_returns_the_hosts_clock_and_bench_time_in_lockstep() -> None:
    host = Host(scenario()).armed()
    for row in range(8):
        host.say(DriveForce(0, 0, row + 1))
    assert host.say(TimeSync(123, 0)) == [TimeSync(123, 8 * 250_000)]
    first, second = paced().say(TimeSync(1, 0)), paced().say(TimeSync(1, 0))
    assert 0 < first[0][1] <= second[0][1]
