"""What holds for every board on every link, seen from the host: subclass `Conformance` for yours.

A subclass says how its board is started; see tests/wire/test_conformance.py. The board is only spoken to over its link.
What of it docs/wire.md and docs/safety.md say of states, drives and registers is in `hil.testing.board_rules.rules`.
"""

import contextlib
import time
from collections.abc import Iterator

import pytest

from hil.testing.board_rules.rules import Rules
from hil.testing.board_rules.served import (
    PATIENCE_S,
    QUIET_S,
    Board,
    Cable,
    answers,
    drive,
    leave,
    require_safe,
    samples,
    set_loop_mode,
    set_running,
    status_of,
)
from hil.wire import client
from hil.wire.can_format import HEAD, RECORD_SIZE
from hil.wire.codec import type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError, ProtocolError
from hil.wire.framing import MAX_ENCODED
from hil.wire.messages import (
    Arm,
    Capabilities,
    ClockMode,
    Hello,
    Identity,
    LoopMode,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    SafeReason,
    State,
    Status,
    TimeSync,
)
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC

__all__ = ["Board", "Conformance", "samples", "set_running", "status_of"]

WATCHDOG = SPEC.registers["WATCHDOG_TICKS"].id
REQUESTS = 30


class Conformance(Rules):
    """Handshake, order, loss, duplicates, oversize, version mismatch, restart of either side, unplugging, two hosts."""

    alone = False
    """Whether the board lives and dies with its host, as one in the same process does."""

    @classmethod
    def start(cls) -> Board:
        """A board that is ready."""
        raise NotImplementedError

    @classmethod
    def start_faulty(cls, first_s: float, duration_s: float) -> Board:
        """A board whose own protection trips at a time of its bench, for so long."""
        pytest.skip("this board cannot be made to fail from here")

    @pytest.fixture(scope="class")
    @classmethod
    def served(cls) -> Iterator[list[Board]]:
        """The board of this class, in a list of one so that a test can replace it."""
        boards = [cls.start()]
        yield boards
        boards[0].end()

    @pytest.fixture
    def cable(self, served: list[Board]) -> Iterator[Cable]:
        cable = Cable(served[0].open())
        yield cable
        cable.close()

    @pytest.fixture
    def host(self, cable: Cable) -> Iterator[Endpoint]:
        """A host that has said HELLO to a board in SAFE."""
        host = Endpoint(cable)
        client.connect(host, PATIENCE_S)
        require_safe(host)
        yield host
        cable.outgoing = cable.incoming = list
        with contextlib.suppress(LinkClosed):
            leave(host)

    def arm(self, host: Endpoint, *, paced: bool = False) -> Identity:
        """Arm in lockstep, or on the board's own clock."""
        identity = client.connect(host, PATIENCE_S)
        able = Capabilities(identity.capabilities)
        lockstep = not paced and Capabilities.LOCKSTEP in able
        if paced and not able & Capabilities.PACED and able & Capabilities.LOCKSTEP:
            pytest.skip("this board waits for its host")
        clock = ClockMode.LOCKSTEP if lockstep else ClockMode.PACED if Capabilities.PACED in able else ClockMode.REAL
        client.write_register(host, "CLOCK_MODE", clock, PATIENCE_S)
        set_loop_mode(host, LoopMode.FORCE)
        for name in ("BLOCK", "DRIVE_LIMIT"):
            client.write_register(host, name, SPEC.registers[name].default, PATIENCE_S)
        client.write_register(host, "WATCHDOG_TICKS", max(int(0.1 * identity.tick_rate_Hz), 2), PATIENCE_S)
        client.arm(host, PATIENCE_S)
        return identity

    # -------------------------------------------------------------------------------------------------- conversation

    def test_handshake(self, host: Endpoint) -> None:
        first = client.connect(host, PATIENCE_S)
        assert (first.protocol, first.spec_hash) == (SPEC.protocol, SPEC.hash)
        assert first.tick_rate_Hz > 0
        assert first.axes in (1, 2)
        assert client.connect(host, PATIENCE_S) == first

    def test_registers(self, host: Endpoint) -> None:
        for value in (77, 78):
            assert client.write_register(host, "WATCHDOG_TICKS", value, PATIENCE_S) == value
            assert client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S) == value
        for bad in (0.0, 2.0**40, 1.5, float("nan"), float("inf")):
            with pytest.raises(ProtocolError, match="OUT_OF_RANGE"):
                client.write_register(host, "WATCHDOG_TICKS", bad, PATIENCE_S)
        assert client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S) == 78
        with pytest.raises(ProtocolError, match="UNKNOWN_REGISTER"):
            client.request(host, RegisterRead(0xFFFF), RegisterValue, PATIENCE_S)

    def test_a_loop_mode_that_the_board_lacks_is_not_supported(self, host: Endpoint) -> None:
        """And one that it names is taken; every board has the register, and starts with a mode that it names."""
        able = Capabilities(client.connect(host, PATIENCE_S).capabilities)
        named = {mode: Capabilities[f"{mode.name}_MODE"] in able for mode in LoopMode}
        assert named[LoopMode(int(client.read_register(host, "LOOP_MODE", PATIENCE_S)))]
        for mode, has in named.items():
            if has:
                assert client.write_register(host, "LOOP_MODE", mode, PATIENCE_S) == mode
                continue
            before = client.read_register(host, "LOOP_MODE", PATIENCE_S)
            with pytest.raises(client.Refused, match="NOT_SUPPORTED"):
                client.write_register(host, "LOOP_MODE", mode, PATIENCE_S)
            assert client.read_register(host, "LOOP_MODE", PATIENCE_S) == before
        with pytest.raises(client.Refused, match="OUT_OF_RANGE"):
            client.write_register(host, "LOOP_MODE", max(LoopMode) + 1.0, PATIENCE_S)

    def test_field_table(self, host: Endpoint) -> None:
        """Its lines are the longest messages: on CAN they come in parts."""
        assert client.read_field_table(host, PATIENCE_S) == SPEC.table

    def test_clock_comes_back(self, host: Endpoint) -> None:
        answer = client.request(host, TimeSync(2**63 + 5, 0), TimeSync, PATIENCE_S)
        again = client.request(host, TimeSync(6, 0), TimeSync, PATIENCE_S)
        assert (answer.host_ns, again.host_ns) == (2**63 + 5, 6)
        assert again.board_ns >= answer.board_ns

    def test_the_time_is_asked_without_waiting(self, host: Endpoint) -> None:
        """The answer is noted when it comes, between our own clock before and after, whoever reads it."""
        asked = [host.ask_time() for _ in range(3)]
        deadline = time.monotonic() + PATIENCE_S
        while len(host.exchanges) < 3 and time.monotonic() < deadline:
            host.receive_rows(0.05)
        noted = list(host.exchanges)
        assert [exchange.sent_ns for exchange in noted] == asked
        assert all(exchange.sent_ns <= exchange.received_ns <= time.monotonic_ns() for exchange in noted)
        assert noted[0].board_ns <= noted[1].board_ns <= noted[2].board_ns

    def test_safe_is_answered(self, host: Endpoint) -> None:
        assert status_of(host).state == State.SAFE

    def test_what_is_not_understood_is_refused(self, host: Endpoint) -> None:
        data, _ = host.link.format.encode(0x7E, host.tx.seq, 0, b"what?")
        unknown, host.tx.seq = host.tx.seq, host.tx.seq + 1
        host.link.send(data)
        assert answers(host, 1) == [Nack(0x7E, unknown, NackReason.UNKNOWN_TYPE)]
        data, _ = host.link.format.encode(type_of(Hello), host.tx.seq, 0, b"short")
        short, host.tx.seq = host.tx.seq, host.tx.seq + 1
        host.link.send(data)
        assert answers(host, 1) == [Nack(type_of(Hello), short, NackReason.BAD_LENGTH)]

    # ------------------------------------------------------------------------------------------ order, loss, repetition

    def test_order(self, host: Endpoint) -> None:
        before = status_of(host)
        identity = self.arm(host)
        drive(host, identity, 300)
        after = status_of(host)
        assert (host.rx.lost, host.rx.repeated, host.rx.bad) == (0, 0, 0)
        moved = {name: getattr(after, name) for name in ("reason", "tick", "held", "late", "saturated")}
        assert after == before._replace(**moved)

    def test_loss_towards_the_host_is_counted(self, host: Endpoint, cable: Cable) -> None:
        arrived: list[bytes] = []

        def lose(frames: list[bytes]) -> list[bytes]:
            kept = []
            for frame in frames:
                if cable.format.kind(frame) == type_of(RegisterValue):
                    arrived.append(frame)
                    if len(arrived) % 5 == 2:
                        continue
                kept.append(frame)
            return kept

        cable.incoming = lose
        for _ in range(REQUESTS):
            host.send(RegisterRead(WATCHDOG))
        assert len(answers(host, REQUESTS - REQUESTS // 5)) == REQUESTS - REQUESTS // 5
        assert answers(host, 1, QUIET_S) == []
        assert len(arrived) == REQUESTS
        assert (host.rx.lost, host.rx.repeated, host.rx.bad) == (REQUESTS // 5, 0, 0)

    def test_loss_towards_the_board_is_counted(self, host: Endpoint, cable: Cable) -> None:
        before = status_of(host).lost_seq
        cable.outgoing = lambda frames: []
        for _ in range(7):
            host.send(RegisterRead(WATCHDOG))
        cable.outgoing = list
        client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S)  # SAFE, which asks for the count, has no place in it
        assert status_of(host).lost_seq == before + 7

    def test_duplicates_are_dropped(self, host: Endpoint, cable: Cable) -> None:
        before = status_of(host)
        cable.outgoing = lambda frames: [frame for frame in frames for _ in range(3)]
        for _ in range(REQUESTS):
            host.send(RegisterRead(WATCHDOG))
        assert len(answers(host, REQUESTS)) == REQUESTS
        assert answers(host, 1, QUIET_S) == []
        cable.outgoing = list
        cable.incoming = lambda frames: [frame for frame in frames for _ in range(2)]
        for _ in range(REQUESTS):
            host.send(RegisterRead(WATCHDOG))
        assert len(answers(host, REQUESTS)) == REQUESTS
        assert answers(host, 1, QUIET_S) == []
        assert host.rx.repeated == REQUESTS
        cable.incoming = list
        after = status_of(host)
        assert (after.lost_seq, after.bad_frames) == (before.lost_seq, before.bad_frames)

    def test_nothing_is_used_out_of_order(self, host: Endpoint, cable: Cable) -> None:
        before = status_of(host).lost_seq
        held: list[bytes] = []

        def hold(frames: list[bytes]) -> list[bytes]:
            held.extend(frames)
            return []

        cable.outgoing = hold
        host.send(RegisterRead(1))
        host.send(RegisterRead(WATCHDOG))
        cable.outgoing = list
        cable.outgoing = lambda frames: held[::-1]
        cable.send(b"")
        cable.outgoing = list
        assert [answer.register for answer in answers(host, 2, QUIET_S)] == [WATCHDOG]
        assert status_of(host).lost_seq == before + 1

    # -------------------------------------------------------------------------------------------------- broken frames

    def test_damaged_frames_are_dropped_and_counted(self, host: Endpoint, cable: Cable) -> None:
        def damage(frames: list[bytes]) -> list[bytes]:
            return [frame[:9] + bytes([frame[9] ^ 0x55 or 1]) + frame[10:] for frame in frames]

        def shorten(frames: list[bytes]) -> list[bytes]:
            """CAN has its own checksum; what can be wrong is the length."""
            return [HEAD.pack(*HEAD.unpack_from(frame)[:1], 7, 5) + frame[8:] for frame in frames]

        before = status_of(host).bad_frames
        cable.outgoing = damage if cable.format is SERIAL else shorten
        for _ in range(5):
            host.send(RegisterRead(WATCHDOG))
        cable.outgoing = list
        assert answers(host, 1, QUIET_S) == []
        assert status_of(host).bad_frames == before + 5

    def test_oversize_is_dropped_and_counted(self, host: Endpoint, cable: Cable) -> None:
        before = status_of(host).bad_frames
        if cable.format is SERIAL:
            cable._link.send(b"\0" + b"\x55" * (MAX_ENCODED + 100) + b"\0")
        else:
            part, _ = cable.format.encode(type_of(RegisterRead), host.tx.seq, 0, bytes(56))
            parts = [part[:14] + bytes([56, k]) + part[16:RECORD_SIZE] for k in range(150)]
            cable._link.send(b"".join(parts) + part[RECORD_SIZE : RECORD_SIZE + 15] + bytes([150]) + part[-56:])
        assert client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S)
        assert status_of(host).bad_frames == before + 1

    def test_noise_changes_nothing(self, host: Endpoint, cable: Cable) -> None:
        before = client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S)
        noise = bytes(k * k % 251 for k in range(1, 50 * RECORD_SIZE + 1))
        if cable.format is SERIAL:
            for at in range(0, len(noise), 100):
                cable._link.send(b"\0" + noise[at : at + 100].replace(b"\0", b"\1") + b"\0")
        else:  # on a bus other people's frames are no noise; these have the identifiers of the board's own messages
            for k in range(50):
                head = HEAD.pack((k % 2 + 0x42) << 4, 64, 5)
                cable._link.send(head + noise[k * 64 : k * 64 + 64])
        assert client.connect(host, PATIENCE_S).protocol == SPEC.protocol
        assert client.read_register(host, "WATCHDOG_TICKS", PATIENCE_S) == before

    # ------------------------------------------------------------------------------------------------------- versions

    def test_version_mismatch(self, host: Endpoint) -> None:
        for hello in (Hello(SPEC.protocol + 1, SPEC.hash), Hello(SPEC.protocol, SPEC.hash ^ 1)):
            host.send(hello)
            (identity,) = answers(host, 1)
            assert (identity.protocol, identity.spec_hash) == (SPEC.protocol, SPEC.hash)
            with pytest.raises(ProtocolError, match="refused ARM: BAD_STATE"):
                client.request(host, Arm(), Status, PATIENCE_S)
            assert client.read_field_table(host, PATIENCE_S)[:3] == SPEC.table[:3]
        self.arm(host)

    # ------------------------------------------------------------------------------------------- restarts, unplugging

    def test_the_host_starts_again(self, host: Endpoint, cable: Cable, served: list[Board]) -> None:
        """Without a word, in the midst of a run."""
        if self.alone:
            pytest.skip("this board lives and dies with its host")
        identity = self.arm(host, paced=True)
        set_running(host)
        cable.close()
        time.sleep(0.05)
        again = Endpoint(served[0].open())
        try:
            assert client.connect(again, PATIENCE_S) == identity
            assert status_of(again).state == State.SAFE
            client.arm(again, PATIENCE_S)
            samples(again)
            status_of(again)
        finally:
            again.close()

    def test_the_board_starts_again(self, host: Endpoint, cable: Cable, served: list[Board]) -> None:
        if served[0].process is None:
            pytest.skip("this board cannot be switched off from here")
        self.arm(host, paced=True)
        served[0].end()
        served[0] = self.start()
        if served[0].url != cable.name:
            cable.close()
            host = Endpoint(served[0].open())
        identity = client.connect(host, PATIENCE_S)
        self.arm(host)
        drive(host, identity, 20)
        leave(host)
        host.close()

    def test_unplugged_and_plugged_in_again(self, host: Endpoint, cable: Cable) -> None:
        """The board's watchdog stops the drive; the host finds it where it was, its ticks gone on."""
        identity = self.arm(host, paced=True)
        tick = set_running(host)
        cable.outgoing = cable.incoming = lambda frames: []
        until = time.monotonic() + 0.4
        while time.monotonic() < until:
            assert host.receive_rows(0.05) == []
            host.send_drive(1, 1, tick)
        cable.outgoing = cable.incoming = list
        status = status_of(host)
        assert (status.state, status.reason) == (State.SAFE, SafeReason.WATCHDOG)
        client.arm(host, PATIENCE_S)
        assert samples(host)[0][0] > tick + 0.2 * identity.tick_rate_Hz

    def test_a_second_host_is_refused(self, host: Endpoint, served: list[Board]) -> None:
        if self.alone:
            pytest.skip("nobody else can reach this board")
        identity = self.arm(host)
        with pytest.raises(LinkError, match=r"another|in use") as caught:
            served[0].open()
        assert "\n" not in str(caught.value)
        drive(host, identity, 20)
        assert host.rx.lost == 0
