"""A lock-in's streams: imported, observed, compared, traced; held against closed forms and the 13 states."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.signal.windows import blackmanharris

import hil
from hil.bench import override
from hil.inputs.declared import device_of
from hil.records.capture import read_capture
from tests.plugins.direct import Driven
from tests.plugins.test_slow_flow import RATE_HZ, RATE_RAD_S, REPLAYED, SETTLED, error_rad, record

__all__ = ["record"]

CARRIER_HZ, ROWS_HZ, SECONDS, TURN_RAD_S = 5000.3, 1000.0, 8.0, 1.5
BENCH = override(REPLAYED, {"loop": {"settle_s": 4.0, "estimate_every": 1}}, "test")
Columns = dict[str, Any]


def turning(carrier_Hz: Any = CARRIER_HZ) -> Columns:
    """Streams of an isotropic, undamped gyro that turns evenly, with the declared noise; its carrier by phase."""
    device, rng = device_of(BENCH), np.random.default_rng(4)
    t = np.arange(round(SECONDS * ROWS_HZ)) / ROWS_HZ
    hertz = np.broadcast_to(carrier_Hz, t.shape)
    phase = 2.0 * math.pi * np.concatenate([[0.0], np.cumsum(0.5 * (hertz[1:] + hertz[:-1])) / ROWS_HZ])
    z = device.amplitude * np.exp(1j * (2.0 * math.pi * 5001.0 * t - phase))
    columns: Columns = {"t_s": t}
    noise = device.noise[0] * math.sqrt(2.0 * ROWS_HZ / device.sample_rate)
    for axis, share in (("x", np.cos(-TURN_RAD_S * t)), ("y", np.sin(-TURN_RAD_S * t))):
        shown = device.sense_gain[0] * z * share
        columns |= {f"v{axis}_{part}_V": values + noise * rng.standard_normal(len(t))
                    for part, values in (("i", shown.real), ("q", shown.imag))}  # fmt: skip
    return columns | {"rate_rad_s": np.full(len(t), TURN_RAD_S)}


def written(path: Path, columns: Columns) -> Path:
    """As the file's ending says."""
    if path.suffix == ".parquet":
        pq.write_table(pa.table(columns), path)
    else:
        rows = np.column_stack(list(columns.values()))
        np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    return path


@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.parametrize("column", ["", "carrier_Hz", "pll"])
def test_a_turning_gyro_is_read_by_its_streams(
    tmp_path: Path, no_report: None, ending: str, column: str
) -> None:  # fmt: skip
    wandering = CARRIER_HZ + 2.0 * np.sin(np.arange(round(SECONDS * ROWS_HZ)) / 400.0)
    columns = turning(wandering) | {column: wandering} if column else turning()
    file = written(tmp_path / f"streams.{ending}", columns)
    got = hil.import_record(file, demodulated=column or str(CARRIER_HZ), out=tmp_path / "streams.arrow")
    assert got.capture.carrier_Hz == pytest.approx(CARRIER_HZ, abs=0.5)
    run = hil.replay(got.path, BENCH, out=tmp_path / "runs")
    assert run.result.angle_error_rms_rad is not None
    assert run.result.angle_error_rms_rad < 5e-4
    assert run.result.innovation_rms == pytest.approx(run.result.noise_floor, rel=0.1)
    assert run.result.parameters["kxx"].value == pytest.approx((2.0 * math.pi * 5001.0) ** 2, rel=1e-7)


def test_arrays_are_compared_and_traced(tmp_path: Path) -> None:
    told = hil.compare(turning(), BENCH, demodulated=str(CARRIER_HZ), out=tmp_path / "compared")
    named = {row.name: row for row in told.rows}
    assert set(named) == {"plug-in slow_flow"}
    assert all(row.angle_error_rms_rad < 5e-4 for row in named.values())  # type: ignore[operator]
    assert any("cannot be compared" in remark for remark in told.remarks)
    traced = hil.trace(turning(), BENCH, demodulated=str(CARRIER_HZ), out=tmp_path / "traced")
    assert traced.verdict == "adequate"
    assert "no effect is tried" in traced.diagnosis.reasons[-1]
    line = turning()
    line["vx_i_V"] = line["vx_i_V"] + 1e-4 * np.sin(250.0 * line["t_s"])
    assert hil.trace(line, BENCH, demodulated=str(CARRIER_HZ), out=tmp_path / "other").verdict == "unexplained"


