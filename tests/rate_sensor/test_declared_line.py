"""A rate sensor's fitted line is held against the declared one; what a response needs of its record is asked."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim

import hil
from estimator.diagnosis import Diagnosis, Interval, Verdict
from estimator.rate_sensor.agreement import Line, against
from estimator.rate_sensor.declaration import Range
from estimator.rate_sensor.record import SensorRecord
from estimator.rate_sensor.trace import alternate_blocks, trace_sensor
from hil.bench.ratio import slip
from hil.errors import InputError

FULL = 100.0 * math.pi / 180.0
DECLARED = Range(FULL, 2.0)
S, V0, NOISE = -1.145916, 2.5, 3.7e-3
LINE = Line(V0, S, 0.2, 0.1, meant=slip)
BENCH = f"""[device]
name = "RS"
axes = 0
scale_V_s_per_rad = {S}
offset_V = {V0}
range_rad_s = {FULL}
noise_V = {NOISE}
sample_rate_Hz = 100.0
"""


def turned(t: Any) -> Any:
    """A rate in rad/s that is in motion at any time."""
    return FULL * (0.5 * np.sin(4.4 * t + 1.0) + 0.3 * np.sin(1.95 * t + 2.0))


def traced(
    tmp_path: Path, *, scale: float = 1.0, offset: float = 0.0, rate_Hz: float = 100.0, bench: str = BENCH
) -> Any:
    t = np.arange(800) / rate_Hz
    volts = V0 + S * turned(t) + NOISE * np.random.default_rng(1).standard_normal(len(t))
    (tmp_path / "rs.bench.toml").write_text(bench)
    columns = {"t_s": t, "vx_V": volts + offset, "rate_rad_s": turned(t) / scale}
    return hil.trace(columns, tmp_path / "rs.bench.toml", out=tmp_path / "runs", report=False)


def test_a_sensor_as_declared_is_adequate_and_its_line_is_told(tmp_path: Path) -> None:
    done = traced(tmp_path)
    assert done.verdict == "adequate"
    written = json.loads((done.path / "diagnosis.json").read_text())["base"]
    assert written["S"]["unit"] == "V·s/rad"
    assert written["V0"]["unit"] == "V"
    for name, truth in (("S", S), ("V0", V0)):
        low, high = written[name]["ci95"]
        assert low < truth < high
    assert written["S"]["ci95"][1] - written["S"]["ci95"][0] < 2e-3


@pytest.mark.parametrize(
    ("ratio", "said"),
    [
        (180.0 / math.pi, "57.3 times the declared −1.146 (180/π: degrees for radians, or the reverse)"),
        (math.pi / 180.0, "0.0175 times the declared −1.146 (180/π: degrees for radians, or the reverse)"),
        (-1.0, "−1 times the declared −1.146 (the other sign): correct"),
        (2.0, "2 times the declared −1.146 (2: peak to peak"),
        (-0.5, "−0.5 times the declared −1.146 (the other sign, 2: peak to peak"),
        (1000.0, "1e+03 times the declared −1.146 (1000: a thousandth of the unit"),
        (1.3, "1.3 times the declared −1.146: correct the reference or the bench file"),
    ],
)
def test_another_scale_is_told_with_its_ratio(ratio: float, said: str) -> None:
    base = {
        "V0": Interval(V0, V0 - 1e-3, V0 + 1e-3, "V"),
        "S": Interval(ratio * S, ratio * S - 1e-3, ratio * S + 1e-3, ""),
    }
    (sentence,) = against(base, LINE)
    assert said in sentence.replace("-", "−")


def test_what_is_within_its_tolerance_is_good() -> None:
    for scale, offset in ((1.09 * S, V0), (0.91 * S, V0 + 0.19), (S, V0 - 0.19)):
        base = {"V0": Interval(offset, offset, offset, "V"), "S": Interval(scale, scale, scale, "")}
        assert not against(base, LINE)


@pytest.mark.parametrize(("scale", "offset"), [(180.0 / math.pi, 0.0), (-1.0, 0.0), (1.0, 1.0)])
def test_no_other_sensor_is_adequate(tmp_path: Path, scale: float, offset: float) -> None:
    done = traced(tmp_path, scale=scale, offset=offset)
    assert done.verdict == "unexplained"
    assert any(("offset V0" if offset else "scale factor S") in reason for reason in done.diagnosis.reasons)


def test_another_rate_or_unit_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"recorded at 50 Hz, but \[device\] sample_rate_Hz = 100"):
        traced(tmp_path, rate_Hz=50.0)
    with pytest.raises(InputError, match=r"the output is in V, but \[device\] unit = 'mdps'"):
        traced(tmp_path, bench=BENCH + 'unit = "mdps"\n')


# -- what a response needs --------------------------------------------------------------------------------------------


def behind(tau: float, step: float, seconds: float, *, lost: tuple[int, int] = (0, 0)) -> Diagnosis:
    """A lag, long before its record begins, by SciPy on a grid 16 times finer."""
    fine = np.arange(-30.0, seconds, step / 16)
    _, felt, _ = lsim(([1.0], [tau, 1.0]), turned(fine), fine - fine[0])
    t = np.arange(int(seconds / step)) * step
    volts = V0 + S * np.interp(t, fine, felt) + NOISE * np.random.default_rng(2).standard_normal(len(t))
    keep = np.ones(len(t), bool)
    keep[slice(*lost)] = False
    record = SensorRecord(turned(t)[keep], volts[keep], step, None, np.flatnonzero(keep))
    return trace_sensor(record, DECLARED, NOISE, alternate_blocks(len(record), 4), LINE)


@pytest.mark.slow
@pytest.mark.parametrize(("tau", "step"), [(0.5, 0.02), (0.02, 0.02)], ids=["slow", "quick"])
def test_a_lag_is_found_though_the_record_begins_in_motion(tau: float, step: float) -> None:
    found = behind(tau, step, 12.0, lost=(150, 170))
    assert [effect.name for effect in found.effects] == ["lag"]
    assert found.verdict is Verdict.EXPLAINED
    interval = found.effects[0].coefficients["tau"]
    assert interval.low - 0.01 * tau < tau < interval.high + 0.01 * tau


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.1, 0.2, 1.0])
def test_a_slow_record_is_traced(step: float) -> None:
    t = np.arange(120) * step
    rate = FULL * 0.7 * np.sin(0.11 / step * t + 0.5)
    volts = V0 + S * rate + NOISE * np.random.default_rng(3).standard_normal(len(t))
    found = trace_sensor(SensorRecord(rate, volts, step), DECLARED, NOISE, alternate_blocks(120, 4), LINE)
    assert found.verdict is Verdict.ADEQUATE


@pytest.mark.slow
def test_a_rate_that_bends_between_its_samples_explains_nothing() -> None:
    found = behind(0.3, 0.1, 20.0)
    assert found.verdict is not Verdict.EXPLAINED
    assert any("bends by" in reason and "sample faster" in reason for reason in found.reasons)
