"""A commercial gyro beside a run: on bench time, compared, told when it is lost, and of no effect on the loop."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import hil
from hil.errors import InputError
from hil.records.runfolder import RunFolder
from hil.scoring import reference
from hil.scoring.reference import compared, reference_rate
from tests.running import gyro

PERIOD_S = 10.0


def folder(*, sign: int = 1, delay_s: float = 0.012, scale: float = 1.02, lost: slice = slice(0)) -> Any:
    """20 s of a device behind a reference whose samples came through two clocks, a line and a busy machine."""
    chance = np.random.default_rng(3)
    tick = np.delete(np.arange(2500), lost)  # of the reference, 125 Hz by its clock, which is 40 ppm slow
    at_s = tick / 125.0 * (1.0 + 40e-6)  # on bench time
    host_s = at_s + 50.0 + 0.002 + chance.exponential(0.004, at_s.size) * (chance.random(at_s.size) < 0.9)
    turn = 0.3 * np.sin(2.0 * np.pi * at_s / PERIOD_S) + 0.1 * np.sin(1.7 * at_s)
    t_s = np.arange(4000) / 200.0
    late = t_s - delay_s
    rate = scale * (0.3 * np.sin(2.0 * np.pi * late / PERIOD_S) + 0.1 * np.sin(1.7 * late)) + 0.005
    asked = np.arange(0, 4000, 40)
    estimates = SimpleNamespace(t_s=t_s)
    columns = {"rate_rad_s": rate + 1e-4 * chance.standard_normal(rate.size)}
    return SimpleNamespace(
        reference=SimpleNamespace(
            columns={"host_ns": np.int64(1e9 * host_s), "latency_us": np.full(tick.size, 2000),
                     "rate_z_code": sign * turn + 1e-4 * chance.standard_normal(at_s.size)},
            header={"columns": {"rate_z_code": {"scale": 1.0}}, "identity": {"line_s": 0.0}},
            tick=tick, tick_rate_Hz=125.0,
        ),
        clock=SimpleNamespace(
            tick=asked, tick_rate_Hz=200.0, columns={"board_ns": np.int64(asked * 5_000_000 + 7)},
            fit=SimpleNamespace(offset_ns=-50_000_000_000, skew=0.0, at_host_ns=0, offset_uncertainty_ns=20_000.0),
        ),
        bench={"reference": {"axis": "z", "sign": 1}}, scored_from_s=2.0,
        estimates=type("E", (), {"t_s": estimates.t_s, "__contains__": lambda _, n: n in columns,
                                 "__getitem__": lambda _, n: columns[n]})(),
    )  # fmt: skip


BENCH = cast("hil.Bench", SimpleNamespace(reference=SimpleNamespace(link="x", axis="z", sign=1)))


@pytest.mark.parametrize("lost", [slice(0), slice(700, 900)])
def test_scale_bias_and_delay_are_within_what_is_told(lost: slice) -> None:
    found = compared(folder(lost=lost), BENCH, {})
    assert found.delay is not None
    assert found.scale_error is not None
    assert found.bias is not None
    assert found.delay.ci95[0] < 12.0 < found.delay.ci95[1]
    assert 0.5 < found.delay.ci95[1] - found.delay.ci95[0] < 20.0  # half a tick of the board, and the stamps
    assert found.scale_error.value == pytest.approx(0.02, abs=3e-4)
    assert found.bias.value == pytest.approx(0.005, abs=5e-5)
    assert found.skew_ppm == pytest.approx(-40.0, abs=5.0)


def test_a_gyro_the_other_way_about_shows() -> None:
    found = compared(folder(sign=-1), BENCH, {})
    assert found.scale_error is not None
    assert found.scale_error.value == pytest.approx(-2.02, abs=0.01)


@contextmanager
def turning(tmp_path: Path, since_s: float, *options: str) -> Iterator[tuple[str, Path, "subprocess.Popen[str]"]]:
    """An emulated STIM300 on a pty that turns as the board of the scenario, which began at `since_s`."""
    scenario = gyro.unhurried_scenario(tmp_path / "board.toml")
    sine = f'kind = "sine"\noffset_rad_s = 0.1\namplitude_rad_s = 0.15\nfrequency_Hz = {1.0 / PERIOD_S}'
    scenario.write_text(scenario.read_text().replace('kind = "constant"\nrate_rad_s = 0.1', sine))
    command = [
        sys.executable,
        "-m",
        "device_emulator.gyros",
        "stim300",
        "--turn",
        str(scenario),
        "--since",
        str(since_s),
    ]
    with subprocess.Popen([*command, "--sample-rate", "125", *options], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        link = process.stdout.readline().removeprefix("ready ").strip().replace("serial:", "stim300:")
        yield link, scenario, process
        process.terminate()


def lag_s(t_s: Any, rate: Any) -> float:
    """Of the profile's sine."""
    turn = 2.0 * np.pi / PERIOD_S
    basis = np.column_stack([np.sin(turn * t_s), np.cos(turn * t_s), np.ones_like(t_s)])
    sine, cosine, _ = np.linalg.lstsq(basis, rate, rcond=None)[0]
    return float(-np.arctan2(cosine, sine) / turn)


