"""Boards on a CAN interface: the emulated one and the C one, the same tests as on every other link."""

import os
import time

import pytest

from hil.testing.board_rules.conformance import Board, Conformance, samples, set_running, status_of
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError
from tests.forked import Forked
from tests.wire.served import emulated, tripped

pytestmark = pytest.mark.slow  # an interface, which `make quick` does not set up


def hear_nothing_more(host: Endpoint) -> None:
    """Listen for a second."""
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        host.receive_rows(0.1)


class OnVcan(Conformance):
    """What a CAN interface adds: it can go down, and come up again."""

    def test_the_interface_goes_down_and_up(self, host, cable, served, ip):
        """The host is told at once; the board lives on and goes to SAFE."""
        identity = self.arm(host, paced=True)
        tick = set_running(host)
        ip("link", "set", "vcan0", "down")
        with pytest.raises(LinkClosed, match=r"can:vcan0.*: the interface is down"):
            hear_nothing_more(host)
        with pytest.raises(LinkError, match=r"can:vcan0.* is down: sudo ip link set vcan0 mtu 72 up"):
            served[0].open()
        ip("link", "set", "vcan0", "up")
        cable.close()
        again = Endpoint(served[0].open())
        assert client.connect(again, 5.0) == identity
        status_of(again)
        client.arm(again, 5.0)
        assert samples(again)[0][0] > tick
        status_of(again)
        again.close()


class TestEmulatedBoard(OnVcan):
    @classmethod
    def start(cls):
        return emulated("can:vcan0", start=Forked)  # a new interpreter takes ten seconds in the machine inside

    @classmethod
    def start_faulty(cls, first_s, duration_s):
        return emulated("can:vcan0", tripped(first_s, duration_s), start=Forked)


@pytest.mark.usefixtures("c_board")
class TestCBoard(OnVcan):
    @classmethod
    def start(cls):
        return Board([*cls.command()])

    @classmethod
    def start_faulty(cls, first_s, duration_s):
        return Board([*cls.command(), "--fault", f"{first_s}:{duration_s}"])

    @staticmethod
    def command():
        """As many ticks a second as the emulated board of these tests: the machine inside is ten times slower."""
        return os.environ["HIL_PTY_BOARD"], "--link", "can:vcan0?node=5", "--sample-rate", "500"
