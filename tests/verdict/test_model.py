"""The model's part of the verdict: the closing scan's answer, and the command that comes next."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from hil.bench import override
from hil.records.capture import Capture
from hil.records.estimates import Innovation
from hil.records.result import BoardClock, Result, SampleRate, Scan
from hil.records.runfolder import RunFolder
from hil.verdict.model import faults_of, judge_model
from tests.running import gyro


def result(complete: bool | None, *, ratio: float = 1.0) -> Result:
    """A run whose scan said so."""
    scan = Scan(complete=complete, reason="as the scan says", samples=1000, span_s=1.0, seconds=0.1)
    return Result(
        run="r", seconds=1.0, samples=1000, complete=True, scan=scan, innovation_rms=ratio * 1e-4, noise_floor=1e-4
    )


def test_what_the_scan_lacks_blames_the_model_and_names_the_trace(tmp_path: Path) -> None:
    place = tmp_path / "a run"
    place.mkdir()
    part = judge_model(RunFolder(place), result(False), gyro.bench())
    assert part.outcome == "lacks"
    assert part.against
    assert "as the scan says" in part.reason
    assert part.next is not None
    words = shlex.split(part.next)
    assert words == ["hil", "trace", str(place), "--bench", str(place / "bench.toml")]


def test_a_complete_model_says_why(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), result(True), gyro.bench())
    assert (part.outcome, part.reason, part.next) == ("complete", "as the scan says", None)


def test_what_could_not_be_scanned_is_unknown_and_not_held_against_the_run(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), result(None), gyro.bench())
    assert part.outcome == "unknown"
    assert not part.against
    assert part.reason


def test_an_innovation_above_its_limit_is_held_against_a_complete_model(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), result(True, ratio=1.6), gyro.bench())
    assert part.outcome == "lacks"
    assert "1.6" in part.reason


def folder(place: Path, *, nu_V: float = 1e-4, codes: np.ndarray | None = None) -> RunFolder:
    """With an innovation of 100 samples and a capture of 2000."""
    ticks, found = np.arange(2000), RunFolder(place)
    header = {"tick_rate_Hz": 100.0, "axes": 1, "columns": {"vx_code": {"unit": "V", "scale": 1e-5}}}
    noise = np.rint(20.0 * np.random.default_rng(1).standard_normal(2000)).astype(np.int32)
    capture = {"tick": ticks, "vx_code": noise if codes is None else codes}
    innovation = {"tick": ticks[:100], "nu_x_V": np.full(100, nu_V), "s_x_V": np.full(100, 1e-4)}
    vars(found)["capture"] = Capture(capture, header, True)
    vars(found)["innovation"] = Innovation(innovation, header, True)
    return found


def test_an_innovation_that_is_not_finite_is_held_against_the_model(tmp_path: Path) -> None:
    diverged = result(True).model_copy(update={"innovation_rms": None, "scan": None})
    part = judge_model(folder(tmp_path, nu_V=np.nan), diverged, gyro.bench(duration_s=0.5))
    assert part.outcome == "lacks"
    assert "not finite: the observer diverged" in part.reason
    assert part.next is None  # a trace of it would say nothing


def test_a_run_of_which_nothing_was_scored_is_not_good(tmp_path: Path) -> None:
    short = result(True).model_copy(update={"innovation_rms": None})
    nobody = RunFolder(tmp_path)
    assert judge_model(nobody, short, gyro.bench()).outcome == "complete"
    unsettled = gyro.bench(duration_s=10.0, loop={"settle_s": 5.0})
    part = judge_model(folder(tmp_path), short, unsettled)
    assert (part.outcome, part.against) == ("failed", True)
    assert "the record ends before [loop] settle_s = 5 s" in part.reason
    interrupted = judge_model(folder(tmp_path), short, unsettled, ended_early=True)
    assert interrupted.outcome == "complete"  # that it ended early says enough


def test_the_innovation_is_held_against_its_limit_and_no_lower(tmp_path: Path) -> None:
    limit = gyro.bench(limits={"innovation_ratio": 2.0})
    assert judge_model(RunFolder(tmp_path), result(True, ratio=1.99), limit).outcome == "complete"
    part = judge_model(RunFolder(tmp_path), result(True, ratio=2.01), limit)
    assert (part.outcome, part.next) == ("lacks", None)  # the scan found nothing that a trace could name
    both = judge_model(RunFolder(tmp_path), result(False, ratio=3.0), limit)
    assert both.reason.startswith("as the scan says; innovation 3 × the noise floor")


def test_a_sense_chain_that_is_stuck_is_held_against_the_model(tmp_path: Path) -> None:
    sound = gyro.bench(device={"sense": {"noise_V": 2e-4}})
    assert judge_model(folder(tmp_path), result(True), sound).outcome == "complete"
    codes = np.rint(20.0 * np.random.default_rng(1).standard_normal(2000)).astype(np.int32)
    codes[500:700] = 7
    stuck = folder(tmp_path, codes=codes)
    part = judge_model(stuck, result(False), sound, faults=faults_of(stuck, sound))
    assert part.outcome == "lacks"
    assert part.reason.startswith("channel x repeated one code")  # the cause first: the rest follows from it
    assert part.reason.endswith("; as the scan says")
    assert part.next == "check the amplifier, the converter and the cable of channel x"


def test_without_a_scan_the_innovation_alone_judges(tmp_path: Path) -> None:
    unscanned = result(True).model_copy(update={"scan": None})
    assert judge_model(RunFolder(tmp_path), unscanned, gyro.bench()).outcome == "complete"
    beyond = result(True, ratio=9.0).model_copy(update={"scan": None})
    part = judge_model(RunFolder(tmp_path), beyond, gyro.bench())
    assert (part.outcome, part.next) == ("lacks", None)


def swinging(place: Path, times: float, unit: float = 1.0, *, decay_per_s: float = 0.0) -> RunFolder:
    """A mass that vibrates along a line at 30 degrees, with so many times the declared amplitude of S-slow."""
    t, found = np.arange(20000) / 4000.0, RunFolder(place)
    device = gyro.bench().device
    swing_m = times * unit * device.amplitude_m * np.exp(-decay_per_s * t) * np.cos(2.0 * np.pi * 200.0 * t)
    columns, units = {"tick": np.arange(len(t))}, {f"v{axis}_V": {"unit": "V", "scale": 1.0} for axis in "xy"}
    for axis, gain, part in zip("xy", device.sense_gains_V_per_m, (np.sqrt(0.75), 0.5), strict=True):
        columns[f"v{axis}_V"] = gain * part * swing_m + 0.01 * unit
    vars(found)["capture"] = Capture(columns, {"tick_rate_Hz": 4000.0, "axes": 2, "columns": units}, True)
    return found


@pytest.mark.parametrize(("unit", "ratio", "of_floor"), [(1e3, "1000", 826.0), (1e-3, "0.00100", 1e-3)])
def test_a_wrong_voltage_unit_is_told_first(tmp_path: Path, unit: float, ratio: str, of_floor: float) -> None:
    part = judge_model(swinging(tmp_path, 1.0, unit), result(None, ratio=of_floor), gyro.bench())
    assert part.outcome == "lacks"
    assert part.reason.startswith(f"the sense voltages are {ratio} × what the bench file can give")
    assert "1000: a thousandth of the unit, as mV for V" in part.reason
    assert part.next == "check the unit of vx_V and vy_V in the map"


@pytest.mark.parametrize(
    ("times", "decay_per_s", "of_floor"),
    [(1.0, 0.0, 1.6), (0.5, 0.0, 1.6), (1.0, 3.0, 1.6), (1e-3, 0.0, 1.0), (3e-3, 0.0, 1.6), (20.0, 0.0, 1.6)],
)
def test_a_decay_or_a_small_motion_is_no_wrong_unit(
    tmp_path: Path, times: float, decay_per_s: float, of_floor: float
) -> None:
    part = judge_model(swinging(tmp_path, times, decay_per_s=decay_per_s), result(True, ratio=of_floor), gyro.bench())
    assert "sense voltages" not in part.reason
    assert part.next is None


def sampled(off_ppm: float, half_ppm: float = 3.0) -> Result:
    rate = SampleRate(
        declared_Hz=5000.0, measured_Hz=5000.0 * (1.0 + 1e-6 * off_ppm), off_ppm=off_ppm, uncertainty_ppm=half_ppm
    )
    return result(True).model_copy(update={"board_clock": BoardClock(time_base="board", sample_rate=rate)})


@pytest.mark.parametrize(
    ("off_ppm", "half_ppm", "keys", "outcome"),
    [
        (62.0, 3.0, {}, "complete"),  # a crystal: 30 ppm, k = 2, where nothing is declared
        (-64.0, 3.0, {}, "lacks"),
        (64.0, 5.0, {}, "complete"),
        (64.0, 3.0, {"device": {"calibration": {"clock_u": 1e-4}}}, "complete"),
        (1000.0, 3.0, {"effects": {"clock_rate": {"delta": 1.0 / 1.001 - 1.0}}}, "complete"),
        (0.0, 3.0, {"effects": {"clock_rate": {"delta": 1.0 / 1.001 - 1.0}}}, "lacks"),
    ],
)
def test_a_sample_rate_is_held_against_the_declared_one(
    tmp_path: Path, off_ppm: float, half_ppm: float, keys: dict[str, dict[str, object]], outcome: str
) -> None:
    bench = override(gyro.bench(), keys, "test")
    assert judge_model(RunFolder(tmp_path), sampled(off_ppm, half_ppm), bench).outcome == outcome


def test_a_wrong_sample_rate_is_told_with_both_and_what_mends_it(tmp_path: Path) -> None:
    part = judge_model(RunFolder(tmp_path), sampled(1000.5), gyro.bench())
    assert part.reason.startswith(
        "the board samples at 5005.002 Hz by the host's clock, IDENTITY says 5000 Hz: +1000.5 ± 3.0 ppm"
    )
    assert part.next == (
        "correct the firmware's tick_rate_Hz to 5005.002, or declare [effects.clock_rate] delta = -0.0009995"
    )
