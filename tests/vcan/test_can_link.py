"""What is particular to a Linux CAN interface: what can be wrong with it, stamps, classic frames of other nodes."""

import socket
import subprocess
import threading
import time
from collections.abc import Iterator

import can
import pytest

from hil.wire.can_format import CanFormat
from hil.wire.can_link import CanLink
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError
from hil.wire.frame_format import BOARD, HOST
from hil.wire.links import open_board_link, open_link
from hil.wire.messages import DriveForce, Hello, Nack, Safe, State, Status
from hil.wire.stream import Transmitter

pytestmark = pytest.mark.slow  # an interface, which `make quick` does not set up


@pytest.fixture
def ends() -> Iterator[tuple[Endpoint, Endpoint]]:
    """Host and board."""
    board, host = Endpoint(open_board_link("can:vcan0?node=1")), Endpoint(open_link("can:vcan0?node=1"))
    yield host, board
    host.close()
    board.close()


def test_both_directions_and_stamps(ends):
    host, board = ends
    before = time.monotonic_ns()
    host.send(Hello(1, 2))
    assert [item.message for item in board.poll(1.0)] == [Hello(1, 2)]
    board.send(Nack(1, 2, 3), 77)
    time.sleep(0.05)
    assert [(item.tick, item.message) for item in host.poll(1.0)] == [(77, Nack(1, 2, 3))]
    for end in ends:
        assert before < end.link.arrived_ns == end.received_ns < time.monotonic_ns()
    assert time.monotonic_ns() - host.received_ns > 40_000_000  # when it came, not when it was read
    assert host.poll(0.0) == board.poll(0.0) == []


def test_classic_frames_and_those_of_other_nodes(ends):
    """Any node may stop a board: `cansend vcan0 012#01`, 0x010 and twice the node."""
    _, board = ends
    board.rx.restart()
    for words in ("012#01", "010#01", "410##500112233", "1FFFFFFF#00", "012#R"):
        subprocess.run(["cansend", "vcan0", words], check=True)
    assert [item.message for item in board.poll(1.0)] == [Safe(1)]
    assert board.rx.bad == board.rx.lost == 0


def test_other_nodes_read_the_brief_status(ends):
    _, board = ends
    with can.Bus(interface="socketcan", channel="vcan0", fd=True) as other:
        board.send(Status(State.SAFE, 4, 0, 0, 0, 9, 0, 300, 0, 1234), 1234)
        frames = [other.recv(1.0), other.recv(1.0)]
    assert [(frame.arbitration_id, frame.is_fd, frame.dlc) for frame in frames] == [
        (0x313, True, 48),
        (0x333, False, 8),
    ]
    assert bytes(frames[1].data) == bytes([4, 4, 9, 255, 0xD2, 4, 0, 0])


def test_a_host_elsewhere_on_the_bus_is_noticed(vcan):
    """On another machine: its frames come by, but its claim does not show here."""
    done = threading.Event()

    def drive() -> None:
        data = Transmitter(CanFormat(2, HOST)).encode(DriveForce(1, 2, 3), 0)
        with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as wire:
            wire.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
            wire.bind(("vcan0",))
            while not done.wait(0.005):
                wire.send(data)

    other = threading.Thread(target=drive)
    other.start()
    try:
        with pytest.raises(LinkError, match=r"can:vcan0\?node=2: another host on this bus is using node 2"):
            open_link("can:vcan0?node=2")
        open_link("can:vcan0?node=3").close()
    finally:
        done.set()
        other.join()
    open_link("can:vcan0?node=2").close()


def test_a_second_board_on_a_node_is_refused(ends):
    with pytest.raises(LinkError, match="another board serves node 1 here; take another node"):
        open_board_link("can:vcan0?node=1")


def test_no_such_interface(vcan):
    with pytest.raises(LinkError, match=r"can:can7: no such CAN interface; .* \(found: vcan0\)"):
        open_link("can:can7")
    with pytest.raises(LinkError, match="no such CAN interface"):
        open_link("can:a-name-longer-than-any-interface")


def test_no_can_interface(vcan):
    with pytest.raises(LinkError, match=r"can:lo: lo is not a CAN interface \(found: vcan0\)"):
        open_link("can:lo")


def test_down(ip):
    ip("link", "set", "vcan0", "down")
    with pytest.raises(LinkError, match="can:vcan0: vcan0 is down: sudo ip link set vcan0 mtu 72 up") as caught:
        open_link("can:vcan0")
    assert "\n" not in str(caught.value)


def test_without_can_fd(ip):
    ip("link", "set", "vcan0", "down")
    ip("link", "set", "vcan0", "mtu", "16", "up")
    with pytest.raises(LinkError, match=r"vcan0 has no CAN FD \(its MTU is 16\): sudo ip link set vcan0 down && "):
        open_link("can:vcan0")


def test_goes_down_and_comes_up(ends, ip):
    host, board = ends
    ip("link", "set", "vcan0", "down")
    for end in ends:
        with pytest.raises(LinkClosed, match=r"can:vcan0\?node=1: the interface is down"):
            end.poll(1.0)
    with pytest.raises(LinkClosed, match="the interface is down"):
        host.send(Hello(1, 2))
    ip("link", "set", "vcan0", "up")
    host.send(Hello(1, 2))
    assert [item.message for item in board.poll(1.0)] == [Hello(1, 2)]


def test_what_finds_no_room_waits_or_is_lost(ends, monkeypatch):
    """A vcan always has room, so the kernel's answer is the test's."""
    host, board = ends
    full = iter([OSError(105, "No buffer space available")] * 3)
    put = CanLink._put

    def refuse(link: CanLink, datagram: bytes) -> None:
        if link is board.link and (error := next(full, None)) is not None:
            raise error
        put(link, datagram)

    monkeypatch.setattr(CanLink, "_put", refuse)
    board.send(Nack(1, 2, 3))
    assert [item.message for item in host.poll(1.0)] == [Nack(1, 2, 3)]
    full = iter([OSError(105, "No buffer space available")])
    board.link.drop_when_full = True
    data = Transmitter(CanFormat(1, BOARD)).encode(Nack(4, 5, 6), 0)
    board.link.send(data + data)
    assert board.link.dropped_bytes == 2 * len(data)
    assert host.poll(0.1) == []


def test_after_close(ends):
    for end in ends:
        end.close()
        end.close()
        with pytest.raises(LinkClosed, match="closed"):
            end.send(Hello(1, 2))
        with pytest.raises(LinkClosed, match="closed"):
            end.poll(0.0)
