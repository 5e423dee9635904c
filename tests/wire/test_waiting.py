"""How long a host waits for an answer and how often it asks (docs/wire.md), by a clock that only waiting moves."""

from types import SimpleNamespace
from typing import Any

import pytest

from hil.wire import client, wire_log
from hil.wire.codec import pack, type_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError
from hil.wire.framing import encode_frame
from hil.wire.link import Link
from hil.wire.messages import Arm, Hello, Nack, NackReason, SafeReason, Status
from hil.wire.spec import SPEC
from hil.wire.stream import Receiver, Transmitter


class Waiting(Link):
    """A peer that is silent, or says `answer` after so many seconds; `asked` are the times at which it was told
    something, and what.
    """

    name = "waiting"

    def __init__(self, answer: bytes = b"", after_s: float = 0.0) -> None:
        self.now_s = 100.0
        self.asked: list[tuple[float, Any]] = []
        self._answer, self._after_s = answer, 100.0 + after_s
        self._heard = Receiver()

    def fileno(self) -> int:
        return 0

    def send(self, data: bytes) -> None:
        self.asked += [(self.now_s - 100.0, item.message) for item in self._heard.feed(data)]

    def receive(self, timeout_s: float | None) -> bytes:
        assert timeout_s is not None
        assert timeout_s >= 0.0
        if self._answer and self._after_s <= self.now_s + timeout_s:
            self.now_s, answer, self._answer = max(self.now_s, self._after_s), self._answer, b""
            return answer
        self.now_s += max(timeout_s, 1e-6)  # nobody asks twice at once
        return b""

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> Waiting:
    return watched(monkeypatch, Waiting())


def watched(monkeypatch: pytest.MonkeyPatch, link: Waiting) -> Waiting:
    """By its clock the client goes."""
    monkeypatch.setattr(client, "time", SimpleNamespace(monotonic=lambda: link.now_s))
    return link


def waited(link: Waiting) -> float:
    return pytest.approx(link.now_s - 100.0, abs=1e-4)


@pytest.mark.parametrize(
    "ask",
    [
        client.arm,
        client.read_field_table,
        lambda end, *wait: client.make_safe(end, SafeReason.LINK_LOST, *wait),
        lambda end, *wait: client.read_register(end, "BLOCK", *wait),
        lambda end, *wait: client.write_register(end, "BLOCK", 1.0, *wait),
        lambda end, *wait: client.request(end, Arm(), Status, *wait),
    ],
    ids=["arm", "read_field_table", "make_safe", "read_register", "write_register", "request"],
)
@pytest.mark.parametrize("timeout_s", [None, 0.5])
def test_a_request_is_sent_eight_times_within_the_time_it_has(ask, timeout_s: float | None, silent: Waiting) -> None:
    """Two seconds, where nobody says."""
    with pytest.raises(LinkError, match=r"no answer to .* within"):
        ask(Endpoint(silent), *([] if timeout_s is None else [timeout_s]))
    whole = timeout_s or 2.0
    assert waited(silent) == whole
    assert [when for when, _ in silent.asked] == pytest.approx([k * whole / 8 for k in range(8)], abs=1e-4)


def test_hello_is_said_four_times_a_second_for_two_seconds(silent: Waiting) -> None:
    with pytest.raises(LinkError, match="no answer to HELLO"):
        client.connect(Endpoint(silent))
    assert waited(silent) == 2.0
    assert [when for when, _ in silent.asked] == pytest.approx([0.25 * k for k in range(8)], abs=1e-4)
    assert {what for _, what in silent.asked} == {Hello(SPEC.protocol, SPEC.hash)}


def nack(of_type: int, of_seq: int = 0, reason: int = NackReason.BAD_STATE) -> bytes:
    return Transmitter().encode(Nack(of_type, of_seq, reason), 0)


def test_a_board_that_refuses_hello_is_asked_again_until_the_time_is_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may have been greeted twice; what is told then is the refusal."""
    link = watched(monkeypatch, Waiting(nack(type_of(Hello)), 0.3))
    with pytest.raises(client.Refused, match="the board refused HELLO: BAD_STATE") as refused:
        client.connect(Endpoint(link))
    assert refused.value.reason == NackReason.BAD_STATE
    assert waited(link) == 2.0


@pytest.mark.parametrize(
    "other",
    [nack(type_of(Arm)), encode_frame(type_of(Nack), 0, 0, b"\1\0"), Transmitter().encode(Arm(), 0)],
    ids=["a refusal of something else", "half a NACK", "another message"],
)
def test_what_is_no_refusal_of_hello_is_silence(monkeypatch: pytest.MonkeyPatch, other: bytes) -> None:
    link = watched(monkeypatch, Waiting(other, 0.3))
    with pytest.raises(LinkError, match="no answer to HELLO"):
        client.connect(Endpoint(link))


@pytest.mark.parametrize(("of_type", "of_seq"), [(type_of(Arm), 5), (type_of(Hello), 0)])
def test_a_refusal_is_of_the_type_and_of_a_number_that_was_sent(
    monkeypatch: pytest.MonkeyPatch, of_type: int, of_seq: int
) -> None:
    link = watched(monkeypatch, Waiting(nack(of_type, of_seq), 0.1))
    with pytest.raises(LinkError, match="no answer to ARM"):
        client.arm(Endpoint(link), 0.4)


def test_a_refusal_of_a_repeated_request_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    for of_seq in (0, 1, 2):
        link = watched(monkeypatch, Waiting(nack(type_of(Arm), of_seq), 0.12))
        with pytest.raises(client.Refused, match="refused ARM: BAD_STATE"):
            client.arm(Endpoint(link), 0.4)


# ----------------------------------------------------------------------------------------------------------- wire logs


class Clock:
    """In the place of `time`: only sleeping moves it."""

    def __init__(self) -> None:
        self.now_s = 50.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(wire_log, "time", found)
    return found


def test_a_log_ends_once_nothing_has_come_for_a_fifth_of_a_second(clock: Clock) -> None:
    log = wire_log.WireLog(object())
    clock.sleep(10.0)
    log.finish()
    assert clock.now_s == 60.0  # it was quiet already
    log.hear(None)
    clock.sleep(0.15)
    log.finish()
    assert 60.2 <= clock.now_s < 60.4
    assert log.lost == 0


def test_a_bus_that_does_not_fall_quiet_is_waited_for_a_minute(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    log = wire_log.WireLog(object())

    def sleep(seconds: float) -> None:
        clock.now_s += seconds
        log.hear(None)

    monkeypatch.setattr(clock, "sleep", sleep)
    log.finish()
    assert 60.0 <= clock.now_s - 50.0 < 60.5


def test_a_message_of_more_than_an_answer_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """What came before the answer and after it is there for the next call, in order."""
    tx = Transmitter()
    status = Status(2, 0, 0, 0, 0, 0, 0, 0, 0, 0)
    data = tx.encode(Hello(1, 1), 0) + tx.encode(status, 0) + tx.encode(Hello(2, 2), 0)
    end = Endpoint(watched(monkeypatch, Waiting(data, 0.1)))
    assert client.arm(end) == status
    assert [item.message for item in end.poll(0.0)] == [Hello(1, 1), Hello(2, 2)]
    assert pack(Hello(1, 1)) != pack(Hello(2, 2))
