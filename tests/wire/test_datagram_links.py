"""UDP and python-can links: frames of both ends, who may be there, what cannot be opened."""

import time
from collections.abc import Iterator

import can
import pytest

from hil.wire import can_link
from hil.wire.can_adapter import message_of
from hil.wire.can_format import CanFormat
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import HOST
from hil.wire.links import open_board_link, open_link
from hil.wire.messages import DriveForce, Hello, Nack, Safe
from hil.wire.stream import Transmitter
from tests.wire.multicast import group

UDP = f"udp:{group(0)}?interface=127.0.0.1"
HELLO = Transmitter().encode(Hello(1, 2), 0)
VIRTUAL = "can:virtual:test?node=2"


@pytest.fixture(params=[UDP, VIRTUAL], ids=["udp", "can"])
def url(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def ends(url: str) -> Iterator[tuple[Endpoint, Endpoint]]:
    """Host and board."""
    board, host = Endpoint(open_board_link(url)), Endpoint(open_link(url))
    yield host, board
    host.close()
    board.close()


def test_both_directions(ends, url):
    host, board = ends
    assert host.link.name == board.link.url == url
    host.send(Hello(1, 2))
    assert [item.message for item in board.poll(1.0)] == [Hello(1, 2)]
    board.send(Nack(1, 2, 3), 77)
    assert [(item.tick, item.message) for item in host.poll(1.0)] == [(77, Nack(1, 2, 3))]
    assert host.poll(0.0) == board.poll(0.0) == []


def test_several_frames_at_once(ends):
    host, board = ends
    host.send(Hello(1, 2))
    assert len(board.poll(1.0)) == 1
    data = b"".join(host.tx.encode(Safe(k % 7), 0) for k in range(50))
    host.link.send(data)
    got = []
    until = time.monotonic() + 2.0
    while len(got) < 50 and time.monotonic() < until:
        got += board.poll(0.1)
    assert [item.message for item in got] == [Safe(k % 7) for k in range(50)]
    assert board.link.offer(memoryview(Transmitter(board.link.format).encode(Nack(1, 2, 3), 0))) > 0
    assert [item.message for item in host.poll(1.0)] == [Nack(1, 2, 3)]


def test_one_host_and_one_board(ends, url):
    with pytest.raises(LinkError, match="another host on this machine has this link; end it there"):
        open_link(url)
    with pytest.raises(LinkError, match="another board serves"):
        open_board_link(url)
    ends[0].close()
    open_link(url).close()


def test_after_close(ends):
    for end in ends:
        end.close()
        end.close()
        with pytest.raises(LinkClosed, match="closed"):
            end.send(Hello(1, 2))
        with pytest.raises(LinkClosed, match="closed"):
            end.poll(0.0)


def test_udp_stamps_are_of_the_arrival():
    board, host = open_board_link(UDP), open_link(UDP)
    try:
        host.send(HELLO)
        assert board.receive(1.0) == HELLO
        time.sleep(0.2)  # a kernel that nobody else has asked begins to stamp a little after it was asked to
        before = time.monotonic_ns()
        board.send(b"\0abc\0")
        time.sleep(0.05)
        assert host.receive(1.0) == b"\0abc\0"
        assert before < host.arrived_ns < time.monotonic_ns() - 40_000_000
    finally:
        host.close()
        board.close()


def test_an_adapter_hears_a_host_on_another_machine():
    with can.Bus(interface="virtual", channel="test", protocol=can.CanProtocol.CAN_FD) as bus:
        drive = Transmitter(CanFormat(2, HOST)).encode(DriveForce(1, 2, 3), 0)
        task = bus.send_periodic(message_of(drive), 0.01)
        with pytest.raises(LinkError, match=r"can:virtual:test\?node=2: another host on this bus is using node 2"):
            open_link(VIRTUAL)
        open_link("can:virtual:test?node=3").close()
        task.stop()
    open_link(VIRTUAL).close()


def test_an_adapter_that_fails_says_so(monkeypatch):
    board = open_board_link("can:virtual:broken")

    def fail(*_: object, **__: object) -> None:
        raise can.CanOperationError("cable pulled\nout of its socket")

    monkeypatch.setattr(board._bus, "recv", fail)
    monkeypatch.setattr(board._bus, "send", fail)
    with pytest.raises(LinkClosed, match=r"can:virtual:broken: cable pulled$"):
        board.receive(2.0)
    with pytest.raises(LinkClosed, match=r"can:virtual:broken: cable pulled$"):
        Endpoint(board).send(Hello(1, 2))
    with pytest.raises(LinkError, match="cable pulled; see to the adapter and start again"):
        board.await_host()
    board.close()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("udp:192.168.1.4:4242", "expected a multicast group and a port, such as udp:239.0.0.1:4242"),
        ("udp:239.0.0.1", "expected a multicast group and a port"),
        ("udp:239.0.0.1:65535", "expected a multicast group and a port"),
        ("udp:239.0.0.1:4242?interface=203.0.113.9", "make a key with `hil key FILE`"),
        ("udp:239.0.0.1:4242?ttl=3", "bad option; expected udp:GROUP:PORT or"),
        ("udp:239.0.0.1:4242?key=", "bad option; expected udp:GROUP:PORT or"),
        ("udp:239.0.0.1:4242?interface=lo", "expected the address of one network interface"),
        ("udp:239.0.0.1:4242?interface=0.0.0.0", "expected the address of one network interface"),
        ("can:can0?bitrate=500000", "bad option; expected can:NAME or can:NAME?node=2"),
        ("can:can0?node=8", "node 8; expected 0 to 7"),
        ("can:can0?node=-1", "node -1; expected 0 to 7"),
        ("can:pcam:PCAN_USBBUS1", "python-can knows no interface 'pcam'; it knows "),
        ("can:socketcan:can0", "Linux interfaces are opened by their own name: can:can0"),
        ("can:pcan:PCAN_USBBUS1", "is its driver installed, the adapter plugged in?"),
        ("can:kvaser:0", "is its driver installed, the adapter plugged in?"),
    ],
)
def test_links_that_cannot_be_opened_say_why(url, words):
    for opened in (open_link, open_board_link):
        with pytest.raises(LinkError) as caught:
            opened(url)
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)


def test_boards_have_links_of_their_own():
    with pytest.raises(LinkError, match=r"link 'inproc:x': unknown kind of link; known are pty, can:…, udp:…"):
        open_board_link("inproc:x")


def test_a_kernel_without_can(monkeypatch):
    def refuse(*_: object) -> None:
        raise OSError(97, "Address family not supported by protocol")

    monkeypatch.setattr(can_link.socket, "socket", refuse)
    with pytest.raises(LinkError, match=r"can:can0: this kernel has no CAN; load it .*, or use an adapter"):
        open_link("can:can0")
