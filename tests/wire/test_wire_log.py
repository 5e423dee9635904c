"""Wire logs: every frame of a CAN link, read back by python-can and decoded again."""

import time

import can
import pytest

from hil.wire.can_adapter import record_of
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError
from hil.wire.link_name import CanAdapter, CanInterface, parse_link
from hil.wire.links import open_board_link, open_link
from hil.wire.messages import Arm, Hello, Nack, Status
from hil.wire.stream import Receiver
from hil.wire.wire_log import wire_log

URL = "can:virtual:logged?node=1"


@pytest.mark.moderate
@pytest.mark.parametrize("ending", [".log", ".blf", ".asc"])
def test_what_was_said_is_in_the_log(tmp_path, ending):
    path = tmp_path / f"bus{ending}"
    host, board = Endpoint(open_link(URL)), Endpoint(open_board_link(URL))
    said = [Hello(1, 2), Arm()]
    answers = [Nack(2, 1, 3), Status(1, 0, 1, 2, 3, 4, 5, 6, 7, 8)]
    try:
        with wire_log(path, URL):
            for words, answer in zip(said, answers, strict=True):
                host.send(words)
                board.send(answer)
                time.sleep(0.05)
    finally:
        host.close()
        board.close()
    with can.LogReader(path) as log:
        records = b"".join(map(record_of, log))
    assert [item.message for item in Receiver(board.link.format).feed(records)] == said
    assert [item.message for item in Receiver(host.link.format).feed(records)] == answers


@pytest.mark.moderate
def test_what_was_said_last_is_in_the_log(tmp_path):
    """The log ends when the bus has fallen quiet, not with what is measured."""
    host, board = Endpoint(open_link(URL)), Endpoint(open_board_link(URL))
    try:
        with wire_log(tmp_path / "bus.log", URL):
            for _ in range(1000):
                host.send(Arm())
    finally:
        host.close()
        board.close()
    with can.LogReader(tmp_path / "bus.log") as log:
        assert len(list(log)) == 1000


@pytest.mark.moderate
def test_what_cannot_be_logged(tmp_path):
    for path, url, words in (
        ("bus.log", "serial:/dev/ttyACM0", "wire log: serial:/dev/ttyACM0 has no CAN frames to log; use a link can:"),
        ("bus.pcap", URL, "expected a name that ends in .log, .blf, .asc"),
        ("nowhere/bus.log", URL, "No such file or directory; give another file"),
        ("bus.log", "can:pcan:PCAN_USBBUS1", "wire log: can:pcan:PCAN_USBBUS1: "),
    ):
        with pytest.raises(LinkError) as caught, wire_log(tmp_path / path, url):
            pass
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_places():
    assert parse_link("can:can0") == CanInterface("can0")
    assert parse_link("can:can0?node=7") == CanInterface("can0", 7)
    adapter = CanAdapter("udp_multicast", "ff15::1", 1, (("port", "5"),))
    assert parse_link("can:udp_multicast:ff15::1?port=5&node=1") == adapter
