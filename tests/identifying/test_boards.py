"""Emulated boards identified: keys within their intervals, and boards that are not as they say named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from estimator.identify.model import NAMES
from evaluation.identifying.__main__ import here
from evaluation.identifying.boards import draw, written
from hil.identifying.identify import Identified, identify
from hil.identifying.options import LocalIdentifyOptions
from hil.identifying.request import request_of
from hil.progress import untold
from hil.records.runfolder import RunFolder
from hil.running.safety.drives import drives

pytestmark = pytest.mark.slow

_SEED = 1006  # 2 ticks, 60 dB
_TICK = "late"


def identified(folder: Path, effect: str = "", **options: Any) -> Identified:
    """The loop in this process: a new interpreter for each part of an experiment costs more than the experiment."""
    drawn = draw(_SEED)
    rate = float(drawn.text.split("sample_rate_Hz = ")[1].split()[0])
    scenario = written(drawn, folder, "board")
    if effect:
        scenario.write_text(f"{drawn.text}\n[[effect]]\n{effect.replace(_TICK, repr(1.0 / rate))}\n", encoding="utf-8")
    mass = float(drawn.text.split("mass_kg = ")[1].split()[0])
    place = folder / "my.bench.toml"
    given: LocalIdentifyOptions = {"mass_kg": mass, "replace": True, **options}  # type: ignore[typeddict-item]
    return identify(request_of(f"inproc:{scenario}", place, given), folder, untold, run=here)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bench file of the board as it says that it is."""
    folder = tmp_path_factory.mktemp("good")
    done = identified(folder)
    drawn, found = draw(_SEED), done.findings
    z = np.array([(found.value(name) - drawn.truth[name]) / found.u(name) for name in NAMES])
    assert np.max(np.abs(z)) < 4.0
    assert np.sum(np.abs(z) < 1.96) >= 11
    assert found.latency_ticks == drawn.latency
    assert not found.faults
    assert done.bench is not None
    for place in done.folder.glob("*/capture.arrow"):
        record = RunFolder(place.parent).capture
        assert record is not None
        drive, beyond = np.abs(record.drive).max(), np.abs(record.sense_V) > found.limit_V
        assert 0.0 < drive <= found.largest_mps2 * (1.0 + 1e-9)
        assert beyond.mean() < 0.01
    page = (done.folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure") == 3
    declared = hil.load_bench(done.bench)
    assert (declared.device.name, declared.loop.name) == ("my", "my")
    return done.bench


def test_the_file_has_every_required_key_and_says_what_is_not_told(good: Path) -> None:
    bench = hil.load_bench(good)
    assert isinstance(bench, hil.Bench)
    text = good.read_text(encoding="utf-8")
    assert "REQUIRED" not in text
    assert text.count("NOT TOLD") == 4
    assert "± [" in text
    assert dict(drives(bench, "serial:/dev/ttyACM0"))["watchdog"] == "0.02 s"


def test_its_record_alone_gives_the_same(tmp_path: Path, good: Path) -> None:
    (measured,) = good.parent.glob("*/*-measure")
    mass = float(draw(_SEED).text.split("mass_kg = ")[1].split()[0])
    again = hil.identify(record=[str(measured)], out=tmp_path, mass_kg=mass).findings
    bench = hil.load_bench(good)
    assert isinstance(bench, hil.Bench)
    assert again.value("gain_x") == pytest.approx(bench.device.sense_gains_V_per_m[0], rel=1e-9)


WRONG = {
    "one tick late": ('name = "drive_delay"\ntux = late\ntuy = late', False, "ticks later"),
    "sense one tick late": ('name = "sense_delay"\ntsx = late\ntsy = late', False, "ticks later"),
    "drive x turned round": ('name = "drive_polarity"\npx = 1.0\npy = 0.0', False, "unlike signs"),
    "sense y turned round": ('name = "sense_polarity"\npx = 0.0\npy = 1.0', False, "unlike signs"),
    "both turned round": ('name = "drive_polarity"\npx = 1.0\npy = 1.0', True, "wrong way round"),
    "sense scale twice": ('name = "sense_gain"\ngx = 1.0\ngy = 1.0', True, "× the declared gain"),
    "drive scale half": ('name = "drive_gain"\nhx = -0.5\nhy = -0.5', True, "× the declared gain"),
    "channels exchanged": ('name = "sense_cross_coupling"\nex = 3.0\ney = 3.0', False, "exchange the channels"),
    "drive is cut off": ('name = "drive_gain"\nhx = -1.0\nhy = -1.0', False, "moves nothing"),
}


@pytest.mark.beyond(4)
@pytest.mark.parametrize("kind", WRONG)
def test_a_board_that_is_not_as_it_says_is_named_and_gets_no_file(tmp_path: Path, good: Path, kind: str) -> None:
    effect, declared, words = WRONG[kind]
    options = {"like": str(good)} if declared else {}
    done = identified(tmp_path, effect, **options)
    assert any(words in fault for fault in done.findings.faults), done.findings.faults
    assert done.bench is None
    assert not done.good
    assert not (tmp_path / "my.bench.toml").exists()
