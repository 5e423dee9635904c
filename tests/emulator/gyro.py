"""Scenarios for tests: S-slow without any noise or offset, with changes, and what a device makes of them."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from device_emulator.device import TRUTH_COLUMNS, Device
from device_emulator.scenario import Scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
AMPLITUDE_M = 1e-4
KB = 1.380649e-23

QUIET: dict[str, Any] = {
    "truth": {"temperature_K": 0.0},
    "sense": {"mismatch_m": 0.0, "opamp_offset_V": 0.0, "noise_V": 0.0, "adc_bits": 24},
    "drive": {"noise_mps2_per_rtHz": 0.0},
    "rate": {"kind": "constant", "rate_rad_s": 0.0},
}

# One resonance of 200 Hz on both axes and no loss: everything about it is known in closed form.
IDEAL: dict[str, Any] = {
    "truth": {
        "mass_kg": 1e-3,
        "stiffness_N_per_m": [1579.136704174297, 1579.136704174297, 0.0],
        "damping_N_s_per_m": [0.0, 0.0, 0.0],
    }
}
OMEGA = 2.0 * np.pi * 200.0


def document(*changes: dict[str, Any]) -> dict[str, Any]:
    """S-slow's scenario file with sections changed key by key; [rate] and lists are replaced whole."""
    merged = tomllib.loads((EXAMPLES / "s-slow.scenario.toml").read_text())
    for change in changes:
        for name, value in change.items():
            if isinstance(value, dict) and name != "rate":
                merged[name] = merged.get(name, {}) | value
            else:
                merged[name] = value
    return merged


def scenario(*changes: dict[str, Any]) -> Scenario:
    """A quiet S-slow with changes."""
    return Scenario.model_validate(document(QUIET, *changes))


class Record(NamedTuple):
    """What a device did: codes (n, 2) and its true states by column name."""

    codes: NDArray[np.int32]
    truth: dict[str, NDArray[np.float64]]
    device: Device


def record(what: Scenario, drive_codes: ArrayLike, seed: int | None = None) -> Record:
    """Run a device over given drive codes, one row per row of sense codes."""
    pages: list[NDArray[np.float64]] = []
    device = Device(what, seed, lambda _, rows: pages.append(rows.copy()))
    codes = device.rows(drive_codes)
    device.close()
    rows = np.vstack(pages)
    return Record(codes, dict(zip(TRUTH_COLUMNS, rows.T, strict=False)), device)


def undriven(n: int) -> NDArray[np.int32]:
    """Drive codes of n rows without force."""
    return np.zeros((n, 2), np.int32)


def volts(what: Scenario, codes: NDArray[np.int32]) -> NDArray[np.float64]:
    """Sense codes in V."""
    return codes * (2.0 * what.sense.adc_full_scale_V / 2**what.sense.adc_bits)
