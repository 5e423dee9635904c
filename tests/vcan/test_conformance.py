"""Boards on a CAN interface: the emulated one and the C one, the same tests as on every other link."""

import os
import sys
import tempfile
import time
from pathlib import Path

import pytest

from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkClosed, LinkError
from tests.emulator.gyro import EXAMPLES
from tests.wire.conformance import Board, Conformance, samples, set_running, status_of

pytestmark = pytest.mark.slow  # an interface, which `make quick` does not set up

SLOWLY = ("sample_rate_Hz = 4000", "sample_rate_Hz = 500")
"""The one processor of user-mode Linux is not up to 4 kHz on wall time with both ends on it."""


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
        text = (EXAMPLES / "s-slow.scenario.toml").read_text(encoding="utf-8")
        assert SLOWLY[0] in text
        with tempfile.TemporaryDirectory() as place:
            scenario = Path(place, "slow.scenario.toml")
            scenario.write_text(text.replace(*SLOWLY), encoding="utf-8")
            return Board([sys.executable, "-W", "error", "-m", "device_emulator", str(scenario), "--link", "can:vcan0"])


@pytest.mark.usefixtures("c_board")
class TestCBoard(OnVcan):
    @classmethod
    def start(cls):
        return Board([os.environ["HIL_PTY_BOARD"], "--link", "can:vcan0?node=5"])
