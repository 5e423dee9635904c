"""An ADIS16505 behind an IIO daemon, emulated after libiio's own client: recorded, and refused in one line."""

import socketserver
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.records.capture import read_capture
from hil.records.rates import rates_rad_s
from hil.wire.errors import LinkError

AXES = [(f"{kind}_{axis}", "be:s32/32&gt;&gt;0") for kind in ("anglvel", "accel") for axis in "xyz"]
SCANNED = [*AXES, ("temp0", "be:s16/16&gt;&gt;0"), ("timestamp", "le:s64/64&gt;&gt;0")]
SCALES = {"anglvel": "0.000000006658", "accel": "0.000000037384", "temp0": "100.0"}
XML = (
    '<?xml version="1.0"?><context name="network"><device id="iio:device3" name="adis16505-2">'
    + "".join(
        f'<channel id="{name}" type="input"><scan-element index="{index}" format="{form}"/></channel>'
        for index, (name, form) in enumerate(SCANNED)
    )
    + "</device></context>"
).encode()
RATE_HZ = 400.0
ENDS_AT = 10**6  # samples after which it goes away


class Daemon(socketserver.StreamRequestHandler):
    """As iiod answers: a number in a line, then what it announces."""

    def handle(self) -> None:
        n = 0
        for line in self.rfile:
            word, *rest = line.decode().split()
            if word == "PRINT":
                self.wfile.write(b"%d\n%s\n" % (len(XML), XML))
            elif word == "READ":
                value = SCALES[rest[2].split("_")[0]].encode() + b"\0"
                self.wfile.write(b"%d\n%s\n" % (len(value), value))
            elif word == "OPEN":
                self.wfile.write(b"0\n" if rest[2] == "000000ff" else b"-22\n")
            elif word == "READBUF" and n >= ENDS_AT:
                return
            elif word == "READBUF":
                rows = b""
                while len(rows) < int(rest[1]):
                    rates = [round(value / 6.658e-9) for value in (-0.1, 0.2, 0.5)]
                    rows += struct.pack(">6ih6x", *rates, 0, 0, round(9.81 / 3.7384e-8), 250)
                    rows += struct.pack("<q", round(1.7e18 + n / RATE_HZ * 1e9))
                    n += 6 if n == 49 else 1
                time.sleep(8 / RATE_HZ)
                self.wfile.write(b"%d\n000000ff\n%s" % (len(rows), rows))


@pytest.fixture
def daemon() -> Iterator[str]:
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Daemon) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"iio:127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@pytest.mark.realtime
def test_a_gyro_behind_a_daemon_is_recorded(tmp_path: Path, daemon: str) -> None:
    run = hil.record(daemon, duration_s=0.5, out=tmp_path, report=False)
    capture = read_capture(run.path / "capture.arrow")
    assert (run.result.lost, run.path.name.endswith("adis16505-2")) == (5, True)
    assert capture.tick_rate_Hz == pytest.approx(RATE_HZ, rel=1e-3)
    assert [rates.mean() for rates in rates_rad_s(capture).values()] == pytest.approx([-0.1, 0.2, 0.5], abs=1e-7)
    assert np.all(capture.columns["temp_code"] * 0.1 == 25.0)


@pytest.mark.realtime
def test_a_daemon_that_goes_away_leaves_its_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, daemon: str
) -> None:
    monkeypatch.setattr("tests.sensors.test_iio.ENDS_AT", 150)
    run = hil.record(daemon, duration_s=5.0, out=tmp_path, report=False)
    assert (run.verdict, run.result.complete) == ("interrupted", True)
    assert run.result.samples >= 140
    assert "iio:127.0.0.1" in run.result.reasons[0]


def test_what_is_no_daemon_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, daemon: str) -> None:
    with pytest.raises(LinkError, match=r"iio:127.0.0.1:1: .*refused; does iiod run there\?"):
        hil.record("iio:127.0.0.1:1", out=tmp_path)
    for said, told in ((b"<context/>", "none of its devices has a buffer of angular rates"), (b"<x", "is no XML")):
        monkeypatch.setattr("tests.sensors.test_iio.XML", said)
        with pytest.raises(LinkError, match=told):
            hil.record(daemon, out=tmp_path)
