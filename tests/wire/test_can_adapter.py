"""A python-can adapter on a bus that is busy while nobody reads the link."""

import threading
import time

import can
import pytest

from hil.wire.can_adapter import open_adapter
from hil.wire.errors import LinkClosed
from hil.wire.frame_format import HOST
from hil.wire.link_name import CanAdapter

FRAMES = 20_000
"""More than the socket between the reading thread and the link has room for."""


@pytest.mark.slow
def test_a_link_on_a_busy_bus_is_closed_although_nobody_reads() -> None:
    channel = "busy"
    link = open_adapter(CanAdapter("virtual", channel, 1), HOST)
    bus = can.Bus(channel=channel, interface="virtual", protocol=can.CanProtocol.CAN_FD)
    frame = can.Message(arbitration_id=0x100, is_extended_id=False, is_fd=True, data=bytes(64))
    for _ in range(FRAMES):
        bus.send(frame)
    time.sleep(0.3)  # until the reading thread stands before a full socket
    closing = threading.Thread(target=link.close, daemon=True)
    closing.start()
    closing.join(5.0)
    bus.shutdown()
    assert not closing.is_alive()
    with pytest.raises(LinkClosed, match="closed"):
        link.receive(0.0)
