"""What depends on the angle, from one run of an emulated device, taken off another: the device's gains are not those
that the host is told. The emulator makes the error, the host's fit finds it; they share no line.
"""

import re
from pathlib import Path

import numpy as np
import pytest

import hil
from hil.bench.angle_map import read_angle_map
from hil.bench.examples import find
from hil.errors import InputError

TRIMMED = {"stiffness_N_per_m": "[1582.3, 1575.9, 1.6]"}  # as a whole-angle device is: 0.4 % apart
QUIET = TRIMMED | {"noise_V": "2e-7", "adc_bits": "24", "noise_mps2_per_rtHz": "0.0", "temperature_K": "0.0"}
GAINS = """
[[effect]]
name = "drive_gain"
hx = 0.01
hy = -0.01

[[effect]]
name = "sense_gain"
gx = 0.0
gy = 0.01

[rate]
kind = "steps"
"""


def scenario(path: Path, times: str, rates: str, seed: int) -> Path:
    """S-slow, trimmed and without noise, its gains apart by what nobody declares."""
    text = find("scenario", "s-slow").read_text(encoding="utf-8").partition("[rate]")[0]
    for key, value in QUIET.items():
        text, found = re.subn(rf"^{key} = [^#\n]+", f"{key} = {value} ", text, flags=re.MULTILINE)
        assert found == 1, key
    text = text.replace("seed = 1", f"seed = {seed}")
    path.write_text(f"{text}{GAINS}times_s = {times}\nrates_rad_s = {rates}\n", encoding="utf-8")
    return path


def bench():
    return hil.load_bench("s-slow").with_(
        controller={"virtual_rotation_rad_s": 0.0, "virtual_reversal_s": 0.0, "dither_mps2": 0.03},
        device={"sense": {"noise_V": 1e-5}},
        observer={"memory_s": 2.0},
    )


def made(name: str, declared, times: str, rates: str, seed: int, seconds: float):
    link = f"inproc:{scenario(Path(f'{name}.scenario.toml'), times, rates, seed)}"
    options = {"truth": f"{name}.arrow", "name": name, "seed": seed}
    return hil.run(declared, link=link, clock="lockstep", duration_s=seconds, **options)


@pytest.mark.long
def test_the_map_of_one_run_takes_the_angle_out_of_another(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    both = [made(name, bench(), "[0.0]", f"[{rate}]", 3, 22.0) for name, rate in (("left", 1.6), ("right", -1.6))]
    truths = ("left.arrow", "right.arrow")
    sheet = hil.characterise(both, truth=truths, calibrate="calibrations", temperature_C=21.0)
    assert sheet.calibration is not None
    kept = read_angle_map(sheet.calibration)
    assert sheet.calibration.name == f"{kept.serial_number}.toml"
    assert (kept.temperature_C, kept.least_rate_rad_s) == (21.0, pytest.approx(-1.6))
    assert 0.0 < kept.scale_factor.u[1] < 0.1 * np.hypot(kept.scale_factor.cos[1], kept.scale_factor.sin[1])
    # held out: another seed, turns that were not seen
    held_out = made("second", bench(), "[0.0]", "[1.6]", 4, 22.0)
    mapped = bench().with_(device={"calibration": {"angle_map": str(sheet.calibration)}})
    corrected = hil.replay(held_out, mapped)
    before, after = (_rms_over_the_angle(run) for run in (held_out, corrected))
    print(f"angle-dependent bias, rms: {before:.3g} and {after:.3g} rad/s, {before / after:.0f} times smaller")
    assert before > 30.0 * after
    assert before > 1e-4


def _rms_over_the_angle(run) -> float:
    """Of the rate error's harmonics 1θ to 4θ."""
    rows = hil.characterise(run, truth="second.arrow", report=False).sheet.rows
    sizes = [row.value for row in rows if re.fullmatch(r"bias_\dtheta", row.figure)]
    return float(np.sqrt(np.sum(np.square(sizes)) / 2.0))


def test_a_map_of_another_device_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("a.toml").write_text(
        'serial_number = "77"\ndate = 2026-01-02\nleast_rate_rad_s = 0.0\nmost_rate_rad_s = 1.0\nseconds = 3.0\n'
    )
    mapped = bench().with_(device={"calibration": {"angle_map": "a.toml"}})
    with pytest.raises(InputError, match=r"serial number is 0000000000005107, and a\.toml is of 77"):
        made("third", mapped, "[0.0]", "[1.1]", 4, 9.0)
    for text, word in (("", "serial_number"), ("serial_number = 5", "expected a text")):
        Path("b.toml").write_text(text)
        with pytest.raises(InputError, match=word):
            read_angle_map(Path("b.toml"))
