"""Bench files of devices that are not two-axis gyros: a mass on no spring, and sensors that put out a rate."""

import numpy as np
import pytest

from estimator.diagnosis import Verdict
from hil.bench import Bench, RateSensorBench, examples, load_any_bench, load_bench
from hil.errors import InputError
from hil.importing.importer import import_record
from hil.tracing.rate_sensor import trace_rate_sensor

CARRIAGE = """
[device]
name = "carriage"
axes = 1
mass_kg = 95.0
stiffness_N_per_m = [0.0]
damping_N_s_per_m = [200.0]
amplitude_m = 0.25
sample_rate_Hz = 1000.0
[device.sense]
gain_V_per_m = 1.0
noise_V = 1e-6
[device.drive]
full_scale = 10
[controller]
enabled = false
target_stiffness_N_per_m = 95.0
"""
SENSOR = """
[device]
name = "rate sensor"
axes = 0
scale_V_s_per_rad = -1.0
range_rad_s = 2.0
noise_V = 1e-3
"""


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "x.bench.toml"
        path.write_text(text)
        return path

    return write


def test_a_mass_on_no_spring_has_the_target_stiffness_as_its_scale_of_time(file):
    bench = load_bench(file(CARRIAGE))
    assert bench.target_stiffness_per_s2 == pytest.approx(1.0)
    assert bench.device.resonance_Hz == 0.0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("target_stiffness_N_per_m = 95.0", "", "[controller] target_stiffness_N_per_m: a mass on no spring needs one"),
        ("stiffness_N_per_m = [0.0]", "stiffness_N_per_m = [-1.0]", "must not be negative; 0 is a mass on no spring"),
    ],
)
def test_mistakes_with_a_mass_on_no_spring(file, old, new, told):
    with pytest.raises(InputError) as caught:
        load_bench(file(CARRIAGE.replace(old, new, 1)))
    assert told in str(caught.value)


def test_a_rate_sensor_has_a_bench_file_of_its_own_and_no_loop(file):
    path = file(SENSOR)
    bench = load_any_bench(path)
    assert isinstance(bench, RateSensorBench)
    assert bench.device.scale_V_s_per_rad == -1.0
    with pytest.raises(InputError, match=r"x.bench.toml: \[device\] axes: 0 is a rate-output sensor"):
        load_bench(path)
    with pytest.raises(InputError, match=r"\[device\] mass_kg: unknown key"):
        load_any_bench(file(SENSOR + "mass_kg = 1.0\n"))
    assert isinstance(load_any_bench(file(CARRIAGE)), Bench)


@pytest.mark.slow
def test_a_clipped_sensor_is_traced_from_its_file(file, tmp_path):
    rate = np.tile(np.linspace(-3.0, 3.0, 13), 3)
    volts = np.clip(0.1 - rate, -2.0, 2.0) + 1e-3 * np.random.default_rng(1).standard_normal(len(rate))
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(rate.tolist(), volts.tolist(), strict=True))
    (tmp_path / "x.csv").write_text("rate_rad_s,vx_V\n" + rows)
    (tmp_path / "x.map.toml").write_text(
        'hold = "zoh"\nsteady = true\n[columns]\nrate_rad_s = { column = "rate_rad_s", unit = "rad/s" }\n'
        'vx_V = { column = "vx_V", unit = "V" }\n'
    )
    import_record(tmp_path / "x.csv", tmp_path / "x.arrow", map_file=tmp_path / "x.map.toml")
    bench = load_any_bench(file(SENSOR))
    assert isinstance(bench, RateSensorBench)
    found = trace_rate_sensor(tmp_path / "x.arrow", bench)
    assert found.verdict is Verdict.EXPLAINED
    assert [effect.name for effect in found.effects] == ["saturation"]


def test_a_record_without_reference_is_no_record_of_a_rate_sensor(file, tmp_path):
    (tmp_path / "y.csv").write_text("t_s,vx_V\n0,1\n1,2\n")
    import_record(tmp_path / "y.csv", tmp_path / "y.arrow")
    bench = load_any_bench(file(SENSOR))
    assert isinstance(bench, RateSensorBench)
    with pytest.raises(InputError, match="no column rate_rad_s; a rate sensor is judged beside a reference"):
        trace_rate_sensor(tmp_path / "y.arrow", bench)


@pytest.mark.parametrize("name", [name for name in examples.names("bench") if name.startswith("rate-table")])
def test_example_rate_sensors_are_valid(name):
    assert isinstance(load_any_bench(examples.find("bench", name)), RateSensorBench)