@pytest.mark.realtime
def test_a_gyro_that_turns_with_the_board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reference, "_SEARCH_S", 4.9)  # board and gyro began to turn seconds apart
    monkeypatch.setattr(reference, "_STEPS", 393)
    since_s = time.monotonic()
    with turning(tmp_path, since_s, "--lost", "0.01", "--corrupted", "0.01") as (link, scenario, _):
        run = hil.run(gyro.unhurried_bench(13.0), link=f"pty:{scenario}", reference=link, out=tmp_path / "runs")
    found, place = run.result.reference, RunFolder(run.path)
    assert found is not None
    assert found.delay is not None
    assert found.time_u_ms is not None
    clock, on_bench, estimates = place.clock, reference_rate(place), place.estimates
    assert clock is not None
    assert estimates is not None
    assert not isinstance(on_bench, str)
    sent, received = clock.columns["t_send_ns"], clock.columns["t_receive_ns"]
    best = np.argmin(received - sent + 10**9 * (clock.tick == clock.tick[0]))
    began_s = 0.5e-9 * (sent + received)[best] - clock.tick[best] / clock.tick_rate_Hz  # by one exchange, without a fit
    apart = (lag_s(on_bench.t_s, on_bench.rate_rad_s) + began_s - since_s + PERIOD_S / 2) % PERIOD_S - PERIOD_S / 2
    assert abs(apart) < 4.0 * 1e-3 * found.time_u_ms + 0.004
    scored = estimates.t_s >= place.scored_from_s
    own = lag_s(estimates.t_s[scored], np.asarray(estimates["rate_rad_s"])[scored])
    expected = (own - lag_s(on_bench.t_s, on_bench.rate_rad_s)) % PERIOD_S
    assert found.delay.value % PERIOD_S == pytest.approx(1e3 * expected % PERIOD_S, abs=30.0)
    assert found.scale_error is not None
    assert abs(found.scale_error.value) < 0.03
    assert found.lost > 0
    assert found.counters["crc_errors"] > 0
    assert any("reference: " in remark and "missing" in remark for remark in run.result.remarks)
    assert "Beside the reference, Sensonor STIM300" in (run.path / "report.html").read_text(encoding="utf-8")
    assert run.result.complete
    sheet = hil.characterise(run.path, out=tmp_path / "sheet", report=False).sheet
    assert sheet.reference == "reference gyro"
    traced = hil.trace(run.path, out=tmp_path / "traced", report=False).diagnosis
    assert any("less its own bias, scale and delay" in said for said in traced.prepared)
    assert traced.held_out.before.angle_error_rms_rad is not None


@pytest.mark.realtime
@pytest.mark.usefixtures("no_report")
def test_a_gyro_that_is_unplugged_stops_nothing(tmp_path: Path) -> None:
    with turning(tmp_path, time.monotonic()) as (link, scenario, process):

        def unplug() -> None:
            while not list(tmp_path.glob("runs/*/capture.arrow")):
                time.sleep(0.1)
            time.sleep(4.0)
            process.kill()

        threading.Thread(target=unplug, daemon=True).start()
        run = hil.run(gyro.unhurried_bench(8.0), link=f"pty:{scenario}", reference=link, out=tmp_path / "runs")
    found = run.result.reference
    assert found is not None
    assert found.stopped
    assert any(remark.startswith("reference: it ended before the run") for remark in run.result.remarks)
    assert run.result.complete
    assert run.result.seconds > 7.9
    kept = RunFolder(run.path).reference
    assert kept is not None
    assert kept.complete
    assert len(kept) == found.samples > 100


def test_a_reference_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    lockstep, paced = gyro.bench(), gyro.unhurried_bench(1.0)
    for bench, link, given, said in (
        (lockstep, "pty:s-slow", "stim300:/dev/none", "lives on wall time"),
        (paced, "serial:/dev/ttyX", "stim300:/dev/ttyX", "is the line of the board itself"),
        (paced, "pty:s-slow", "replay:a.bin", "is a file; give a sensor"),
        (paced, "pty:s-slow", "banana:/dev/none", "no adapter of that name"),
        (paced, "pty:s-slow", "stim300:/dev/none", r"\[reference\] .*no such port"),
    ):
        with pytest.raises(InputError, match=said) as told:
            hil.run(bench, link=link, reference=given, out=tmp_path, arm=True)
        assert "\n" not in str(told.value)
    assert not list(tmp_path.iterdir())
    with turning(tmp_path, time.monotonic()) as (link, scenario, _):
        wrong = paced.with_(reference={"axis": "u"})
        with pytest.raises(InputError, match="has no rate 'u'; it has x, y, z"):
            hil.run(wrong, link=f"pty:{scenario}", reference=link, out=tmp_path / "runs")
