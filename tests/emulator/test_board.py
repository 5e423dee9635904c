"""The firmware, through its protocol: states, timing to the tick, lateness, watchdog, registers, refusals."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from device_emulator.board import HORIZON, Board
from device_emulator.device import Device
from device_emulator.scenario import Scenario
from hil.wire.codec import type_of
from hil.wire.framing import CRC_SIZE, seal
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveForce,
    DriveGains,
    FieldRead,
    FieldValue,
    Hello,
    Identity,
    LoopMode,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
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


@pytest.mark.parametrize(("protocol", "spec_hash"), [(SPEC.protocol + 1, SPEC.hash), (SPEC.protocol, SPEC.hash ^ 1)])
def test_a_foreign_host_gets_an_identity_but_cannot_arm(protocol: int, spec_hash: int) -> None:
    host = Host(scenario())
    (identity,) = host.say(Hello(protocol, spec_hash))
    assert isinstance(identity, Identity)
    assert host.board.state is State.BOOT
    assert nack(host.say(Arm())) is NackReason.BAD_STATE
    host.say(Safe(SafeReason.HOST_REQUEST))
    assert nack(host.say(Arm())) is NackReason.BAD_STATE


def test_the_states_in_order() -> None:
    host = Host(scenario())
    assert host.board.state is State.BOOT
    host.say(Hello(SPEC.protocol, SPEC.hash))
    assert host.board.state is State.IDLE
    status, sense = host.say(Arm())
    assert isinstance(status, Status)
    assert isinstance(sense, Sense)
    assert (status.state, status.tick) == (State.ARMED, 0)
    status, sense = host.say(DriveForce(5, 6, 1))
    assert isinstance(status, Status)
    assert isinstance(sense, Sense)
    assert status.state == State.RUNNING
    (status,) = host.say(Safe(SafeReason.RESIDUAL))
    assert isinstance(status, Status)
    assert (status.state, status.reason) == (State.SAFE, SafeReason.RESIDUAL)
    assert nack(host.say(Arm())) is NackReason.LATCHED
    host.say(Hello(SPEC.protocol, SPEC.hash))
    status, _ = host.say(Arm())
    assert isinstance(status, Status)
    assert (status.state, status.reason) == (State.ARMED, SafeReason.NONE)


def test_arming_twice_is_answered_twice_and_done_once() -> None:
    """The answer to the first may have been lost; in lockstep no tick passes for the second."""
    host = Host(scenario()).armed()
    (status,) = host.say(Arm())
    assert isinstance(status, Status)
    assert status.state == State.ARMED
    assert host.board.rows == 1


def test_arming_a_running_board_is_refused() -> None:
    host = Host(scenario()).armed()
    host.say(DriveForce(0, 0, 1))
    assert host.board.state is State.RUNNING
    assert nack(host.say(Arm())) is NackReason.BAD_STATE
    assert host.board.state is State.RUNNING


@pytest.mark.parametrize("state", [State.BOOT, State.IDLE, State.SAFE])
def test_a_drive_is_refused_where_nothing_streams(state: State) -> None:
    host = Host(scenario())
    if state is not State.BOOT:
        host.say(Hello(SPEC.protocol, SPEC.hash))
    if state is State.SAFE:
        host.say(Safe(SafeReason.HOST_REQUEST))
    assert nack(host.say(DriveForce(1, 1, 1))) is NackReason.BAD_STATE
    assert host.board.state is state


def test_ticks_go_on_counting_after_safe() -> None:
    host = Host(scenario()).armed()
    for tick in range(5):
        host.say(DriveForce(1, 1, tick + 1))
    host.say(Safe(SafeReason.LINK_LOST))
    ticks = [r.tick for r in host.received(host.board.exchange(host.tx.encode(Arm(), 0)))]
    assert ticks == [5, 6]  # STATUS at the last row, SENSE with the next


def test_a_host_that_starts_again_finds_the_board_safe() -> None:
    host = Host(scenario()).armed()
    host.say(DriveForce(1, 1, 1))
    host.tx = Transmitter()
    host.say(Hello(SPEC.protocol, SPEC.hash))
    status = host.board.status()
    assert (status.state, status.reason) == (State.SAFE, SafeReason.LINK_LOST)
    assert status.lost_seq == 0
    assert isinstance(host.say(Arm())[0], Status)


# -------------------------------------------------------------------------------- timing to the tick


@pytest.fixture(params=[0, 1, 3])
def latency(request: pytest.FixtureRequest) -> Iterator[int]:
    return request.param


def with_latency(latency: int) -> Scenario:
    return scenario({"truth": {"position_m": [0.0, 0.0]}, "drive": {"latency_samples": latency}})


def test_an_impulse_acts_over_one_interval_and_shows_in_the_row_that_ends_it(latency: int) -> None:
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


def test_a_drive_for_later_waits_for_its_tick() -> None:
    host = Host(scenario()).armed()
    seen = drives(host.say(DriveForce(7, 8, 3)))
    for tick in (2, 4, 5):
        seen += drives(host.say(DriveForce(tick, 0, tick)))
    assert seen == [(0, 0), (0, 0), (2, 0), (7, 8)]  # rows 1 to 4 end the intervals 0 to 3


def test_a_second_drive_for_the_same_tick_replaces_the_first() -> None:
    host = paced().armed()
    host.tick()
    host.say(DriveForce(1, 1, 1))
    host.say(DriveForce(2, 2, 1))
    host.tick()
    assert drives(host.tick()) == [(2, 2)]


def test_effective_ticks_wrap_at_32_bits() -> None:
    """Just behind, in 32 bits, is late; just ahead is not."""
    host = paced().armed()
    host.tick()
    for late in (0, 0xFFFFFFFF, 1 + HORIZON):
        host.say(DriveForce(1, 1, late))
    assert host.board.state is State.ARMED
    assert host.board.status().late == 3
    host.say(DriveForce(1, 1, HORIZON))
    assert host.board.state is State.RUNNING


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


def test_without_an_answer_the_last_drive_is_held_counted_and_flagged() -> None:
    host = paced().armed()
    host.tick()
    host.say(DriveForce(11, 12, 1))
    heard = [host.tick() for _ in range(4)]  # rows 1 to 4; the drive acts from row 2 on, one more is due each row
    assert [drives(m)[0] for m in heard] == [(0, 0), (11, 12), (11, 12), (11, 12)]
    assert [flags(m)[0] for m in heard] == [0, 0, SenseFlags.HELD, SenseFlags.HELD]
    assert host.board.status().held == 2


def test_a_late_drive_changes_nothing_and_is_counted() -> None:
    host = paced().armed()
    host.tick()
    host.say(DriveForce(11, 12, 1))
    host.tick()
    host.tick()  # row 2: the interval from 2 to 3 has begun
    host.say(DriveForce(21, 22, 2))
    assert host.board.status().late == 1
    host.say(DriveForce(31, 32, 3))
    assert drives(host.tick()) == [(11, 12)]
    assert drives(host.tick()) == [(31, 32)]
    assert (host.board.status().late, host.board.status().held) == (1, 1)


def test_a_drive_in_time_is_neither_late_nor_held() -> None:
    """With latency 3 the answer to row m may come until row m + 2 is out."""
    host = paced(scenario({"drive": {"latency_samples": 3}})).armed()
    for row in range(30):
        host.tick()
        if row >= 2:
            host.say(DriveForce(row, 0, row - 2 + 3))
    assert (host.board.status().late, host.board.status().held) == (0, 0)


@pytest.mark.parametrize("watchdog", [1, 5])
def test_watchdog_in_wall_time(watchdog: int) -> None:
    """So many ticks without a drive: zero force, SAFE, told in STATUS; SENSE ends."""
    host = paced()
    host.say(Hello(SPEC.protocol, SPEC.hash))
    host.set("WATCHDOG_TICKS", watchdog)
    host.say(Arm())
    host.tick()
    host.say(DriveForce(100, 100, 1))
    for _ in range(watchdog):
        heard = host.tick()
        assert host.board.state is State.RUNNING
    heard = host.tick()
    assert drives(heard) == [(0, 0)]
    status = heard[-1]
    assert isinstance(status, Status)
    assert (status.state, status.reason, status.watchdog_trips) == (State.SAFE, SafeReason.WATCHDOG, 1)
    assert not host.board.streaming


def test_late_drives_do_not_feed_the_watchdog() -> None:
    host = Host(scenario())
    host.say(Hello(SPEC.protocol, SPEC.hash))
    host.set("WATCHDOG_TICKS", 10)
    host.say(Arm())
    host.say(DriveForce(1, 1, 1))
    answers = [host.say(DriveForce(1, 1, 0)) for _ in range(10)]
    assert [len(codes(a)) for a in answers] == [1] * 10
    assert host.board.state is State.SAFE
    status = host.board.status()
    assert (status.late, status.watchdog_trips, status.reason) == (10, 1, SafeReason.WATCHDOG)
    assert nack(host.say(DriveForce(1, 1, 20))) is NackReason.BAD_STATE


def test_no_watchdog_before_the_first_drive() -> None:
    host = paced().armed()
    for _ in range(200):
        host.tick()
    assert host.board.state is State.ARMED


def test_safe_means_zero_force_at_once_and_after_arming_again() -> None:
    host = paced().armed()
    host.tick()
    host.say(DriveForce(500, 500, 1))
    host.say(DriveForce(600, 600, 30))
    host.tick()
    assert drives(host.tick()) == [(500, 500)]
    host.say(Safe(SafeReason.LINK_LOST))
    host.board.coast(10)
    host.say(Arm())
    assert {d for _ in range(40) for d in drives(host.tick())} == {(0, 0)}


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


def test_drive_codes_are_limited_by_converter_and_register() -> None:
    host = Host(scenario()).armed()
    host.say(DriveForce(40000, -40000, 1))
    heard = host.say(DriveForce(32767, -32767, 2))
    assert (drives(heard), flags(heard)) == ([(32767, -32767)], [SenseFlags.SATURATED])
    heard = host.say(DriveForce(0, 0, 3))
    assert (drives(heard), flags(heard)) == ([(32767, -32767)], [0])
    host.set("DRIVE_LIMIT", 1000)
    host.say(DriveForce(2000, 5, 4))
    heard = host.say(DriveForce(0, 0, 5))
    assert (drives(heard), flags(heard)) == ([(1000, 5)], [SenseFlags.SATURATED])
    assert host.board.status().saturated == 2


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


def test_registers_start_at_their_defaults() -> None:
    host = Host(scenario())
    for register in SPEC.registers.values():
        if register.optional:  # it has no estimator
            assert host.say(RegisterRead(register.id))[0][2] == NackReason.UNKNOWN_REGISTER
            continue
        expected = ClockMode.LOCKSTEP if register.name == "CLOCK_MODE" else register.default
        assert host.say(RegisterRead(register.id)) == [RegisterValue(register.id, expected)]
    assert paced().say(RegisterRead(SPEC.registers["CLOCK_MODE"].id))[0][1] == ClockMode.PACED


def test_a_written_register_is_read_back() -> None:
    host = Host(scenario())
    host.say(Hello(SPEC.protocol, SPEC.hash))
    number = SPEC.registers["WATCHDOG_TICKS"].id
    assert host.set("WATCHDOG_TICKS", 33) == [RegisterValue(number, 33.0)]
    assert host.say(RegisterRead(number)) == [RegisterValue(number, 33.0)]


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("WATCHDOG_TICKS", 0, NackReason.OUT_OF_RANGE),
        ("WATCHDOG_TICKS", 1.5, NackReason.OUT_OF_RANGE),
        ("WATCHDOG_TICKS", float("nan"), NackReason.OUT_OF_RANGE),
        ("BLOCK", 683, NackReason.OUT_OF_RANGE),
        ("CLOCK_MODE", ClockMode.REAL, NackReason.NOT_SUPPORTED),
        ("CLOCK_MODE", ClockMode.PACED, NackReason.NOT_SUPPORTED),
        ("LOOP_MODE", LoopMode.BOARD, NackReason.NOT_SUPPORTED),
        ("LOOP_MODE", 3, NackReason.OUT_OF_RANGE),
        ("FILTER_A11", float("inf"), NackReason.OUT_OF_RANGE),
    ],
)
def test_values_that_are_refused(name: str, value: float, reason: NackReason) -> None:
    host = Host(scenario())
    host.say(Hello(SPEC.protocol, SPEC.hash))
    before = host.say(RegisterRead(SPEC.registers[name].id))
    assert nack(host.set(name, value)) is reason
    assert host.say(RegisterRead(SPEC.registers[name].id)) == before


def test_only_live_registers_change_while_streaming() -> None:
    host = Host(scenario()).armed()
    for register in SPEC.registers.values():
        answer = host.set(register.name, register.minimum)
        if register.optional:
            assert nack(answer) is NackReason.UNKNOWN_REGISTER
        elif register.live:
            assert answer == [RegisterValue(register.id, register.minimum)]
        else:
            assert nack(answer) is NackReason.BAD_STATE


def test_unknown_registers() -> None:
    host = Host(scenario())
    assert nack(host.say(RegisterRead(9999))) is NackReason.UNKNOWN_REGISTER
    assert nack(host.say(RegisterWrite(9999, 1.0))) is NackReason.UNKNOWN_REGISTER


def test_no_latency_needs_lockstep() -> None:
    host = paced(with_latency(0))
    host.say(Hello(SPEC.protocol, SPEC.hash))
    assert nack(host.say(Arm())) is NackReason.NOT_SUPPORTED
    host.set("CLOCK_MODE", ClockMode.LOCKSTEP)
    assert len(codes(host.say(Arm()))) == 1


def test_the_field_table_can_be_read_line_by_line() -> None:
    host = Host(scenario())
    lines = []
    for line in range(len(SPEC.table)):
        (answer,) = host.say(FieldRead(line))
        assert isinstance(answer, FieldValue)
        assert (answer.line, answer.lines) == (line, len(SPEC.table))
        lines.append(answer.entry)
    assert lines == [entry.text for entry in SPEC.table]
    assert nack(host.say(FieldRead(len(SPEC.table)))) is NackReason.OUT_OF_RANGE


def test_time_sync_returns_the_hosts_clock_and_bench_time_in_lockstep() -> None:
    host = Host(scenario()).armed()
    for row in range(8):
        host.say(DriveForce(0, 0, row + 1))
    assert host.say(TimeSync(123, 0)) == [TimeSync(123, 8 * 250_000)]
    first, second = paced().say(TimeSync(1, 0)), paced().say(TimeSync(1, 0))
    assert 0 < first[0][1] <= second[0][1]


def test_messages_of_a_board_and_of_the_other_loop_mode_are_refused() -> None:
    host = Host(scenario()).armed()
    gains = DriveGains(1, (0.0,) * 8, (0.0, 0.0), 0)
    assert nack(host.say(gains)) is NackReason.BAD_STATE
    assert host.board.state is State.ARMED
    assert nack(host.say(RegisterValue(1, 1.0))) is NackReason.NOT_SUPPORTED


def test_broken_and_unknown_frames_change_nothing_and_are_counted() -> None:
    host = Host(scenario()).armed()
    frame = bytearray(host.tx.encode(DriveForce(1, 1, 1), 0))
    frame[5] ^= 0x10
    assert host.board.exchange(bytes(frame)) == b""
    unknown = host.tx.encode(DriveForce(1, 1, 1), 0)
    body = host.rx.decoder.peek(unknown)
    assert body is not None
    (answer,) = host.heard(host.board.exchange(seal(b"\x7e" + body[1:-CRC_SIZE])))
    assert isinstance(answer, Nack)
    assert (answer.of_type, answer.reason) == (0x7E, NackReason.UNKNOWN_TYPE)
    status = host.board.status()
    assert (status.state, status.tick, status.bad_frames, status.lost_seq) == (State.ARMED, 0, 2, 1)


def test_a_refusal_names_the_frame() -> None:
    host = Host(scenario())
    host.say(Hello(SPEC.protocol, SPEC.hash))
    (answer,) = host.say(DriveForce(1, 1, 1))
    assert answer == Nack(type_of(DriveForce), 1, NackReason.BAD_STATE)


def test_an_unknown_reason_for_safe_is_a_request() -> None:
    host = Host(scenario()).armed()
    (status,) = host.say(Safe(200))
    assert isinstance(status, Status)
    assert (status.state, status.reason) == (State.SAFE, SafeReason.HOST_REQUEST)
