"""Numbers that cannot be meant are refused when the bench file is read, in one line that names key and remedy."""

from pathlib import Path

import pytest

from hil.bench import Bench, examples
from hil.bench.bench import load_any_bench
from tests.cli.test_bench_file import MINIMAL, complaint

OBSERVER = "[observer]\n"
CASES = [
    ("sample_rate_Hz = 4000", "sample_rate_Hz = 1e12", "[device] sample_rate_Hz: 1e+12 Hz is beyond 1e+08"),
    ("amplitude_m = 1e-4", "amplitude_m = 100", "[device] amplitude_m: 100 m is beyond 10"),
    ("gain_V_per_m = -890", "gain_V_per_m = -8.9e8", "[device.sense] gain_V_per_m: the amplitude would be 8.9e+04 V"),
    ("noise_V = 1e-4", "noise_V = 1e4", "[device.sense] noise_V: the amplitude is 8.9e-06 times the noise"),
    ("noise_V = 1e-4", "noise_V = 1e-300", "[device.sense] noise_V: the amplitude is 8.9e+298 times the noise"),
    ("mass_kg = 1e-3", "mass_kg = 1e300", "[device] mass_kg: 6.35e-150 Hz is no resonance"),
    ("", "[loop]\nduration_s = 1e300", "[loop] duration_s: 1e+300 s are more than 1e+12 samples"),
    ("", "[loop]\nseed = 9223372036854775808", "[loop] seed: 9223372036854775808 should be less than"),
    ("", "[loop]\nestimate_every = 9223372036854775808", "[loop] estimate_every: beyond 1e+12 samples"),
    ("", "[loop]\ncovariance_every = 12", "[loop] covariance_every: 12 is no multiple of 8"),
    ("", "[link]\ntimeout_s = 1e300", "[link] timeout_s: 1e+300 s is beyond 3600"),
    ("", OBSERVER + "memory_s = 1e-9", "[observer] memory_s: 1e-09 s is shorter than a cycle of 200.7 Hz"),
    (
        "",
        OBSERVER + 'memory_s = 1e6\ngain = "stationary"',
        "[observer] memory_s: a stationary gain for 1e+06 s at 4000 Hz takes 1.6e+04 s to compute",
    ),
    (
        "",
        OBSERVER + 'gain = "stationary"\nbackend = "filterpy"',
        '[observer] backend: "filterpy" has no stationary gain; use "c" or "numpy"',
    ),
    ("", "[observer.initial_sd]\nstiffness = 1e9", "[observer.initial_sd] stiffness: 1e+09 is beyond 1"),
    ("", "[observer.process_noise]\nrate_rad_s_per_rts = 1e99", "[observer.process_noise] rate_rad_s_per_rts: 1e+99"),
    ("", "[controller]\nvirtual_rotation_rad_s = -1e9", "[controller] virtual_rotation_rad_s: -1e+09 rad/s is no slow"),
    (
        "",
        "[controller]\nvirtual_reversal_s = 1e-6",
        "[controller] virtual_reversal_s: 1e-06 s is shorter than a cycle of 200.7 Hz",
    ),
    (
        "",
        "[controller]\nvirtual_reversal_s = 1e-6\n[loop]\nmode = 'gain'\nblock = 40",
        "[controller] virtual_reversal_s: 1e-06 s is shorter than a cycle",
    ),
    ("", "[controller]\nenergy_gain = 1e6", "[controller] energy_gain: 1e+06 acts within less than a cycle"),
    ("", "[controller]\ndither_mps2 = 1e6", "[controller] dither_mps2: 1e+06 m/s² is beyond the drive's full"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), CASES)
def test_it_is_refused_in_one_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    text = MINIMAL.replace(old, new) if old else f"{MINIMAL}\n{new}\n"
    assert text != MINIMAL
    assert complaint(tmp_path, text).startswith(expected)


def test_a_single_axis_has_no_stationary_gain(tmp_path: Path) -> None:
    text = MINIMAL.replace("[1579.0, 1600.0, 10.0]", "[1579.0]").replace("[1e-3, 1.2e-3, 0.0]", "[1e-3]")
    text = (
        text.replace("mass_kg", "axes = 1\nmass_kg")
        + '[controller]\nenabled = false\n[observer]\ngain = "stationary"\n'
    )
    assert complaint(tmp_path, text).startswith('[observer] gain: "stationary" is a table over the pattern\'s angle')


@pytest.mark.parametrize(
    "path", sorted(examples.find("bench", "s-slow").parent.glob("*.bench.toml")), ids=lambda p: p.stem
)
def test_no_example_is_implausible(path: Path) -> None:
    assert load_any_bench(path)


def test_an_ekf_has_no_memory_to_be_too_short(tmp_path: Path) -> None:
    path = tmp_path / "probe.bench.toml"
    path.write_text(MINIMAL + '[observer]\ngain = "ekf"\nmemory_s = 1e-9\n')
    assert isinstance(load_any_bench(path), Bench)
