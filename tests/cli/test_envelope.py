"""`hil trace` of an amplitude in dB: file, map, bench file and commands as a laboratory has them."""

import json

import numpy as np
import pytest

from tests.envelope.ringing import AMPLITUDE_M, DAMPING, GAIN, LAWS, OMEGA0, decibels, envelope_of

BENCH = f"""
[device]
name = "reed"
axes = 1
mass_kg = 1.0
stiffness_N_per_m = [{OMEGA0**2:.12g}]
damping_N_s_per_m = [{1.2 * DAMPING}]
amplitude_m = {AMPLITUDE_M}
sample_rate_Hz = 40.0
[device.sense]
senses = "envelope"
gain_V_per_m = {GAIN}
unit = "dB"
noise_V = 0.05
[device.drive]
unit = "mps2"
full_scale = 1.0
[observer]
gain = "ekf"
[observer.initial_sd]
stiffness = 1e-4
[controller]
enabled = false
"""
MAP = """
hold = "zoh"
[columns]
t_s = { column = "time", unit = "ms" }
vx = { column = "level", unit = "dB" }
"""


@pytest.fixture(scope="module")
def drag():
    """Time (n,) s and level (n,) dB of a ring-down against drag."""
    time, amplitude = envelope_of([LAWS["drag"][1:]], 8.0)
    return time, decibels(amplitude, 0.05)


@pytest.fixture
def reed(tmp_path, drag):
    """The files of a laboratory in the folder where `hil` is called."""
    time, level = drag
    table = np.column_stack([1e3 * time, level])
    np.savetxt(tmp_path / "reed.csv", table, delimiter=",", header="time,level", comments="")
    (tmp_path / "reed.map.toml").write_text(MAP, encoding="utf-8")
    (tmp_path / "reed.bench.toml").write_text(BENCH, encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_the_law_is_named_from_a_file_of_decibels(hil, reed):
    assert hil("import", "reed.csv", "--map", "reed.map.toml")[0] == 0
    code, out, err = hil("trace", "reed.arrow", "--bench", "reed.bench.toml", "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["verdict"] == "explained"
    assert found["sense_unit"] == "dB"
    (effect,) = found["effects"]
    assert effect["name"] == "drag"
    assert "ȧ += -0.4244*dqx*omega0*a**2" in effect["equations"]
    low, high = effect["coefficients"]["dqx"]["ci95"]
    assert low < LAWS["drag"][1] < high
    assert found["held_out"]["after"]["ratio"] < 1.1 < 3.0 < found["held_out"]["before"]["ratio"]
    (page,) = reed.glob("runs/*/report.html")
    assert "Envelope" in page.read_text(encoding="utf-8")
    code, out, _ = hil("trace", "reed.arrow", "--bench", "reed.bench.toml", "--no-report", "--fraction", "0.6")
    assert "ȧ = … − 0.4244 dqx omega0 a²" in out


@pytest.mark.slow
def test_uneven_time_is_good_enough(hil, reed, drag):
    time, level = drag
    keep = np.random.default_rng(1).random(len(time)) < 0.7
    np.savetxt(
        reed / "reed.csv", np.column_stack([1e3 * time, level])[keep], delimiter=",", header="time,level", comments=""
    )
    assert hil("import", "reed.csv", "--map", "reed.map.toml", "--nonuniform")[0] == 0
    code, out, err = hil("trace", "reed.arrow", "--bench", "reed.bench.toml", "--json", "--no-report")
    assert code == 0, err
    assert [effect["name"] for effect in json.loads(out)["effects"]] == ["drag"]


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("trace", "reed.arrow", "--bench", "reed.bench.toml", "--add", "more.bench.toml"), "leave out --add"),
        (("trace", "reed.arrow", "reed.arrow", "--bench", "reed.bench.toml"), "traced by itself"),
        (("trace", "reed.arrow", "--bench", "reed.bench.toml", "--missing-force"), "leave out --missing-force"),
        (("replay", "reed.arrow", "--bench", "reed.bench.toml"), "only hil trace can judge"),
        (("compare", "reed.arrow", "--bench", "reed.bench.toml"), "axes = 1"),
    ],
)
def test_what_an_amplitude_is_not_for_is_refused_in_a_line(hil, reed, words, said):
    assert hil("import", "reed.csv", "--map", "reed.map.toml")[0] == 0
    code, _, err = hil(*words)
    assert code == 2
    assert said in " ".join(err.split())
    assert "Traceback" not in err


