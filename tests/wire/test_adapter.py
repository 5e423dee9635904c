"""What a link makes of a python-can adapter, with a bus of its own: how it is opened, sent to, read and given back."""

import threading
import time
from collections.abc import Iterator
from typing import Any

import can
import pytest

from hil.wire import can_adapter
from hil.wire.can_adapter import AdapterLink, message_of, open_adapter, open_bus, record_of
from hil.wire.can_format import CanFormat
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import HOST
from hil.wire.link import Claim
from hil.wire.link_name import CanAdapter
from hil.wire.messages import Arm, Hello
from hil.wire.stream import Transmitter

HELLO = Transmitter(CanFormat(2, HOST)).encode(Hello(1, 2), 0)
ARM = Transmitter(CanFormat(2, HOST)).encode(Arm(), 0)
NAME = "can:pcan:PCAN_USBBUS1?node=2"


class Bus:
    """In the place of an adapter: `arrives` comes, `sent` went."""

    def __init__(self) -> None:
        self.arrives: list[can.Message] = []
        self.sent: list[tuple[can.Message, float | None]] = []
        self.fails: Exception | None = None
        self.waits: list[float] = []
        self.shutdowns = 0
        self.ready = threading.Event()

    def recv(self, timeout: float) -> can.Message | None:
        self.waits.append(timeout)
        if self.fails is not None:
            raise self.fails
        if self.arrives:
            return self.arrives.pop(0)
        self.ready.wait(0.005)
        return None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.fails is not None:
            raise self.fails
        self.sent.append((message, timeout))

    def shutdown(self) -> None:
        self.shutdowns += 1


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    found = Bus()
    monkeypatch.setattr(can_adapter, "LISTEN_S", 0.03)

    def opened(**how: Any) -> Bus:
        found.how = how
        return found

    monkeypatch.setattr(can, "Bus", opened)
    return found


@pytest.fixture
def link(bus: Bus) -> Iterator[AdapterLink]:
    found = open_adapter(CanAdapter("pcan", "PCAN_USBBUS1", 2, (("bitrate", "500000"),)), HOST)
    yield found
    found.close()


@pytest.mark.parametrize(
    ("interface", "kind"), [("pcan", {"fd": True}), ("virtual", {"protocol": can.CanProtocol.CAN_FD})]
)
def test_a_bus_is_opened_with_can_fd_and_the_options_of_the_name(
    bus: Bus, interface: str, kind: dict[str, Any]
) -> None:
    options = (("bitrate", "500000"), ("f_clock_mhz", "0.8"), ("nom_sam", "A7x"), ("receive_own_messages", "True"))
    assert open_bus("log", CanAdapter(interface, "one", 0, options)) is bus
    assert bus.how == {
        "channel": "one", "interface": interface, "ignore_config": True, **kind,
        "bitrate": 500000, "f_clock_mhz": 0.8, "nom_sam": "A7x", "receive_own_messages": True,
    }  # fmt: skip
    assert type(bus.how["bitrate"]) is int


@pytest.mark.parametrize("what", [can.CanError("no\nway."), ImportError("no"), ValueError("no"), NotImplementedError()])
def test_a_bus_that_cannot_be_opened_is_one_line(monkeypatch: pytest.MonkeyPatch, what: Exception) -> None:
    def fail(**_: Any) -> None:
        raise what

    monkeypatch.setattr(can, "Bus", fail)
    for _ in range(2):  # the name is free again
        with pytest.raises(LinkError) as told:
            open_adapter(CanAdapter("pcan", "PCAN_USBBUS1", 2), HOST)
        said = str(what).partition("\n")[0] or "NotImplementedError"
        assert str(told.value) == f"{NAME}: {said}; is its driver installed, the adapter plugged in?"


@pytest.mark.parametrize(("drop", "wait_s"), [(False, 1.0), (True, None)])
def test_each_record_is_sent_and_waited_for_unless_the_board_cannot_wait(
    link: AdapterLink, bus: Bus, drop: bool, wait_s: float | None
) -> None:
    link.drop_when_full = drop
    assert link.offer(memoryview(HELLO + ARM)) == 144
    assert [(record_of(message), timeout) for message, timeout in bus.sent] == [(HELLO, wait_s), (ARM, wait_s)]


def test_what_arrives_is_read_in_order_and_error_frames_are_passed_over(link: AdapterLink, bus: Bus) -> None:
    bus.arrives = [message_of(HELLO), can.Message(is_error_frame=True), message_of(ARM)]
    got = b""
    while len(got) < 144:
        got += link.receive(5.0) or b"!"
    assert got == HELLO + ARM
    assert set(bus.waits[-2:]) == {0.1}
    begin = time.monotonic()
    assert link.receive(0.03) == b""
    assert time.monotonic() - begin >= 0.03


def test_closed_it_gives_adapter_and_name_back_once(bus: Bus) -> None:
    link = open_adapter(CanAdapter("pcan", "PCAN_USBBUS1", 2), HOST)
    link.close()
    link.close()
    assert (bus.shutdowns, link.fileno()) == (1, -1)
    assert not any(thread.name == NAME for thread in threading.enumerate())
    for attempt in (lambda: link.send(HELLO), lambda: link.receive(0.0), lambda: link.offer(HELLO)):
        with pytest.raises(LinkClosed, match="the link is closed"):
            attempt()
    Claim("can/pcan:PCAN_USBBUS1/2/0", NAME, "end it").release()


@pytest.mark.parametrize("kind", ["is_extended_id", "is_remote_frame"])
def test_other_kinds_of_frames_have_no_identifier_of_ours(kind: str) -> None:
    identifier = record_of(can.Message(arbitration_id=5, **({"is_extended_id": False} | {kind: True})))[:4]
    assert int.from_bytes(identifier, "little") == 5 | {"is_extended_id": 1 << 31, "is_remote_frame": 1 << 30}[kind]


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("switch", [False, True])
def test_a_record_is_a_frame_and_back(fd: bool, switch: bool) -> None:
    """linux/can.h: identifier, length, flags (bit-rate switch 1, CAN FD 4), two bytes of nothing, data."""
    message = can.Message(
        arbitration_id=0x123, is_extended_id=False, is_fd=fd, bitrate_switch=switch, data=b"\1\2\3", check=False
    )
    record = record_of(message)
    assert record == bytes([0x23, 1, 0, 0, 3, switch | fd << 2, 0, 0, 1, 2, 3]).ljust(72, b"\0")
    back = message_of(record)
    assert (back.arbitration_id, back.is_extended_id, back.is_fd, back.bitrate_switch, bytes(back.data)) == (
        0x123, False, fd, switch, b"\1\2\3"
    )  # fmt: skip
