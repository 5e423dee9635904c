"""Scenarios and benches for tests of the loop: S-slow with changes, and S-slow ten times slower."""

import tomllib
from pathlib import Path
from typing import Any

from hil.bench import Bench, examples, load_bench, override
from hil.bench.template import template, values_of
from hil.toml.reading import toml_value

RATE_HZ = 4000.0

# Ten times slower: a tick of 2.5 ms is longer than the stalls of a busy machine, so that what happens in real
# time is what the test does to it and nothing else.
_UNHURRIED_TRUTH = {
    "temperature_K": 0.0,
    "stiffness_N_per_m": [16.107194, 15.475540, 0.157914],
    "damping_N_s_per_m": [1.38230e-4, 1.13097e-4, 6.2832e-6],
}
_UNHURRIED_DEVICE = {
    "name": "S-slow, unhurried",
    "stiffness_N_per_m": (16.0, 15.5, 0.16),
    "damping_N_s_per_m": (1.3e-4, 1.2e-4, 0.0),
    "sample_rate_Hz": 400.0,
}
WATCHDOG_S = 0.5
WATCHDOG_TICKS = 200


def scenario(path: Path, **changes: dict[str, Any]) -> Path:
    """Write S-slow's scenario at a constant rate of 1 rad/s, some keys of its sections changed."""
    table = tomllib.loads(examples.find("scenario", "s-slow").read_text(encoding="utf-8"))
    table["rate"] = {"kind": "constant", "rate_rad_s": 1.0}
    for section, keys in changes.items():
        table[section] = keys if section == "rate" else table.get(section, {}) | keys
    lines = [f"seed = {table.pop('seed')}"]
    for section, keys in table.items():
        lines += [f"[{section}]", *(f"{key} = {toml_value(value)}" for key, value in keys.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def bench(duration_s: float = 0.5, clock: str = "lockstep", **changes: dict[str, Any]) -> Bench:
    """S-slow's bench made short, some keys of its sections changed; sub-tables of [device] are merged."""
    declared = load_bench(examples.find("bench", "s-slow"))
    loop = {"duration_s": duration_s, "settle_s": 0.4 * duration_s, "clock": clock, "seed": 7}
    merged: dict[str, dict[str, Any]] = {"loop": loop}
    for section, keys in changes.items():
        old = getattr(declared, section).model_dump()
        new = {key: {**old[key], **value} if isinstance(value, dict) else value for key, value in keys.items()}
        merged[section] = merged.get(section, {}) | new
    return override(declared, merged, "test")


def unhurried_scenario(path: Path, **changes: dict[str, Any]) -> Path:
    """Write the slow scenario: 20 Hz, 400 samples a second, nothing random but the sense noise."""
    given: dict[str, dict[str, Any]] = {
        "truth": _UNHURRIED_TRUTH,
        "drive": {"full_scale_mps2": 0.1, "noise_mps2_per_rtHz": 0.0},
        "board": {"sample_rate_Hz": 400.0},
        "rate": {"kind": "constant", "rate_rad_s": 0.1},
    }
    for section, keys in changes.items():
        given[section] = given.get(section, {}) | keys
    return scenario(path, **given)


def unhurried_bench(duration_s: float, clock: str = "paced", **changes: dict[str, Any]) -> Bench:
    """What is declared of it: close to the truth, so that a second is enough to get hold of it."""
    given: dict[str, dict[str, Any]] = {
        "link": {"watchdog_s": WATCHDOG_S, "timeout_s": 10.0},
        "device": _UNHURRIED_DEVICE | {"drive": {"full_scale": 0.1, "noise_mps2_per_rtHz": 0.0}},
        "observer": {
            "memory_s": 10.0,
            "acquisition_s": 1.0,
            "initial_sd": {"rate_rad_s": 0.2, "stiffness": 0.02, "damping": 0.5},
            "process_noise": {"force_mps2_per_rtHz": 1e-8, "rate_rad_s_per_rts": 0.03},
        },
        "controller": {
            "target_stiffness_N_per_m": 15.791,
            "virtual_rotation_rad_s": 0.3,
            "dither_mps2": 0.003,
        },
        "limits": {"late_fraction": 1.0},
    }
    for section, keys in changes.items():
        given[section] = given.get(section, {}) | keys
    return bench(duration_s, clock, **given)


def bench_file(path: Path, declared: Bench) -> Path:
    """Write a bench file that says the same."""
    path.write_text(template(values_of(declared), "For a test."), encoding="utf-8")
    return path
