"""`hil record` against the emulated STIM300 on a pty: a good record, a bad line, a sensor that complains or stops."""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from device_emulator.gyros import Gyro, stim
from hil import cli
from hil.errors import InputError
from hil.exporting.exported import channels
from hil.progress import Progress, untold
from hil.records.capture import Capture, read_capture
from hil.records.rates import rates_rad_s
from hil.records.result import Result, load_result
from hil.report import sensor
from hil.sensors.port import find_port
from hil.sensors.record import record
from hil.sensors.request import RecordRequest, request_of
from hil.wire.errors import LinkError
from tests.sensors.conftest import Install
from tests.sensors.spoken import spoken


@contextmanager
def emulated(*options: str) -> Iterator[tuple[str, "subprocess.Popen[str]"]]:
    """The link of an emulated sensor, and its process."""
    command = [sys.executable, "-m", "device_emulator.gyros", "stim300", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip().replace("ready serial:", "stim300:"), process
        process.terminate()


def go(tmp_path: Path, link: str, seconds: float = 1.0) -> tuple[Capture, Result]:
    request = request_of(link, {"duration_s": seconds, "name": "sensor", "note": "n"})
    folder = record(request, tmp_path, progress=untold)
    return read_capture(folder / "capture.arrow"), load_result(folder / "result.json")


@pytest.mark.realtime
def test_a_good_record(tmp_path: Path) -> None:
    with emulated("--sample-rate", "1000", "--rate", "-25", "--noise", "0.05") as (link, _):
        capture, result = go(tmp_path, link, 2.0)
    assert (result.verdict, result.reasons, result.complete) == ("good", (), True)
    assert (result.samples, result.lost, result.counters["crc_errors"]) == (2000, 0, 0)
    assert capture.tick.tolist() == list(range(2000))
    assert (capture.axes, capture.tick_rate_Hz) == (0, 1000.0)
    rates = rates_rad_s(capture)
    assert np.degrees(rates["z"].mean()) == pytest.approx(-25.0, abs=0.01)
    assert np.degrees(rates["x"]).mean() == pytest.approx(-1.0, abs=0.01)
    assert result.sensor is not None
    noise = result.sensor.channels["y"].noise_rad_s
    assert noise is not None
    assert np.degrees(noise) == pytest.approx(0.05, rel=0.1)
    assert result.sensor.latency_us is not None
    assert result.sensor.latency_us.p50 == 506
    assert list(channels(capture)) == ["t_s", "rate_x_rad_s", "rate_y_rad_s", "rate_z_rad_s"]


@pytest.mark.realtime
def test_a_counter_of_datagrams(tmp_path: Path) -> None:
    older = Gyro(lambda one: stim(one._replace(t_s=one.n / 2000.0), crlf=True), 250.0, 921600)
    with spoken(older) as path:
        capture, result = go(tmp_path, f"stim300:{path}")
    assert (result.verdict, result.samples, result.lost, capture.tick_rate_Hz) == ("good", 250, 0, 250.0)


@pytest.mark.realtime
def test_a_bad_line_is_counted_and_fails_the_record(tmp_path: Path) -> None:
    with emulated("--sample-rate", "2000", "--corrupted", "0.02", "--lost", "0.02") as (link, _):
        capture, result = go(tmp_path, link)
    assert result.verdict == "failed"
    assert result.lost == 2000 - result.samples == pytest.approx(80, abs=45)
    assert result.counters["crc_errors"] == pytest.approx(40, abs=30)
    assert "datagrams had a wrong checksum" in " ".join(result.reasons)
    assert "samples are missing in the sensor's count" in " ".join(result.reasons)
    assert np.degrees(rates_rad_s(capture)["z"]).std() < 0.05  # what is left is sound


@pytest.mark.realtime
def test_a_sensor_that_complains(tmp_path: Path) -> None:
    starting = Gyro(lambda one: stim(one._replace(status=0x54 if one.t_s < 0.2 else 0x14)), 500.0, 921600)
    with spoken(starting) as path:
        _, result = go(tmp_path, f"stim300:{path}")
    assert result.verdict == "failed"
    assert result.reasons == (f"the sensor reports: overload (z), in {result.samples} samples",)
    assert any("starting up" in remark for remark in result.remarks)


@pytest.mark.slow
def test_a_sensor_that_stops(tmp_path: Path) -> None:
    with emulated("--sample-rate", "500") as (link, process):
        port = find_port(link)

        def end(progress: Progress) -> None:
            process.terminate()

        folder = record(RecordRequest(port, link, 30.0, "sensor"), tmp_path, progress=end)
    result = load_result(folder / "result.json")
    assert (result.verdict, result.complete) == ("interrupted", True)
    assert "hung up" in result.reasons[0] or "fell silent" in result.reasons[0]
    assert result.samples > 50


@pytest.mark.long
def test_an_interrupted_record_has_its_page(tmp_path: Path) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.stage == "record":
            raise KeyboardInterrupt

    with emulated("--sample-rate", "500") as (link, _), pytest.raises(KeyboardInterrupt):
        record(request_of(link, {"duration_s": 30.0}), tmp_path, progress=interrupt, report=sensor.write_report)
    (page,) = tmp_path.glob("*/report.html")
    assert "Interrupted" in page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_nothing_to_hear(tmp_path: Path) -> None:
    from hil.wire.pty_link import open_pty

    line = open_pty()
    link = f"stim300:{line.path}"
    with pytest.raises(LinkError, match=r"nothing was heard in 2 s; check supply, wiring and \?baud="):
        go(tmp_path, link)
    line.close()
    assert list(tmp_path.glob("*sensor*")) == []


@pytest.mark.realtime
def test_the_verb(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with emulated("--rate", "5") as (link, _):
        assert cli.execute(["record", link, "--duration", "0.5", "--out", str(tmp_path)]) == 0
    told = capfd.readouterr().out
    assert "Sensonor STIM300, STIM318, 500.000 samples a second by its own clock" in told
    assert "lost, damaged" in told
    assert "verdict  good" in told
    (folder,) = tmp_path.iterdir()
    assert f"report   {folder / 'report.html'}" in told
    assert "Angle random walk" in (folder / "report.html").read_text(encoding="utf-8")
    with emulated("--corrupted", "0.2") as (link, _):
        assert cli.execute(["record", link, "--duration", "0.5", "--out", str(tmp_path), "--json", "--no-report"]) == 1
    assert json.loads(capfd.readouterr().out)["verdict"] == "failed"
    assert len(list(tmp_path.glob("*/result.json"))) == 2
    assert len(list(tmp_path.glob("*/report.html"))) == 1
    assert cli.execute(["record", "stim300:/dev/none", "--out", str(tmp_path)]) == 2
    assert "/dev/none: no such port" in capfd.readouterr().err


@pytest.mark.moderate
def test_links_of_adapters() -> None:
    port = find_port("stim300:/dev/ttyUSB0?baud=1843200")
    assert (port.path, port.baud, port.adapter.title) == ("/dev/ttyUSB0", 1_843_200, "Sensonor STIM300, STIM318")
    for wrong, told in (
        ("stim:/dev/ttyUSB0", "no adapter of that name; known: .*bosch-mm"),
        ("stim300:", "no adapter of that name"),
        ("stim300:/dev/ttyUSB0?baut=1", r"bad option; expected stim300:PATH or stim300:PATH\?baud=921600"),
    ):
        with pytest.raises((InputError, LinkError), match=told):
            find_port(wrong)


def test_an_adapter_from_another_package(install: Install) -> None:
    install("other", "tests.sensors.golden:Stim300")
    assert find_port("other:/dev/ttyUSB3").path == "/dev/ttyUSB3"


@pytest.mark.realtime
def test_the_library_records_as_the_command_line_does(tmp_path: Path) -> None:
    with emulated("--sample-rate", "1000", "--rate", "-25", "--noise", "0.05") as (link, _):
        run = hil.record(link, duration_s=1.0, note="n", report=False, out=tmp_path)
    assert (run.verdict, run.result.samples, run.result.operator_note) == ("good", 1000, "n")
    assert run.path.name.endswith("-stim300")


@pytest.mark.parametrize(
    ("link", "given", "said"),
    [
        ("banana:/dev/ttyUSB0", {}, "no adapter of that name; known: "),
        (7, {}, "link: expected a text such as stim300:/dev/ttyUSB0"),
        ("stim300:/dev/absent", {"duration_s": 0.0}, "duration_s=: 0 s; give a time above 0|duration_s: 0 s"),
        ("stim300:/dev/absent", {"duration_s": float("nan")}, "give a time above 0"),
    ],
)
def test_what_the_library_cannot_record_is_one_line(
    tmp_path: Path, link: Any, given: dict[str, float], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        hil.record(link, out=tmp_path, **given)
    assert not list(tmp_path.iterdir())


def test_an_adapter_whose_package_is_broken_is_one_line(install: Install) -> None:
    install("mygyro", "no_such_package:MyGyro")
    with pytest.raises(InputError, match=r"mygyro:/dev/ttyUSB0: no_such_package:MyGyro cannot be loaded: .*; mend or"):
        find_port("mygyro:/dev/ttyUSB0")
