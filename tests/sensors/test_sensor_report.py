"""report.html of a recorded sensor: what it says beside what was put into the record."""

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import fftconvolve, lfilter

from hil.errors import InputError
from hil.records.capture import read_capture
from hil.records.rates import rates_layout, sensor_figures
from hil.records.result import Result, save_result
from hil.records.runfolder import RunFolder
from hil.records.stream import BlockWriter
from hil.report.figures.spectrum import amplitude_density
from hil.report.sensor import write_report
from hil.report.sensor.material import SensorMaterial
from hil.sensors.record import judge
from tests.records.test_report import checked
from tests.sensors.golden import RATE_RAD_S, Stim300

pytestmark = pytest.mark.slow  # whole pages

RATE_HZ = 250.0
Make = Callable[..., str]
only_words = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def page(tmp_path: Path) -> Make:
    """`page(rates in °/s (n, 3))`: the page of such a record as text, with what `hil record` would find in it."""

    def make(
        rates: np.ndarray, *, missing: tuple[int, ...] = (), status: int = 0, damaged: int = 0, latency_us: int = 500
    ) -> str:
        folder = tmp_path / "still"
        folder.mkdir(exist_ok=True)
        sensor = Stim300()
        layout = rates_layout(sensor.channels, tick_rate_Hz=RATE_HZ, device=sensor.title)
        rows = np.zeros(len(rates), layout.dtype)
        rows["tick"] = np.arange(len(rates))
        rows["status"], rows["latency_us"] = status, latency_us
        for column, rate in zip(sensor.channels, rates.T, strict=True):
            rows[column.name] = np.rint(np.radians(rate) / RATE_RAD_S)
        rows = np.delete(rows, list(missing))
        with BlockWriter(folder / "capture.arrow", layout) as writer:
            for start in range(0, len(rows), 1000):
                writer.push(rows[start : start + 1000])
        capture = read_capture(folder / "capture.arrow")
        figures = sensor_figures(capture, sensor.complaints, host_rate_Hz=RATE_HZ * (1 + 40e-6))
        result = Result(
            run="still",
            link="stim300:/dev/ttyUSB0",
            clock="real",
            seconds=float(capture.t_s[-1] - capture.t_s[0]) if len(capture) else 0.0,
            samples=len(capture),
            lost=capture.lost,
            counters={"crc_errors": damaged, "skipped_bytes": 18 * damaged},
            sensor=figures,
            operator_note="<b>on the table</b>",
            complete=capture.complete,
        )
        verdict, reasons, remarks = judge(result, figures, "")
        found = {"verdict": verdict, "reasons": tuple(reasons), "remarks": tuple(remarks)}
        save_result(folder / "result.json", result.model_copy(update=found))
        return write_report(folder).read_text(encoding="utf-8")

    return make


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the drawing, which is nearly all of the time, where only words are looked at."""
    monkeypatch.setattr("hil.report.markup.inline_svg", lambda *_: '<svg role="img"></svg>')


def noise(n: int, densities: tuple[float, ...] = (0.15, 0.3, 0.6), seed: int = 1) -> np.ndarray:
    """White noise of three axes in °/s, of these angle random walks in °/√h."""
    per_root_s = np.array(densities) / 60.0
    return per_root_s * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal((n, len(densities)))


def words(html: str) -> str:
    """The page without its markup and figures, spaces plain."""
    text = re.sub(r"<(svg|style)\b.*?</\1>", " ", html, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", text)).replace("\u00a0", " ").replace("\u202f", " ").split())


def test_the_page_is_whole_and_stands_alone(page: Make) -> None:
    html = page(noise(20_000))
    structure = checked(html)
    assert structure.cells == structure.headers + html.count("<td")
    assert re.findall(r"<b>Figure (\d)\. ([^<]+)\.</b>", html) == [
        ("1", "Rate"),
        ("2", "Allan deviation"),
        ("3", "Spectrum"),
    ]
    assert html.count('role="img"') == 3
    assert "<b>on the table</b>" not in html
    assert len(html) < 1e6


@only_words
def test_it_says_what_was_recorded_and_checked(page: Make) -> None:
    said = words(page(noise(20_000) + np.array([0.0, 12.5, 0.0])))
    assert "white noise by the differences of neighbouring samples" in said
    assert "Good. 20000 samples of 3 axes in 80.0 s, none lost, no wrong checksum." in said.replace("20 000", "20000")
    assert "Sensonor STIM300, STIM318: 3 axes (x, y, z), 250 samples a second by its own count" in said
    assert "40 ppm faster than that; a millisecond in which one arrives is 13 ppm of this record" in said
    assert "250.0100 Hz; nominal 250 Hz, +40 ppm" in said
    assert "samples missing by the sensor's counter 0 at most 0.1 % yes" in said
    assert "datagrams with a wrong checksum 0 at most 0.1 % yes" in said
    assert "status bits set none none yes" in said
    assert "500 · 500 · 500 µs p99.9 at most a sample, 4000 µs yes" in said
    assert "the sensor turned" not in said
    mean = re.search(r"most / \(deg/s\) x .* y (12\.\S+) (\S+) (\S+) 1", said)
    assert mean is not None
    assert float(mean[1]) == pytest.approx(12.5, abs=0.003)
    assert [float(mean[2]), float(mean[3])] == pytest.approx([1e3 * 0.3 / 60 * np.sqrt(RATE_HZ)] * 2, rel=0.03)


@only_words
def test_angle_random_walk_of_each_axis_in_its_unit(page: Make) -> None:
    said = words(page(noise(40_000)))
    found = re.findall(r"Axis (\w): angle random walk ([\d.]+) °/√h \(([\d.]+) to ([\d.]+)\); too short for the", said)
    assert [axis for axis, *_ in found] == ["x", "y", "z"]
    for true, (_, value, low, high) in zip((0.15, 0.3, 0.6), found, strict=True):
        assert float(value) == pytest.approx(true, rel=0.03)
        assert float(low) < float(value) < float(high)
    assert re.search(r"at τ = 11\.6 s, the longest of which there are ten clusters, .* It lies below [\d.]+ °/h", said)
    assert "Bias instability not shown below" in said


@only_words
def test_a_bias_that_wanders_is_told(page: Make) -> None:
    """A sum of slow fluctuations, B = 45 °/h (Kasdin, Proc. IEEE 83(5), 1995)."""
    rates = noise(100_000, (0.05, 0.05, 0.05))
    k = np.arange(1, len(rates))
    response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    drift = fftconvolve(response, np.random.default_rng(5).standard_normal(len(rates)))[: len(rates)]
    rates[:, 1] += 45.0 / 3600.0 * drift
    said = words(page(rates))
    found = re.search(
        r"Axis y: angle random walk [^;]+; bias instability ([\d.]+) °/h \(([\d.]+) to ([\d.]+)\), read", said
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(45.0, rel=0.15)
    assert "axis y, the largest that is determined" in said
    assert "y bias instability" in said


@only_words
def test_a_filter_in_the_sensor_is_told(page: Make) -> None:
    said = words(page(lfilter([0.25], [1.0, -1.0, 0.25], noise(60_000), axis=0)))
    found = re.search(
        r"Axis y: angle random walk ([\d.]+) °/√h \([^)]+\), from clusters of ([\d.]+) m?s on: shorter", said
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(0.3, rel=0.08)


@only_words
def test_a_record_that_failed_shows_where(page: Make) -> None:
    said = words(page(noise(2000), missing=(5, 6, 7, 900), status=0x12, damaged=9, latency_us=5000))
    assert "Failed. 4 samples are missing in the sensor's count, more than 0.1%" in said
    assert "samples missing by the sensor's counter 4 (0.20 %) in 2 gaps at most 0.1 % no" in said
    assert "datagrams with a wrong checksum 9 (0.45 %) at most 0.1 % no" in said
    assert "status: overload (y) in 1996 (100.00 %) samples none no" in said
    assert "p99.9 at most a sample, 4000 µs no" in said
    assert "Samples are missing: a cluster's mean is over those there are" in said


@only_words
def test_starting_up_is_no_fault(page: Make) -> None:
    said = words(page(noise(2000), status=0x40))
    assert "Good." in said
    assert "status: starting up in 2000 (100.00 %) samples Rate" not in said
    assert re.search(r"status: starting up in 2000 \(100\.00 %\) samples latency", said)


@only_words
def test_a_turning_sensor_has_no_noise_figures(page: Make) -> None:
    rates = noise(10_000)
    rates[:, 2] += 5.0 * np.sin(2 * np.pi * 0.5 * np.arange(len(rates)) / RATE_HZ)
    said = words(page(rates))
    assert re.search(r"spreads wider than its white noise, z by \d+(\.\d+)? times", said)
    assert "Axis z: not determined." in said
    assert "Axis x: angle random walk 0.1" in said


@only_words
def test_the_dashed_line_of_the_spectrum_is_its_level(page: Make, tmp_path: Path) -> None:
    """Two ways to the white noise: the spectrum's median is not far from √2 N."""
    page(noise(40_000))
    made = SensorMaterial(RunFolder.open(tmp_path / "still"))
    for axis, rate in made.rates_rad_s.items():
        _, density = amplitude_density(rate[:, None], RATE_HZ)
        level = np.sqrt(np.mean(density**2))
        assert level == pytest.approx(np.sqrt(2) * made.noise[axis].readings["white"].value, rel=0.03)


@pytest.mark.parametrize("n", [0, 1, 2, 3, 12, 60])
def test_next_to_nothing_still_has_a_page(page: Make, n: int) -> None:
    said = words(checked_and_kept(page(noise(n))))
    assert ("too short for an Allan deviation" in said) == (0 < n < 18)


@only_words
def test_a_sensor_that_never_changes_has_a_page(page: Make) -> None:
    said = words(checked_and_kept(page(np.zeros((500, 3)))))
    assert "every sample is the same" in said


def checked_and_kept(html: str) -> str:
    checked(html)
    return html


def test_a_folder_that_is_no_record_of_a_sensor_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no run folder"):
        write_report(tmp_path)
