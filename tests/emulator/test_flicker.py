"""1/f noise of the drive and of the bias has the density that is declared, and moves no byte where there is none."""

import numpy as np
import pytest
from scipy.signal import welch

from device_emulator.device import Device
from device_emulator.scenario import Scenario
from tests.emulator.gyro import IDEAL, QUIET, document, record, undriven

FS = 4000.0


def made(truth=None, drive=None):
    """The quiet S-slow on round springs without loss, with keys of two of its tables."""
    table = document(QUIET, IDEAL)
    return Scenario.model_validate(
        table | {"truth": table["truth"] | (truth or {}), "drive": table["drive"] | (drive or {})}
    )


def assert_one_over_f(series, density, fs=FS, low=0.4, high=1.7):
    frequency, power = welch(series, fs=fs, nperseg=8000, detrend="constant")
    for start in 10 ** np.arange(low, high, 1 / 3):
        band = (frequency >= start) & (frequency < 2.15 * start)
        freedom = 2 * (2 * len(series) / 8000) * 0.75 * band.sum()
        assert np.mean(power[band] * frequency[band]) == pytest.approx(
            density**2, rel=0.065 + 5 * np.sqrt(2.0 / freedom)
        )


@pytest.mark.slow
def test_a_bias_that_wanders_turns_the_pattern():
    density = 1e-2
    truth = record(made({"bias_flicker_rad_s_at_1Hz": density}), undriven(200_000)).truth
    assert np.ptp(truth["rate_rad_s"]) == 0.0  # no part of the true rotation
    k = made().truth.stiffness_N_per_m[0] / made().truth.mass_kg
    x, vx, y, vy = (truth[name] for name in ("x_m", "vx_mps", "y_m", "vy_mps"))
    twice = np.unwrap(np.arctan2(2 * (k * x * y + vx * vy), k * (x**2 - y**2) + vx**2 - vy**2))
    cycle = 20  # samples: the pattern's own ripple at twice the resonance is averaged
    turned = (twice[cycle::cycle] - twice[:-cycle:cycle]) / 2 / (cycle / FS)
    frequency, power = welch(turned, fs=FS / cycle, nperseg=2000, detrend="constant")
    for low in (0.5, 1.0, 2.0, 4.0, 8.0):
        band = (frequency >= low) & (frequency < 2 * low)
        freedom = 2 * (2 * len(turned) / 2000) * 0.75 * band.sum()
        expected = np.mean(density**2 / frequency[band] * frequency[band])
        assert np.mean(power[band] * frequency[band]) == pytest.approx(expected, rel=0.1 + 5 * np.sqrt(2.0 / freedom))


@pytest.mark.slow
def test_a_drive_that_wanders_pushes_both_axes():
    """Far below a heavily damped resonance the mass shows the force over its stiffness."""
    density = 1e-2
    still = made().truth
    k = still.stiffness_N_per_m[0] / still.mass_kg
    damping = [still.mass_kg * np.sqrt(k)] * 2 + [0.0]
    still = {"damping_N_s_per_m": damping, "position_m": [0.0, 0.0]}
    truth = record(made(still, {"flicker_mps2_at_1Hz": density}), undriven(200_000)).truth
    for name in ("x_m", "y_m"):
        assert_one_over_f(truth[name] * k, density, high=1.1)
    assert abs(np.corrcoef(truth["x_m"], truth["y_m"])[0, 1]) < 0.9


def test_none_changes_nothing():
    """A scenario without it draws the numbers that it drew: records made before stay as they are."""
    plain = Device(made()).rows(undriven(500))
    assert (
        Device(made({"bias_flicker_rad_s_at_1Hz": 0.0}, {"flicker_mps2_at_1Hz": 0.0})).rows(undriven(500)) == plain
    ).all()
    wandering = Device(made({"bias_flicker_rad_s_at_1Hz": 0.1}, {"flicker_mps2_at_1Hz": 0.1})).rows(undriven(500))
    assert (wandering != plain).any()
