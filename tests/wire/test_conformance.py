"""The emulated board on every link. CAN on Linux has its own file, tests/vcan: not every kernel can."""

import os

import pytest

from hil.testing.board_rules.conformance import Board, Conformance
from hil.testing.board_rules.rules import Rules
from hil.testing.board_rules.served import leave
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import open_inproc
from hil.wire.key_file import make_key
from hil.wire.link_name import Emulated
from tests.emulator.gyro import EXAMPLES
from tests.forked import Forked
from tests.running import gyro
from tests.wire.served import emulated, tripped

from .multicast import group

pytestmark = pytest.mark.slow  # whole processes

UDP = f"udp:{group(1)}?interface=127.0.0.1"
CAN = "can:udp_multicast:{}?port={}&node=3".format(*group(2).split(":"))
SCENARIO = str(EXAMPLES / "s-slow.scenario.toml")


class InprocBoard(Board):
    """The entry point's board, a new one for every host."""

    def open(self):
        return open_inproc(Emulated("inproc", SCENARIO))


class TestInproc(Conformance):
    alone = True

    @classmethod
    def start(cls):
        return InprocBoard()


class TestPty(Conformance):
    @classmethod
    def start(cls):
        return emulated("pty", start=Forked)

    @classmethod
    def start_faulty(cls, first_s, duration_s):
        return emulated("pty", tripped(first_s, duration_s), start=Forked)


@pytest.mark.realtime  # a reader that lags loses datagrams
class TestUdp(Conformance):
    @classmethod
    def start(cls):
        return emulated(UDP)

    @classmethod
    def start_faulty(cls, first_s, duration_s):
        return emulated(UDP, tripped(first_s, duration_s))


@pytest.mark.realtime
class TestKeyedUdp(Conformance):
    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def _key(cls, tmp_path_factory):
        cls.key = tmp_path_factory.mktemp("key") / "board.key"
        make_key(cls.key)

    @classmethod
    def start(cls):
        return emulated(f"udp:{group(4)}?interface=127.0.0.1&key={cls.key}")


@pytest.mark.realtime
class TestPythonCan(Conformance):
    """python-can's CAN FD between processes, on the loopback interface."""

    @classmethod
    def start(cls):
        return emulated(CAN)

    @classmethod
    def start_faulty(cls, first_s, duration_s):
        return emulated(CAN, tripped(first_s, duration_s))


@pytest.mark.skipif("HIL_TEST_SERIAL" not in os.environ, reason="HIL_TEST_SERIAL=serial:/dev/ttyACM0 names a board")
class TestRealSerial(Conformance):
    @classmethod
    def start(cls):
        return Board(url=os.environ["HIL_TEST_SERIAL"])


def test_the_window_of_a_matrix_without_latency(tmp_path):
    path = gyro.scenario(tmp_path / "board.scenario.toml", drive={"latency_samples": 0})
    host = Endpoint(open_inproc(Emulated("inproc", str(path))))
    Rules().test_the_window_of_a_matrix(host)
    leave(host)
    host.close()
