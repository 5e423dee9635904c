"""The classes of tests that packages inherit, over what the bench has itself and over the example package."""

import os
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import pytest

from device_emulator.gyros import GYROS, stream
from hil.bench.examples import directory, find
from hil.boards.emulation import emulator
from hil.sensors.declared import protocols
from hil.sensors.stream_decoder import StreamDecoder
from hil.testing.conformance import AdapterConformance, LinkConformance
from hil.wire.links import open_link
from tests.sensors.golden import SIZE, Stim300, remainder


def datagram(counter: int) -> bytes:
    """A STIM300's, its checksum by long division."""
    body = bytes([0x90]) + (100 * counter).to_bytes(3, "big", signed=True) + bytes(7) + bytes([counter]) + bytes(2)
    return body + remainder(body + bytes(2)).to_bytes(4, "big")


class TestStim300(AdapterConformance):
    make = Stim300
    stream = b"".join(datagram(k) for k in range(20))
    samples = 20
    size = SIZE
    odds = 0.0


def _of(name: str) -> type[AdapterConformance]:
    """The tests of a declared gyro, over what the emulated one sends."""
    sent = [b"".join(one) for one in islice(stream(GYROS[name]), 24)]  # type: ignore[arg-type]
    told = {
        "make": partial(StreamDecoder, protocols()[name]), "stream": b"".join(sent), "samples": 24,
        "size": len(sent[0]), "odds": 1e-3,
    }  # fmt: skip
    return type("Declared", (AdapterConformance,), told)


# not of a text without a counter, nor of Xsens, whose channels depend on what is heard first
TestVectorNav, TestDmu11, TestHg4930S, TestIim46234 = _of("vn100"), _of("dmu11"), _of("hg4930s"), _of("iim46234")


class TestSerial(LinkConformance):
    @staticmethod
    def open(rest: str):
        return open_link(f"serial:{rest}")

    bad = ("", "/dev/absent", "/dev/null?baud=fast")

    @pytest.fixture
    def place(self) -> Iterator[str]:
        with emulator(find("scenario", "s-slow")) as board:
            yield board.url.removeprefix("serial:")


class TestInProcess(LinkConformance):
    @staticmethod
    def open(rest: str):
        return open_link(f"inproc:{rest}")

    bad = ("", "s-slow?latency=much")

    @pytest.fixture
    def place(self) -> str:
        return str(find("scenario", "s-slow"))


@pytest.mark.slow
def test_the_example_package_keeps_them() -> None:
    package = directory() / "doors"
    paths = [str(package), os.environ.get("PYTHONPATH", ""), str(Path(__file__).parents[2])]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error", str(package / "tests")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert "20 passed" in done.stdout
