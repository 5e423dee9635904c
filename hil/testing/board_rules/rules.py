"""What docs/safety.md and docs/wire.md say a board does, as tests of any board on any link: states, latches, drives,
registers. Written from the pages; `hil.testing.board_rules.conformance` adds them to what it asks of a link.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest

from hil.testing.board_rules.served import (
    PATIENCE_S,
    QUIET_S,
    Board,
    Cable,
    answers,
    leave,
    registers_of,
    samples,
    set_loop_mode,
    set_running,
    status_of,
)
from hil.wire import client
from hil.wire.can_format import BRS, FDF, HEAD, RECORD_SIZE
from hil.wire.codec import pack, type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import ProtocolError
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    DriveBoard,
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
    RegisterWrite,
    Safe,
    SafeReason,
    SenseFlags,
    State,
    Status,
    TimeSync,
)
from hil.wire.sense import Sense
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC
from hil.wire.stream import Received

HELLO = Hello(SPEC.protocol, SPEC.hash)
LATCHING = (SafeReason.HOST_REQUEST, SafeReason.INTERRUPTED, SafeReason.RESIDUAL)
COUNTS_AS_REQUEST = (SafeReason.NONE, SafeReason.WATCHDOG, SafeReason.FAULT, 7, 200)
ZERO = (0.0,) * 8

Row = tuple[int, int, int, int]
"""Tick, ux, uy, flags of the block."""


def hear(host: Endpoint, enough: Callable[[list[Received]], bool]) -> list[Received]:
    """What the board says until it is enough."""
    heard: list[Received] = []
    until = time.monotonic() + PATIENCE_S
    while not enough(heard):
        assert time.monotonic() < until, f"expected an answer, came {said(heard) or 'none'}"
        heard += host.poll(0.02)
    return heard


def written(host: Endpoint, name: str, value: float) -> NackReason | None:
    """Why a register is not written, None if it is; asked again where a line full of samples has lost the answer."""
    try:
        client.write_register(host, name, value, PATIENCE_S)
    except client.Refused as refused:
        return NackReason(refused.reason)
    return None


def rows_of(heard: list[Received]) -> list[Row]:
    """The rows of all SENSE."""
    return [
        (item.tick + k, int(row[2]), int(row[3]), item.message.flags)
        for item in heard
        if isinstance(item.message, Sense)
        for k, row in enumerate(item.message.codes)
    ]


def said(heard: list[Received]) -> list[Any]:
    """What is not SENSE."""
    return [item.message for item in heard if not isinstance(item.message, Sense)]


def write(name: str, value: float) -> RegisterWrite:
    return RegisterWrite(SPEC.registers[name].id, value)


def ask(host: Endpoint, message: Message) -> Any:
    """The one answer to a message, samples left out."""
    host.send(message)
    return said(hear(host, lambda heard: bool(said(heard))))[0]


def refusal(host: Endpoint, message: Message) -> NackReason | None:
    """Why a message is refused; None if it is not."""
    answer = ask(host, message)
    if not isinstance(answer, Nack):
        return None
    assert answer.of_type == type_of(message)
    return NackReason(answer.reason)


def status(host: Endpoint, message: Message) -> tuple[int, int]:
    """State and reason in the STATUS that answers."""
    answer = ask(host, message)
    assert isinstance(answer, Status)
    state = next((known for known in State if known == answer.state), answer.state)
    return state, next((known for known in SafeReason if known == answer.reason), answer.reason)


def step(host: Endpoint, message: Message, block: int = 1) -> list[Received]:
    """In lockstep: a drive, and all that the board says until it waits again: a block, or that it is SAFE."""
    host.send(message)
    return hear(
        host,
        lambda heard: (
            len(rows_of(heard)) >= block
            or any(isinstance(m, Nack) or (isinstance(m, Status) and m.state == State.SAFE) for m in said(heard))
        ),
    )


class Rules:
    """The rules of both pages."""

    alone = False
    start: Any
    start_faulty: Any
    arm: Any
    """Of `Conformance`."""

    # ------------------------------------------------------------------------------------------------ ways to a state

    def lockstep(self, host: Endpoint, *, any_latency: bool = False, **registers: float) -> tuple[Identity, list[Row]]:
        """Arm in lockstep; who the board is, and its first rows."""
        identity = client.connect(host, PATIENCE_S)
        if Capabilities.LOCKSTEP not in Capabilities(identity.capabilities):
            pytest.skip("this board does not wait for its host")
        if identity.latency_ticks == 0 and not any_latency:
            pytest.skip("this board has no latency; its rows are numbered otherwise")
        set_loop_mode(host, LoopMode(int(registers.pop("LOOP_MODE", LoopMode.FORCE))))
        for name, value in ({"CLOCK_MODE": 0, "BLOCK": 1, "DRIVE_LIMIT": 8388607} | registers).items():
            client.write_register(host, name, value, PATIENCE_S)
        if "WATCHDOG_TICKS" not in registers:
            client.write_register(host, "WATCHDOG_TICKS", int(identity.tick_rate_Hz), PATIENCE_S)
        host.send(Arm())
        heard = hear(host, lambda heard: len(rows_of(heard)) >= registers.get("BLOCK", 1))
        assert isinstance(heard[0].message, Status)
        return identity, rows_of(heard)

    @contextmanager
    def fresh(self, served: list[Board], start: Callable[[], Board] | None = None) -> Iterator[Endpoint]:
        """A host that has said nothing yet to a board that was just switched on; one of another kind is replaced
        afterwards."""
        if served[0].process is None and not self.alone:
            pytest.skip("this board cannot be switched off from here")
        if not self.alone:
            served[0].end()
            try:
                served[0] = (start or self.start)()
            except BaseException:  # a skip, too: the tests after this one need a board
                served[0] = self.start()
                raise
        host = Endpoint(Cable(served[0].open()))
        try:
            yield host
            leave(host)
        finally:
            host.close()
            if start is not None:
                served[0].end()
                served[0] = self.start()

    # --------------------------------------------------------------------------------------------- rule 3, and BOOT

    def test_a_board_that_has_just_started(self, host: Endpoint, cable: Cable, served: list[Board]) -> None:
        """BOOT: no ARM and no drive without HELLO, not after SAFE either; defaults; then tick 0 is the first."""
        client.write_register(host, "SESSION", 4711, PATIENCE_S)
        cable.close()
        with self.fresh(served) as new:
            if new.link.name.startswith("udp:"):  # where a host is heard from its first HELLO on
                ask(new, Hello(SPEC.protocol, SPEC.hash ^ 1))
            assert refusal(new, Arm()) is NackReason.BAD_STATE
            assert refusal(new, DriveForce(1, 1, 1)) is NackReason.BAD_STATE
            assert refusal(new, DriveGains(1, ZERO, (0.0, 0.0), 1)) is NackReason.BAD_STATE
            assert refusal(new, write("WATCHDOG_TICKS", 30)) is NackReason.BAD_STATE
            assert refusal(new, write("STATUS_EVERY", 0)) is None
            assert refusal(new, FieldRead(0)) is None
            assert ask(new, TimeSync(9, 0)).host_ns == 9
            for name, register in SPEC.registers.items():
                if name not in ("CLOCK_MODE", "WATCHDOG_TICKS") and not register.optional:
                    assert ask(new, RegisterRead(register.id)) == (register.id, register.default)
            assert status(new, Safe(SafeReason.LINK_LOST)) == (State.SAFE, SafeReason.LINK_LOST)
            assert refusal(new, Arm()) is NackReason.BAD_STATE
            for foreign in (Hello(SPEC.protocol, SPEC.hash ^ 1), Hello(SPEC.protocol + 1, SPEC.hash)):
                assert isinstance(ask(new, foreign), Identity)
                assert refusal(new, Arm()) is NackReason.BAD_STATE
            identity = ask(new, HELLO)
            assert isinstance(identity, Identity)
            assert identity.firmware >> 24 == 0
            ceiling = max(1, min(SPEC.registers["WATCHDOG_TICKS"].default, int(2 * identity.tick_rate_Hz)))
            assert client.read_register(new, "WATCHDOG_TICKS", PATIENCE_S) == ceiling
            _, first = self.lockstep(new)
            assert first[0] == (0, 0, 0, 0)

    def test_a_hello_that_does_not_match_takes_the_permission_back(self, host: Endpoint) -> None:
        client.connect(host, PATIENCE_S)
        assert isinstance(ask(host, Hello(SPEC.protocol, SPEC.hash ^ 1)), Identity)
        assert refusal(host, Arm()) is NackReason.BAD_STATE
        assert isinstance(ask(host, HELLO), Identity)
        assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)

    # ------------------------------------------------------------------------------------------------ rules 2, 4, 5

    @pytest.mark.parametrize("reason", [*LATCHING, *COUNTS_AS_REQUEST])
    def test_a_stop_latches_until_hello(self, host: Endpoint, reason: int) -> None:
        counts_as = reason if reason in LATCHING else SafeReason.HOST_REQUEST
        self.arm(host)
        assert status(host, Safe(reason)) == (State.SAFE, counts_as)
        assert refusal(host, Arm()) is NackReason.LATCHED
        for other in (SafeReason.LINK_LOST, *LATCHING):  # keeps its reason
            assert status(host, Safe(other)) == (State.SAFE, counts_as)
        assert refusal(host, DriveForce(1, 1, 1)) is NackReason.BAD_STATE
        assert isinstance(ask(host, Hello(SPEC.protocol, SPEC.hash ^ 1)), Identity)
        assert isinstance(ask(host, HELLO), Identity)
        assert status(host, Safe(SafeReason.LINK_LOST)) == (State.SAFE, counts_as)  # goes on naming it
        assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)

    def test_a_hello_that_does_not_match_lifts_no_latch(self, host: Endpoint) -> None:
        self.arm(host)
        status(host, Safe(SafeReason.RESIDUAL))
        ask(host, Hello(SPEC.protocol, SPEC.hash ^ 1))
        assert refusal(host, Arm()) is NackReason.BAD_STATE
        assert status(host, Safe(SafeReason.HOST_REQUEST)) == (State.SAFE, SafeReason.RESIDUAL)

    def test_a_stop_after_hello_latches_anew(self, host: Endpoint) -> None:
        self.arm(host)
        status(host, Safe(SafeReason.RESIDUAL))
        ask(host, HELLO)
        assert status(host, Safe(SafeReason.INTERRUPTED)) == (State.SAFE, SafeReason.INTERRUPTED)
        assert refusal(host, Arm()) is NackReason.LATCHED

    def test_a_lost_link_does_not_latch_but_what_latches_wins(self, host: Endpoint) -> None:
        self.arm(host)
        assert status(host, Safe(SafeReason.LINK_LOST)) == (State.SAFE, SafeReason.LINK_LOST)
        assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)
        assert status(host, Safe(SafeReason.LINK_LOST)) == (State.SAFE, SafeReason.LINK_LOST)
        assert status(host, Safe(SafeReason.RESIDUAL)) == (State.SAFE, SafeReason.RESIDUAL)
        assert refusal(host, Arm()) is NackReason.LATCHED

    @pytest.mark.parametrize("running", [False, True])
    def test_hello_while_it_streams_is_a_host_that_begins_anew(self, host: Endpoint, running: bool) -> None:
        self.arm(host, paced=True)
        if running:
            set_running(host)
        host.restart()
        assert isinstance(ask(host, HELLO), Identity)
        assert status(host, Safe(SafeReason.LINK_LOST)) == (State.SAFE, SafeReason.LINK_LOST)
        assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)

    def test_arm_while_armed_and_while_running(self, host: Endpoint) -> None:
        _, first = self.lockstep(host)
        tick = first[-1][0]
        assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)
        step(host, DriveForce(1, 2, tick + 1))
        assert refusal(host, Arm()) is NackReason.BAD_STATE
        heard = step(host, DriveForce(1, 2, tick + 2))  # no tick passed for either ARM
        assert [row[:3] for row in rows_of(heard)] == [(tick + 2, 1, 2)]

    @pytest.mark.parametrize("offset", [0, -1, -3, -256, -257, 1, 200, 30000])
    def test_safe_acts_whatever_its_number_and_tick(self, host: Endpoint, offset: int) -> None:
        """Again and again, and it moves nothing: no frame after it is lost or repeated."""
        before = status_of(host)
        self.arm(host)
        number = host.tx.seq
        for _ in range(3):
            data, _ = host.link.format.encode(
                type_of(Safe), (number + offset) & 0xFFFF, 0xDEADBEEF, pack(Safe(SafeReason.RESIDUAL))
            )
            host.link.send(data)
            (answer,) = said(hear(host, lambda heard: bool(said(heard))))
            assert isinstance(answer, Status)
            assert (answer.state, answer.reason) == (State.SAFE, SafeReason.RESIDUAL)
        for k in range(8):
            assert refusal(host, RegisterRead(1 + k % 6)) is None
        assert status_of(host).lost_seq == before.lost_seq

    def test_safe_acts_whatever_its_length(self, host: Endpoint) -> None:
        if host.link.format is SERIAL:
            frames = [SERIAL.encode(type_of(Safe), 5, 0, payload)[0] for payload in (b"", b"\5\5", bytes(64))]
        else:
            self.arm(host)
            data, _ = host.link.format.encode(type_of(Safe), 0, 0, b"\3")
            (identifier,) = HEAD.unpack_from(data)[:1]
            bodies = ((b"", 0), (b"\5\0", 0), (b"\5" + bytes(7), 0), (b"\5" + bytes(15), BRS | FDF))
            frames = [
                (HEAD.pack(identifier, len(body), flags) + body).ljust(RECORD_SIZE, b"\0") for body, flags in bodies
            ]
            host.link.send((HEAD.pack(identifier, 1, 0) + b"\3").ljust(RECORD_SIZE, b"\0"))  # cansend can0 010#03
            (answer,) = said(hear(host, lambda heard: bool(said(heard))))
            assert (answer.state, answer.reason) == (State.SAFE, SafeReason.RESIDUAL)
        for data in frames:
            self.arm(host)
            host.link.send(data)
            (answer,) = said(hear(host, lambda heard: bool(said(heard))))
            assert (answer.state, answer.reason) == (State.SAFE, SafeReason.HOST_REQUEST)

    def test_one_stray_frame_costs_three_good_ones(self, host: Endpoint) -> None:
        before = status_of(host).lost_seq
        stray, _ = host.link.format.encode(type_of(TimeSync), (host.tx.seq + 200) & 0xFFFF, 0, pack(TimeSync(1, 0)))
        host.link.send(stray)
        assert isinstance(answers(host, 1)[0], TimeSync)
        for _ in range(10):
            host.send(RegisterRead(1))
        assert len(answers(host, 7)) == 7
        assert answers(host, 1, QUIET_S) == []
        assert status_of(host).lost_seq == before + 200

    def test_a_row_of_repetitions_is_broken_by_its_own_numbers_only(self, host: Endpoint, cable: Cable) -> None:
        """SAFE and noise between them do not count; a number left out, and HELLO, begin the row anew."""
        before = status_of(host).lost_seq

        def stray() -> int:
            data, _ = host.link.format.encode(type_of(TimeSync), (host.tx.seq + 200) & 0xFFFF, 0, pack(TimeSync(1, 0)))
            host.link.send(data)
            assert isinstance(answers(host, 1)[0], TimeSync)
            return host.tx.seq

        def noise() -> None:
            if host.link.format is SERIAL:
                cable._link.send(b"\0\x02no frame\0")
            else:
                cable._link.send((HEAD.pack(0x42 << 4, 64, 5) + b"\xff" * 64).ljust(RECORD_SIZE, b"\0"))

        stray()
        for between in (lambda: status_of(host), noise, lambda: None):
            host.send(RegisterRead(1))
            between()
        host.send(RegisterRead(2))
        assert [m.register for m in answers(host, 1)] == [2]
        stray()
        for _ in range(3):
            host.send(RegisterRead(1))
        host.tx.seq = (host.tx.seq + 1) & 0xFFFF  # one is missing
        for _ in range(3):
            host.send(RegisterRead(1))
        assert answers(host, 1, QUIET_S) == []
        host.send(RegisterRead(3))
        assert [m.register for m in answers(host, 1)] == [3]
        stray()
        for _ in range(3):
            host.send(RegisterRead(1))
        assert isinstance(ask(host, HELLO), Identity)
        host.send(RegisterRead(4))
        assert [m.register for m in answers(host, 2, QUIET_S)] == [4]
        assert status_of(host).lost_seq == before + 600

    def test_a_message_of_which_a_part_is_missing(self, host: Endpoint, cable: Cable) -> None:
        """On CAN: counted once as a bad frame and once as a missing number; without its first part by its number
        only."""
        if host.link.format is SERIAL:
            pytest.skip("only CAN has parts")

        def parts() -> list[bytes]:
            payload = bytes(range(130))  # three parts; as long as no message of a host is
            data, _ = host.link.format.encode(type_of(RegisterRead), host.tx.seq, 0, payload)
            host.tx.seq = (host.tx.seq + 1) & 0xFFFF
            return [data[at : at + RECORD_SIZE] for at in range(0, len(data), RECORD_SIZE)]

        def counted(*records: bytes) -> tuple[int, int, list[NackReason]]:
            before = status_of(host)
            for record in records:
                host.link.send(record)
            heard = answers(host, 1, QUIET_S)
            client.read_register(host, "BLOCK", PATIENCE_S)
            after = status_of(host)
            refusals = [NackReason(m.reason) for m in heard if isinstance(m, Nack)]
            return after.bad_frames - before.bad_frames, after.lost_seq - before.lost_seq, refusals

        too_long = [NackReason.BAD_LENGTH]
        first, second, third = parts()
        assert counted(first, second, third) == (1, 0, too_long)
        first, second, third = parts()
        assert counted(first, first, second, first, second, third) == (1, 0, too_long)
        first, second, third = parts()
        assert counted(first, third) == (1, 1, [])
        first, second, third = parts()
        assert counted(first, second) == (1, 1, [])
        first, second, third = parts()
        assert counted(second, third) == (0, 1, [])
        first, second, third = parts()
        other = first[:16] + bytes(8) + first[24:]
        assert counted(other, second, first, second, third) == (2, 0, too_long)
        first, second, third = parts()
        safe, _ = host.link.format.encode(type_of(Safe), 0, 0, pack(Safe(SafeReason.LINK_LOST)))
        before = status_of(host).bad_frames
        for record in (first, safe, second, third):
            host.link.send(record)
        heard = answers(host, 2)
        assert [type(m) for m in heard] == [Status, Nack]
        assert status_of(host).bad_frames == before + 1

    # -------------------------------------------------------------------------------------------------- rule 6, 7, 1

    def test_only_drives_that_are_accepted_feed_the_watchdog(self, host: Endpoint) -> None:
        """Late ones and refused ones do not: fed at tick m, the last interval with force begins at m + W − 1."""
        _, first = self.lockstep(host, WATCHDOG_TICKS=20)
        tick = first[-1][0]
        heard = step(host, DriveForce(7, -8, tick + 1))
        for _ in range(60):
            if any(isinstance(m, Status) and m.state == State.SAFE for m in said(heard)):
                break
            late, refused = DriveForce(9, 9, tick), DriveGains(1, ZERO, (9.0, 9.0), tick + 1)
            host.send(refused)
            heard += step(host, late)
        heard += hear(host, lambda _: True)  # what was still on its way
        trips = [m for m in said(heard) if isinstance(m, Status) and m.state == State.SAFE]
        assert [m.reason for m in trips] == [SafeReason.WATCHDOG]
        driven = [row[0] for row in rows_of(heard) if row[1:3] != (0, 0)]
        assert driven == list(range(tick + 2, tick + 20 + 1))
        assert {row[1:3] for row in rows_of(heard)} <= {(0, 0), (7, -8)}
        assert status_of(host).reason == SafeReason.WATCHDOG
        assert client.arm(host, PATIENCE_S).state == State.ARMED  # it does not latch

    def test_a_repeated_drive_does_not_feed_the_watchdog(self, host: Endpoint) -> None:
        self.arm(host, paced=True)
        tick = set_running(host)
        again, _ = host.link.format.encode(
            type_of(DriveForce), (host.tx.seq - 1) & 0xFFFF, 0, pack(DriveForce(1, 1, tick + 30000))
        )
        until = time.monotonic() + 4 * 0.1  # four times the watchdog that `arm` sets
        heard = []
        while time.monotonic() < until:
            host.link.send(again)
            heard += host.poll(0.01)
        stops = [m for m in said(heard) if isinstance(m, Status) and m.state == State.SAFE]
        assert [m.reason for m in stops] == [SafeReason.WATCHDOG]

    def test_the_watchdog_has_a_ceiling(self, host: Endpoint) -> None:
        identity = client.connect(host, PATIENCE_S)
        most = min(int(2 * identity.tick_rate_Hz), SPEC.registers["WATCHDOG_TICKS"].maximum)
        assert client.write_register(host, "WATCHDOG_TICKS", most, PATIENCE_S) == most
        for bad in (most + 1, 2000001, 16777215):
            assert refusal(host, write("WATCHDOG_TICKS", bad)) is NackReason.OUT_OF_RANGE
        assert client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S) == most

    def test_a_lower_limit_holds_at_once(self, host: Endpoint) -> None:
        """For the drive that is held and for one that waits; raised again it brings nothing back."""
        _, first = self.lockstep(host)
        tick = first[-1][0]
        heard = step(host, DriveForce(1000, -999, tick + 1))
        host.send(DriveForce(-500, 400, tick + 6))  # waits
        heard += hear(host, lambda more: bool(rows_of(more)))
        heard += step(host, DriveForce(0, 0, tick))  # late: a tick passes
        assert rows_of(heard)[-1][1:3] == (1000, -999)
        assert refusal(host, write("DRIVE_LIMIT", 10)) is None
        after = step(host, DriveForce(0, 0, tick))
        assert refusal(host, write("DRIVE_LIMIT", 8388607)) is None
        for _ in range(4):
            after += step(host, DriveForce(0, 0, tick))
        echoed = {row[0]: row[1:3] for row in rows_of(after)}
        last = rows_of(heard)[-1][0]
        assert echoed[last + 1] == (10, -10)
        assert echoed[tick + 6] == (10, -10)
        assert echoed[tick + 7] == (-10, 10)
        assert all(row[3] & SenseFlags.SATURATED for row in rows_of(after))

    def test_a_drive_that_was_lowered_is_flagged_until_another_acts_and_not_counted(self, host: Endpoint) -> None:
        before = status_of(host).saturated
        _, first = self.lockstep(host)
        tick = first[-1][0]
        step(host, DriveForce(1000, 0, tick + 1))
        assert refusal(host, write("DRIVE_LIMIT", 10)) is None
        assert refusal(host, write("DRIVE_LIMIT", 8388607)) is None
        heard = step(host, DriveForce(20, 0, tick + 4))
        for _ in range(4):
            heard += step(host, DriveForce(0, 0, tick))
        shown = {row[0] - tick: (row[1], bool(row[3] & SenseFlags.SATURATED)) for row in rows_of(heard)}
        assert [shown[k] for k in range(2, 7)] == [(10, True), (10, True), (10, True), (20, False), (20, False)]
        assert status_of(host).saturated == before

    def test_a_lower_limit_holds_at_once_in_gain_mode(self, host: Endpoint) -> None:
        _, first = self.lockstep(host, LOOP_MODE=LoopMode.GAIN, BLOCK=8)
        assert [row[1:3] for row in first] == [(0, 0)] * 8
        heard = step(host, DriveGains(1, ZERO, (900.0, -800.0), 0), 8)
        heard += step(host, DriveGains(2, ZERO, (900.0, -800.0), 0), 8)
        assert rows_of(heard)[-1][1:3] == (900, -800)
        assert refusal(host, write("DRIVE_LIMIT", 12)) is None
        after = step(host, DriveGains(3, ZERO, (900.0, -800.0), 0), 8)
        assert [row[1:3] for row in rows_of(after)] == [(12, -12)] * 8
        assert rows_of(after)[0][3] & SenseFlags.SATURATED

    @pytest.mark.parametrize("mode", list(LoopMode))
    def test_nothing_is_left_of_a_drive_after_safe(self, host: Endpoint, mode: LoopMode) -> None:
        if mode is LoopMode.BOARD:
            self.nothing_is_left_of_an_estimators_drive(host)
            return
        self.lockstep(host, LOOP_MODE=mode)
        drive = DriveForce(300, 300, 0) if mode is LoopMode.FORCE else DriveGains(1, ZERO, (300.0, 300.0), 0)
        tick = host.rx.tick
        for k in range(1, 4):
            step(host, drive._replace(effective_tick=tick + k))
        if mode is LoopMode.FORCE:
            step(host, drive._replace(effective_tick=tick + 8))
        assert status(host, Safe(SafeReason.LINK_LOST))[0] == State.SAFE
        host.send(Arm())
        heard = hear(host, lambda heard: bool(rows_of(heard)))
        nothing = DriveForce(0, 0, 0) if mode is LoopMode.FORCE else DriveGains(2, ZERO, (0.0, 0.0), 0)
        for _ in range(12):
            heard += step(host, nothing)
        assert {row[1:3] for row in rows_of(heard)} == {(0, 0)}

    def nothing_is_left_of_an_estimators_drive(self, host: Endpoint) -> None:
        """Whatever its estimator computed before SAFE: behind ARM the force is zero until a drive is permitted."""
        self.lockstep(host, LOOP_MODE=LoopMode.BOARD)
        driven = []
        for _ in range(40):
            driven += rows_of(step(host, DriveBoard(1)))
        assert any(row[1:3] != (0, 0) for row in driven)
        assert status(host, Safe(SafeReason.LINK_LOST))[0] == State.SAFE
        host.send(Arm())
        heard = hear(host, lambda heard: bool(rows_of(heard)))
        for _ in range(12):
            heard += step(host, DriveBoard(0))
        assert {row[1:3] for row in rows_of(heard)} == {(0, 0)}

    # -------------------------------------------------------------------------------------------------- board mode

    def test_a_drive_of_another_mode_is_refused_whatever_the_state(self, host: Endpoint) -> None:
        assert refusal(host, DriveBoard(1)) is NackReason.BAD_STATE
        self.arm(host, paced=True)
        assert refusal(host, DriveBoard(1)) is NackReason.BAD_STATE

    def test_optional_messages_that_it_does_not_take_are_counted_and_passed_over(self, host: Endpoint) -> None:
        """No answer, however many come; each takes its number, and nothing else changes."""
        before = status_of(host)
        for type_ in (SPEC.messages["ESTIMATE"].type, *SPEC.optional_types):
            for size in (0, 3, SPEC.messages["ESTIMATE"].size):
                data, _ = host.link.format.encode(type_, host.tx.seq, 0, bytes(size))
                host.tx.seq = host.tx.seq + 1 & 0xFFFF
                host.link.send(data)
        assert answers(host, 1, QUIET_S) == []
        after = status_of(host)
        assert (after.state, after.lost_seq) == (before.state, before.lost_seq)
        counted = after.bad_frames - before.bad_frames
        assert counted == 9

    # -------------------------------------------------------------------------------------------------- force mode

    def test_the_first_drive_in_time_makes_it_run(self, host: Endpoint) -> None:
        """A late one is counted, not answered, and starts nothing; a tick passes for it all the same."""
        before = status_of(host).late
        _, first = self.lockstep(host)
        tick = first[-1][0]
        heard = step(host, DriveForce(5, 5, tick))
        heard += step(host, DriveForce(5, 5, tick - 40000))
        assert said(heard) == []
        assert [row[:3] for row in rows_of(heard)] == [(tick + 1, 0, 0), (tick + 2, 0, 0)]
        heard = step(host, DriveForce(5, 6, tick + 5))
        assert [(m.state, m.late) for m in said(heard)] == [(State.RUNNING, before + 2)]
        for _ in range(4):
            heard += step(host, DriveForce(0, 0, tick))
        echoed = {row[0]: row[1:3] for row in rows_of(heard)}
        assert [echoed[tick + k] for k in range(3, 8)] == [(0, 0), (0, 0), (0, 0), (5, 6), (5, 6)]

    def test_drives_wait_for_their_ticks(self, host: Endpoint) -> None:
        """Sixteen at least; a second one for a tick replaces the first."""
        _, first = self.lockstep(host)
        tick = first[-1][0]
        heard = []
        for k in range(16):
            heard += step(host, DriveForce(100 + k, -k, tick + 30 - k))
        assert not any(isinstance(m, Nack) for m in said(heard))
        heard += step(host, DriveForce(77, 77, tick + 20))
        while rows_of(heard)[-1][0] < tick + 32:
            heard += step(host, DriveForce(0, 0, tick))
        echoed = {row[0]: row[1:3] for row in rows_of(heard)}
        for k in range(13):  # those whose ticks had not come yet when they were sent
            assert echoed[tick + 31 - k] == ((77, 77) if k == 10 else (100 + k, -k))
        assert echoed[tick + 32] == echoed[tick + 31]  # held

    def test_an_effective_tick_is_ahead_by_up_to_65535(self, host: Endpoint) -> None:
        before = status_of(host).late
        _, first = self.lockstep(host)
        tick = first[-1][0]
        heard = step(host, DriveForce(1, 1, tick + 1 + 65536))
        assert said(heard) == []
        (running,) = said(step(host, DriveForce(1, 1, tick + 2 + 65535)))
        assert (running.state, running.late) == (State.RUNNING, before + 1)

    def test_held_flags_the_row_at_the_end_of_the_interval(self, host: Endpoint) -> None:
        before = status_of(host).held
        _, first = self.lockstep(host)
        tick = first[-1][0]
        heard = step(host, DriveForce(3, 4, tick + 1))
        for late in (True, True, False, True):
            newest = rows_of(heard)[-1][0]
            heard += step(host, DriveForce(5, 6, tick if late else newest + 1))
        flags = {row[0]: row[3] for row in rows_of(heard)}
        held = [t - tick for t, flag in flags.items() if flag & SenseFlags.HELD]
        # Of interval 1 the drive came in time; of 2 none; of 3 none (the third answer is for 4); of 4 it came.
        assert held == [3, 4]
        assert {row[0] - tick: row[1:3] for row in rows_of(heard)}[5] == (5, 6)
        assert status_of(host).held == before + 2

    def test_codes_are_limited_counted_and_flagged(self, host: Endpoint) -> None:
        before = status_of(host).saturated
        identity, first = self.lockstep(host, DRIVE_LIMIT=100)
        tick = first[-1][0]
        heard = step(host, DriveForce(2**31 - 1, -(2**31), tick + 1))
        heard += step(host, DriveForce(100, -100, tick + 2))
        heard += step(host, DriveForce(0, 0, tick + 3))
        shown = {row[0] - tick: (*row[1:3], bool(row[3] & SenseFlags.SATURATED)) for row in rows_of(heard)}
        assert (shown[2], shown[3]) == ((100, -100, True), (100, -100, False))
        client.write_register(host, "DRIVE_LIMIT", 8388607, PATIENCE_S)
        heard = step(host, DriveForce(2**31 - 1, -(2**31), tick + 4))
        heard += step(host, DriveForce(0, 0, tick + 5))
        most = 2 ** (identity.drive_bits - 1) - 1
        assert rows_of(heard)[-1][1:3] == (most, -most)
        assert status_of(host).saturated == before + 2

    # --------------------------------------------------------------------------------------------------- gain mode

    def test_gain_mode_wants_a_filter_that_fades(self, host: Endpoint) -> None:
        client.connect(host, PATIENCE_S)
        set_loop_mode(host, LoopMode.GAIN)
        names = ("FILTER_A11", "FILTER_A12", "FILTER_A21", "FILTER_A22")
        try:
            for a, taken in (
                ((16.0, 0.0, 0.0, 16.0), False),
                ((-16.0, 16.0, 16.0, -16.0), False),
                ((0.0, 1.0, -1.0, 0.0), False),
                ((1.0, 0.0, 0.0, 0.0), False),
                ((0.98, 16.0, 0.0, -0.98), True),
                ((16.0, 16.0, -16.0, -16.0), True),  # its square is zero
            ):
                for name, value in zip(names, a, strict=True):
                    client.write_register(host, name, value, PATIENCE_S)
                if taken:
                    assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)
                    assert status(host, Safe(SafeReason.LINK_LOST))[0] == State.SAFE
                else:
                    assert refusal(host, Arm()) is NackReason.OUT_OF_RANGE
            client.write_register(host, "FILTER_A11", -16.0, PATIENCE_S)
            set_loop_mode(host, LoopMode.FORCE)
            assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)  # which has no filter
        finally:
            status_of(host)
            for name in names:
                client.write_register(host, name, 0.0, PATIENCE_S)

    def test_matrices_that_are_refused(self, host: Endpoint) -> None:
        self.lockstep(host, LOOP_MODE=LoopMode.GAIN)
        most = 2.0**60
        for wrong in (
            DriveGains(0, ZERO, (0.0, 0.0), 1),
            DriveGains(1, (float("nan"), *ZERO[1:]), (0.0, 0.0), 1),
            DriveGains(1, (*ZERO[1:], 2.0 * most), (0.0, 0.0), 1),
            DriveGains(1, ZERO, (0.0, float("-inf")), 1),
            DriveGains(1, ZERO, (-2.0 * most, 0.0), 1),
        ):
            assert refusal(host, wrong) is NackReason.OUT_OF_RANGE
        assert refusal(host, DriveForce(1, 1, 1)) is NackReason.BAD_STATE
        assert status(host, Arm()) == (State.ARMED, SafeReason.NONE)  # still
        (running,) = said(step(host, DriveGains(1, (most,) * 8, (most, -most), 1)))
        assert running.state == State.RUNNING

    def test_the_other_loop_mode_s_drive_is_refused(self, host: Endpoint) -> None:
        _, first = self.lockstep(host)
        assert refusal(host, DriveGains(1, ZERO, (0.0, 0.0), 1)) is NackReason.BAD_STATE
        (running,) = said(step(host, DriveForce(1, 1, first[-1][0] + 1)))
        assert running.state == State.RUNNING

    def test_a_late_matrix_is_taken_from_the_next_tick_on(self, host: Endpoint) -> None:
        before = status_of(host).late
        self.lockstep(host, LOOP_MODE=LoopMode.GAIN, BLOCK=8)
        heard = step(host, DriveGains(9, ZERO, (5.0, 6.0), 0), 8)
        assert [(m.state, m.late) for m in said(heard)] == [(State.RUNNING, before + 1)]
        assert rows_of(heard)[-1][1:3] == (5, 6)

    def test_the_window_of_a_matrix(self, host: Endpoint) -> None:
        """m + 1 to m + 65 536 wait, what is further away has passed and is taken at once; with every latency."""
        before = status_of(host).late
        identity, first = self.lockstep(host, any_latency=True, LOOP_MODE=LoopMode.GAIN)
        tick = first[-1][0]

        def next_row(matrix: int, ahead: int) -> int:
            """The matrix in force at the next row, tick m + 1."""
            nonlocal tick
            drive = DriveGains(matrix, ZERO, (float(matrix), 0.0), (tick + ahead) & 0xFFFFFFFF)
            blocks = [item.message for item in step(host, drive) if isinstance(item.message, Sense)]
            tick += 1
            return blocks[-1].matrix_id

        assert next_row(1, 65536) == 0
        assert next_row(2, 2) == 0
        assert next_row(3, 65536) == 0  # in place of the one that waited
        assert next_row(4, 65537) == 4
        assert next_row(5, 0) == 5
        assert next_row(6, 1) == 6
        assert next_row(7, 2) == 6
        heard: list[Received] = []
        for _ in range(identity.latency_ticks + 2):
            heard += step(host, DriveGains(8, ZERO, (8.0, 0.0), (tick + 60000) & 0xFFFFFFFF))
        # Row m + 1 is computed with 6; what it leads to acts from m + 1 + L to m + 2 + L.
        shown = {row[0] - tick: row[1] for row in rows_of(heard)}
        assert shown[1 + identity.latency_ticks] == 6
        assert status_of(host).late == before + 2

    # --------------------------------------------------------------------------------------------------- registers

    def test_whole_numbers_are_not_rounded(self, host: Endpoint) -> None:
        for name, register in registers_of(host).items():
            before = client.read_register(host, name, PATIENCE_S)
            middle = register.minimum + 0.5
            if register.real:
                assert client.write_register(host, name, 0.1, PATIENCE_S) == 0.1
                assert client.read_register(host, name, PATIENCE_S) == 0.1
            else:
                assert refusal(host, write(name, middle)) is NackReason.OUT_OF_RANGE
            for bad in (register.maximum * 2 + 1, register.minimum - 1, float("nan"), float("inf")):
                assert refusal(host, write(name, bad)) is NackReason.OUT_OF_RANGE
            if register.real:
                client.write_register(host, name, before, PATIENCE_S)
            assert client.read_register(host, name, PATIENCE_S) == before

    def test_only_live_registers_change_while_it_streams(self, host: Endpoint) -> None:
        self.arm(host, paced=True)
        known = registers_of(host)
        self.arm(host, paced=True)
        for name, register in known.items():
            value = client.read_register(host, name, PATIENCE_S)
            assert written(host, name, value) is (None if register.live else NackReason.BAD_STATE)
            assert written(host, name, register.minimum - 1) is NackReason.OUT_OF_RANGE

    def test_a_block_needs_memory(self, host: Endpoint) -> None:
        client.write_register(host, "BLOCK", 1, PATIENCE_S)
        answer = refusal(host, write("BLOCK", 682))
        assert answer in (None, NackReason.NOT_SUPPORTED)
        assert client.read_register(host, "BLOCK", PATIENCE_S) == (682 if answer is None else 1)
        assert refusal(host, write("BLOCK", 683)) is NackReason.OUT_OF_RANGE
        client.write_register(host, "BLOCK", 1, PATIENCE_S)

    def test_clock_modes_that_a_board_keeps(self, host: Endpoint) -> None:
        identity = client.connect(host, PATIENCE_S)
        able = Capabilities(identity.capabilities)
        before = client.read_register(host, "CLOCK_MODE", PATIENCE_S)
        kept = {mode: refusal(host, write("CLOCK_MODE", mode)) for mode in ClockMode}
        assert set(kept.values()) <= {None, NackReason.NOT_SUPPORTED}
        assert (kept[ClockMode.LOCKSTEP] is None) is (Capabilities.LOCKSTEP in able)
        assert (kept[ClockMode.PACED] is None) is (Capabilities.PACED in able)
        assert kept[ClockMode(int(before))] is None
        if not able & (Capabilities.LOCKSTEP | Capabilities.PACED):
            assert kept[ClockMode.REAL] is None
        client.write_register(host, "CLOCK_MODE", before, PATIENCE_S)

    def test_a_change_of_the_clock_takes_no_tick_and_adds_none(self, host: Endpoint) -> None:
        """In lockstep ticks stand where they are; on wall time they go on from there."""
        identity, _ = self.lockstep(host)
        able = Capabilities(identity.capabilities)
        stood = status_of(host).tick
        time.sleep(QUIET_S)
        assert status_of(host).tick == stood
        if Capabilities.PACED not in able:
            pytest.skip("this board has lockstep only")
        client.write_register(host, "CLOCK_MODE", ClockMode.PACED, PATIENCE_S)
        begin = time.monotonic()
        first = status_of(host).tick
        assert 0 <= first - stood <= 2 + (time.monotonic() - begin + 0.1) * identity.tick_rate_Hz
        time.sleep(QUIET_S)
        passed = status_of(host).tick - stood
        assert passed == pytest.approx((time.monotonic() - begin) * identity.tick_rate_Hz, rel=0.5)
        client.write_register(host, "CLOCK_MODE", ClockMode.LOCKSTEP, PATIENCE_S)
        stood = status_of(host).tick
        time.sleep(QUIET_S)
        assert status_of(host).tick == stood
        host.send(Arm())
        heard = hear(host, lambda heard: bool(rows_of(heard)))
        assert rows_of(heard)[0][0] == stood + 1

    @pytest.mark.parametrize("nap_s", [0.0, 0.013, 0.017, QUIET_S])
    def test_on_wall_time_the_first_row_is_the_tick_after_that_of_armed(self, host: Endpoint, nap_s: float) -> None:
        """Ticks go on in every state; so STATUS in answer to ARM tells how many passed in SAFE."""
        if Capabilities.PACED not in Capabilities(client.connect(host, PATIENCE_S).capabilities):
            pytest.skip("this board has lockstep only")
        client.write_register(host, "CLOCK_MODE", ClockMode.PACED, PATIENCE_S)
        try:
            for _ in range(2):  # before the first ARM no tick passes
                client.arm(host, PATIENCE_S)
                hear(host, lambda heard: bool(rows_of(heard)))
                stopped = client.make_safe(host, SafeReason.LINK_LOST, PATIENCE_S)
                time.sleep(nap_s)
                host.poll(0.0)
                armed = client.arm(host, PATIENCE_S)
                first = rows_of(hear(host, lambda heard: bool(rows_of(heard))))[0]
                assert armed.tick > stopped.tick or nap_s < QUIET_S
                assert first[:3] == (armed.tick + 1, 0, 0)
                client.make_safe(host, SafeReason.LINK_LOST, PATIENCE_S)
        finally:
            client.write_register(host, "CLOCK_MODE", ClockMode.LOCKSTEP, PATIENCE_S)

    def test_codes_lie_within_their_converters(self, host: Endpoint) -> None:
        """Sense codes are signed and have the range that the bits say; drive codes ± the highest."""
        identity, _ = self.lockstep(host)
        end = 2 ** (identity.sense_bits - 1)
        tick = host.rx.tick
        blocks: list[Sense] = []
        for _ in range(100):
            heard = step(host, DriveForce(-(2**31), 2**31 - 1, tick + 1))
            tick = rows_of(heard)[-1][0]
            blocks += [item.message for item in heard if isinstance(item.message, Sense)]
        for sense in blocks:
            vx, vy = sense.codes[0, :2].tolist()
            assert -end <= vx < end
            assert -end <= vy < end
            if min(vx, vy) > -end and max(vx, vy) < end - 1:
                assert not sense.flags & SenseFlags.CLIPPED
        most = 2 ** (identity.drive_bits - 1) - 1
        assert blocks[-1].codes[0, 2:].tolist() == [-most, most]

    def test_the_session_stays_as_long_as_the_board(self, host: Endpoint) -> None:
        assert client.write_register(host, "SESSION", 0xFFFFFFFF, PATIENCE_S) == 0xFFFFFFFF
        self.arm(host)
        status(host, Safe(SafeReason.LINK_LOST))
        ask(host, Hello(SPEC.protocol, SPEC.hash ^ 1))
        client.connect(host, PATIENCE_S)
        assert client.read_register(host, "SESSION", PATIENCE_S) == 0xFFFFFFFF

    # --------------------------------------------------------------------------------------------------- refusals

    def test_what_is_refused_and_what_is_counted(self, host: Endpoint) -> None:
        """Unknown types and wrong lengths are; what only boards say, of any length, is not."""
        before = status_of(host)

        def raw(type_: int, payload: bytes) -> Nack:
            data, _ = host.link.format.encode(type_, host.tx.seq, 0, payload)
            number, host.tx.seq = host.tx.seq, host.tx.seq + 1 & 0xFFFF
            host.link.send(data)
            (nack,) = answers(host, 1)
            assert isinstance(nack, Nack)
            assert (nack.of_type, nack.of_seq) == (type_, number)
            return nack

        boards = [m for m in SPEC.messages.values() if m.sender == "board" and not m.rows and not m.optional]
        for layout in boards:
            sizes: tuple[int, ...] = (layout.size, layout.size + 1, 0)
            if layout.name == "STATUS" and host.link.format is not SERIAL:
                sizes = sizes[:1]  # our own end makes no other: a brief one goes with it
            for size in sizes:
                assert raw(layout.type, bytes(size)).reason == NackReason.NOT_SUPPORTED
        passed_over = ("SAFE", "ARM", "HELLO")
        hosts = [
            m for m in SPEC.messages.values() if m.sender != "board" and not m.optional and m.name not in passed_over
        ]
        for layout in hosts:
            for size in (layout.size + 1, layout.size - 1):
                assert raw(layout.type, bytes(size)).reason == NackReason.BAD_LENGTH
        assert raw(0x7E, b"").reason == NackReason.UNKNOWN_TYPE
        for line in (len(SPEC.table), 0xFFFF):
            assert ask(host, FieldRead(line)).reason == NackReason.OUT_OF_RANGE
        assert isinstance(ask(host, FieldRead(len(SPEC.table) - 1)), FieldValue)
        brief = SPEC.can.classic["STATUS_BRIEF"]  # what only CAN has, and passes over
        if host.link.format is SERIAL:
            assert raw(brief.type, bytes(brief.size)).reason == NackReason.UNKNOWN_TYPE
        else:
            identifier = HEAD.unpack_from(host.link.format.encode(brief.type, 0, 0, b"")[0])[0]
            host.link.send((HEAD.pack(identifier, 8, 0) + bytes(8)).ljust(RECORD_SIZE, b"\0"))
            assert answers(host, 1, QUIET_S) == []
        after = status_of(host)
        assert after.bad_frames == before.bad_frames + 2 * len(hosts) + 1 + (host.link.format is SERIAL)
        assert after.lost_seq == before.lost_seq

    # ------------------------------------------------------------------------------------------------------- fault

    def test_a_fault_stops_it_until_it_is_gone(self, host: Endpoint, cable: Cable, served: list[Board]) -> None:
        """No HELLO lifts it; a stop that came meanwhile stands beside it, and that one HELLO lifts."""
        if served[0].process is None:
            pytest.skip("this board cannot be switched off from here")
        cable.close()
        for first_s in (0.4, 1.6, 6.4):  # in the board's time: a slow machine needs more of it until a drive acts
            with self.fresh(served, partial(self.start_faulty, first_s, 2.0)) as new:
                heard = self.driven_until_it_stops(new)
                if not any(row[1:3] == (50, 50) for row in rows_of(heard)):
                    continue
                rate = client.connect(new, PATIENCE_S).tick_rate_Hz
                (stop,) = (m for m in said(heard) if isinstance(m, Status) and m.state == State.SAFE)
                assert stop.reason == SafeReason.FAULT
                assert stop.tick == pytest.approx(first_s * rate, abs=2)
                assert refusal(new, Arm()) is NackReason.LATCHED
                assert status(new, Safe(SafeReason.LINK_LOST)) == (State.SAFE, SafeReason.FAULT)
                assert status(new, Safe(SafeReason.RESIDUAL)) == (State.SAFE, SafeReason.FAULT)
                time.sleep(2.2)
                assert refusal(new, Arm()) is NackReason.LATCHED  # the stop, the fault being gone
                ask(new, HELLO)
                assert status(new, Arm()) == (State.ARMED, SafeReason.NONE)
                samples(new)
                return
        pytest.fail("no drive acted before the board's fault")

    def driven_until_it_stops(self, host: Endpoint) -> list[Received]:
        """All that the board says from ARM to SAFE while its host drives it with 50, 50; none where it is in SAFE
        already."""
        self.arm(host, paced=True)
        status(host, Safe(SafeReason.LINK_LOST))
        rate = client.connect(host, PATIENCE_S).tick_rate_Hz
        client.write_register(host, "WATCHDOG_TICKS", int(rate), PATIENCE_S)
        if refusal(host, Arm()) is NackReason.LATCHED:
            return []
        heard: list[Received] = []
        until = time.monotonic() + PATIENCE_S
        while not any(isinstance(m, Status) and m.state == State.SAFE for m in said(heard)):
            assert time.monotonic() < until
            news = host.poll(0.01)
            heard += news
            if rows_of(news):
                host.send_drive(50, 50, rows_of(news)[-1][0] + int(0.05 * rate))
        while answers(host, 1, QUIET_S):  # refusals of drives that crossed with it
            pass
        return heard

    def test_an_unhappy_end_of_the_client_is_one_line(self, host: Endpoint) -> None:
        """What a host says of a board that is latched."""
        self.arm(host)
        status(host, Safe(SafeReason.INTERRUPTED))
        with pytest.raises(ProtocolError, match="the board refused ARM: LATCHED"):
            client.arm(host, PATIENCE_S)
