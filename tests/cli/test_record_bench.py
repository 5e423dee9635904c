"""The bench file of a record needs only what a record has."""

import pytest

from hil.bench import load_bench
from hil.errors import InputError

SLOW = """
[device]
name = "pendulum"
axes = 1
mass_kg = 1.0
stiffness_N_per_m = [{stiffness}]
damping_N_s_per_m = [0.01]
amplitude_m = 0.1
sample_rate_Hz = 10.0
[device.sense]
gain_V_per_m = 1.0
noise_V = 1e-3
[device.drive]
unit = "N"
full_scale = 1.0
[controller]
enabled = false
"""


def loaded(tmp_path, text):
    place = tmp_path / "slow.bench.toml"
    place.write_text(text, encoding="utf-8")
    return load_bench(place)


def test_a_slow_device_needs_no_watchdog_and_no_memory(tmp_path):
    """10 samples a second, and a cycle of 6.3 s, for which 0.02 s and 1 s would be too short."""
    bench = loaded(tmp_path, SLOW.format(stiffness=1.0))
    assert bench.watchdog_s == pytest.approx(0.2)  # two samples
    assert bench.memory_s == pytest.approx(62.8, rel=1e-3)  # ten cycles
    fast = bench.with_(device={"sample_rate_Hz": 4000.0, "stiffness_N_per_m": [1e6]})
    assert (fast.watchdog_s, fast.memory_s) == (0.02, 1.0)


def test_what_is_given_is_held_to(tmp_path):
    with pytest.raises(InputError, match="watchdog_s: shorter than two samples"):
        loaded(tmp_path, SLOW.format(stiffness=1.0) + "[link]\nwatchdog_s = 0.1\n")


@pytest.mark.parametrize("stiffness", [38.71, 39.4, 1.0])
def test_a_memory_that_is_asked_for_is_enough(tmp_path, stiffness):
    """What the message says, followed, works: 1 s is shorter than a cycle of 1.01 s, and "1" would be no advice."""
    text = SLOW.format(stiffness=stiffness) + "[observer]\nmemory_s = {memory}\n"
    with pytest.raises(InputError, match="is shorter than a cycle") as refused:
        loaded(tmp_path, text.replace("{memory}", "0.9"))
    least = str(refused.value).partition("give at least ")[2].partition(" s,")[0]
    assert loaded(tmp_path, text.replace("{memory}", least)).memory_s == float(least)
    assert 'or gain = "ekf", which forgets nothing' in str(refused.value)