@pytest.mark.moderate
def test_a_bench_file_of_an_amplitude_is_looked_at(hil, reed):
    assert hil("import", "reed.csv", "--map", "reed.map.toml")[0] == 0
    text = BENCH.replace(f"gain_V_per_m = {GAIN}", f"gain_V_per_m = {-GAIN}")
    (reed / "reed.bench.toml").write_text(text, encoding="utf-8")
    code, _, err = hil("trace", "reed.arrow", "--bench", "reed.bench.toml")
    assert code == 2
    assert "an amplitude has no sign" in err
    for old, new, said in (
        ("[columns]", '[columns]\nux_mps2 = { column = "level", unit = "m/s^2" }', "a drive beside an envelope"),
        ("[columns]", "[filter]\nhigh_Hz = 5.0\n[columns]", "behind a filter"),
    ):
        (reed / "reed.bench.toml").write_text(BENCH, encoding="utf-8")
        (reed / "reed.map.toml").write_text(MAP.replace(old, new), encoding="utf-8")
        code, _, err = hil("import", "reed.csv", "--map", "reed.map.toml", "--replace")
        assert code == 0, err
        code, _, err = hil("trace", "reed.arrow", "--bench", "reed.bench.toml")
        assert code == 2
        assert said in err


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["dBuV", "dBV", "dBm"])
def test_a_level_over_whatever_reference_says_the_same(hil, reed, drag, unit):
    """60 dB up, so that every level is positive and would pass for an amplitude, or down, so that none is."""
    time, level = drag
    up = {"dBuV": 60.0, "dBV": -60.0, "dBm": -30.0}[unit]
    table = np.column_stack([1e3 * time, level + up])
    np.savetxt(reed / "l.csv", table, delimiter=",", header="time,level", comments="")
    (reed / "l.map.toml").write_text(MAP.replace('"dB"', f'"{unit}"'), encoding="utf-8")
    text = BENCH.replace('unit = "dB"', f'unit = "{unit}"')
    text = text.replace(f"gain_V_per_m = {GAIN}", f"gain_V_per_m = {GAIN * 10.0 ** (up / 20.0)}")
    (reed / "l.bench.toml").write_text(text, encoding="utf-8")
    found = []
    for name in ("reed", "l"):
        assert hil("import", f"{name}.csv", "--map", f"{name}.map.toml", "--nonuniform")[0] == 0
        code, out, _ = hil("trace", f"{name}.arrow", "--bench", f"{name}.bench.toml", "--json", "--no-report")
        assert code == 0
        found.append(json.loads(out))
    assert [(one["verdict"], one["sense_unit"]) for one in found] == [("explained", "dB")] * 2
    first, other = (one["effects"][0] for one in found)
    assert other["name"] == first["name"]
    for symbol, one in first["coefficients"].items():
        assert other["coefficients"][symbol]["value"] == pytest.approx(one["value"], rel=1e-3)


def test_a_level_that_is_not_known_is_refused(hil, reed):
    for unit in ("dBq", "Np", "DB"):
        (reed / "odd.bench.toml").write_text(BENCH.replace('unit = "dB"', f'unit = "{unit}"'), encoding="utf-8")
        (reed / "reed.arrow").write_bytes(b"")
        code, _, err = hil("trace", "reed.arrow", "--bench", "odd.bench.toml")
        assert code == 2
        assert f"[device.sense] unit: '{unit}' is no level that is known; there are dB, " in err