def test_rms_of_a_map_and_an_export_come_back(tmp_path: Path) -> None:
    peak = turning()
    given = {name: values / math.sqrt(2.0) if name.startswith("v") else values for name, values in peak.items()}
    channels = [name for name in given if name.startswith("v")]
    table = "\n".join(f'{name} = {{ column = "{name}", unit = "Vrms" }}' for name in channels)
    map_file = tmp_path / "lock-in.map.toml"
    map_file.write_text(f'hold = "zoh"\n[columns]\nt_s = {{ column = "t_s", unit = "s" }}\n{table}\n', encoding="utf-8")
    file = written(tmp_path / "rms.csv", given)
    got = hil.import_record(file, mapping=map_file, demodulated="5000.3", out=tmp_path / "rms.arrow").capture
    np.testing.assert_allclose(got.sense_V[:, 2], peak["vx_q_V"], rtol=1e-9)
    hil.export(tmp_path / "rms.arrow", tmp_path / "again.parquet")
    again = hil.import_record(tmp_path / "again.parquet", out=tmp_path / "again.arrow").capture
    assert again.carrier_Hz == got.carrier_Hz
    np.testing.assert_array_equal(again.sense_V, got.sense_V)


BAD: dict[str, tuple[Columns, str | None, str]] = {
    "no carrier": ({}, None, "component of a demodulated stream; give its carrier"),
    "no frequency": ({}, "-5", "-5 is no frequency"),
    "no such column": ({}, "pll", "no column 'pll'"),
    "a component lacks": ({"vy_q_V": None}, "5000", "no column vy_q_V"),
    "a sample beside": ({"vx_V": 1.0}, "5000", "'vx_V' is not known beside demodulated"),
    "half a drive": ({"ux_i_V": 1.0}, "5000", "no column ux_q_V beside ux_i_V"),
    "two units": ({"ux_i_V": 1.0, "uy_q_N": 1.0}, "5000", "drives in N and V"),
    "two carriers": ({"carrier_Hz": 5000.0}, "5000", "column carrier_Hz beside demodulated= 5000"),
    "no carrier there": ({"carrier_Hz": 0.0}, "carrier_Hz", "0 Hz of kept row 0 is no carrier"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_streams_are_one_line(tmp_path: Path, case: str) -> None:
    changes, carrier, told = BAD[case]
    columns = turning()
    for name, value in changes.items():
        columns |= {name: np.full(len(columns["t_s"]), value)} if value is not None else {}
        if value is None:
            del columns[name]
    file = written(tmp_path / "bad.csv", columns)
    with pytest.raises(hil.InputError) as refused:
        hil.import_record(file, demodulated=carrier, out=tmp_path / "bad.arrow")
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "bad.arrow").exists()


def test_a_class_takes_no_streams(tmp_path: Path) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(
        "class Mine:\n    def __init__(self, device): ...\n    def observe(self, *given): ...\n", encoding="utf-8"
    )
    bench = override(BENCH, {"observer": {"plugin": f"{mine}:Mine"}}, "test")
    with pytest.raises(hil.InputError, match="no demodulated streams; use slow_flow"):
        hil.replay(turning(), bench, demodulated="5000.3", out=tmp_path / "runs")


def demodulated(record: Driven, every: int) -> Columns:
    """By a window of 3 ms, a row every so many samples; the drive is held, and so on average half a sample old."""
    window = blackmanharris(301) / np.sum(blackmanharris(301))
    middles = np.arange(150, len(record.sense) - 151, every)
    turn = np.exp(-2j * math.pi * CARRIER_HZ * np.arange(len(record.sense)) / RATE_HZ)
    half = math.pi * CARRIER_HZ / RATE_HZ
    columns: Columns = {"t_s": (middles - middles[0]) / RATE_HZ}
    for at, axis in enumerate("xy"):
        sensed = record.sense[:, at] - np.mean(record.sense[:, at])  # as an input that is coupled by a capacitor
        shown = np.convolve(2.0 * sensed * turn, window, "valid")[middles - 150]
        pushed = np.convolve(2.0 * record.drive[:, at] * turn, window, "valid")
        held = np.exp(1j * half) * math.sin(half) / half
        push = 0.5 * (pushed[middles - 150] + pushed[middles - 149]) * held
        columns |= {f"v{axis}_i_V": shown.real, f"v{axis}_q_V": shown.imag}
        columns |= {f"u{axis}_i_mps2": push.real, f"u{axis}_q_mps2": push.imag}
    return columns


@pytest.mark.slow
def test_the_angle_on_streams_is_nearly_that_on_samples(record: Driven, tmp_path: Path, no_report: None) -> None:
    columns, bench = demodulated(record, 50), override(BENCH, {"loop": {"settle_s": 1.2}}, "test")
    run = hil.replay(columns, bench, demodulated=str(CARRIER_HZ), out=tmp_path / "runs")
    late = run.estimates.t_s > SETTLED / RATE_HZ
    error = (run.estimates["angle_rad"] - RATE_RAD_S * run.estimates.t_s)[late]
    assert float(np.std(error)) < 1.5 * error_rad(None, record)
    assert run.result.innovation_rms < 1.2 * run.result.noise_floor  # type: ignore[operator]
    assert read_capture(run.path / "capture.arrow").carrier_Hz == CARRIER_HZ
