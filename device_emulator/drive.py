"""Drive chain: codes to force per unit mass, held over a sample interval, and the queue in front of it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.effects.catalogue import delay_s, slew_mps3
from device_emulator.flicker import FLICKER, MAX_FLICKER_POLES, flicker_constants
from device_emulator.scenario import MAX_DELAY_SAMPLES, Scenario

RECENT = MAX_DELAY_SAMPLES + 2

DRIVE = np.dtype(
    [
        ("lsb_mps2", "f8"),
        ("delay_samples", "i8", 2),  # whole samples of the delay
        ("delay_rest_s", "f8", 2),  # and what is left of it
        ("ts_s", "f8"),
        ("slew_mps3", "f8", 2),
        ("flicker", FLICKER),
    ],
    align=True,
)

# Forces of the last intervals, by row number and axis: each runs from `start` with `slope` until `reach_s`, then stays.
DRIVE_STATE = np.dtype(
    [
        ("recent", "f8", (RECENT, 2)),
        ("start", "f8", (RECENT, 2)),
        ("slope", "f8", (RECENT, 2)),
        ("reach_s", "f8", (RECENT, 2)),
        ("flicker", "f8", (2, MAX_FLICKER_POLES)),
        ("flickering", "f8", 2),  # their sums: force per mass on each axis
    ],
    align=True,
)


def drive_scale(scenario: Scenario) -> float:
    """One drive code in m/s²."""
    return math.ldexp(scenario.drive.full_scale_mps2, 1 - scenario.drive.dac_bits)


def drive_code_max(scenario: Scenario) -> int:
    """Largest code of the converter; the range is symmetric, so that a force can be turned round exactly."""
    return (1 << (scenario.drive.dac_bits - 1)) - 1


def drive_constants(scenario: Scenario) -> NDArray[Any]:
    """The chain as its kernels read it, shape (1,) of dtype `DRIVE`."""
    constants = np.zeros(1, DRIVE)
    c = constants[0]
    c["lsb_mps2"] = drive_scale(scenario)
    c["ts_s"] = 1.0 / scenario.true_rate_Hz
    c["slew_mps3"] = slew_mps3(scenario.effect)
    constants["flicker"] = flicker_constants(scenario.drive.flicker_mps2_at_1Hz, scenario.true_rate_Hz)
    for axis, delay in enumerate(delay_s(scenario.effect, "drive_delay")):
        whole = math.floor(delay * scenario.true_rate_Hz)
        c["delay_samples"][axis] = whole
        c["delay_rest_s"][axis] = delay - whole / scenario.true_rate_Hz
    return constants
