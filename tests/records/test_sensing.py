"""A stuck channel and a saturated one are told from sound ones, by codes alone."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.records.capture import Capture
from hil.records.sensing import Counts, Runs, sense_faults

SCALE_V = 1e-5
N = 8000


def record(x: NDArray[Any]) -> Capture:
    columns = {
        "tick": np.arange(N),
        "vx_code": np.rint(x / SCALE_V).astype(np.int32),
        "ux_code": np.zeros(N, np.int32),
    }
    scales = {name: {"unit": "V", "scale": SCALE_V} for name in columns}
    return Capture(columns, {"tick_rate_Hz": 1000.0, "axes": 1, "columns": scales}, True)


@pytest.fixture
def signal() -> NDArray[Any]:
    """A sine of 0.1 V with 5 codes of noise."""
    return 0.1 * np.sin(0.3 * np.arange(N)) + 5e-5 * np.random.default_rng(1).standard_normal(N)


def test_a_sound_channel_has_nothing_to_tell(signal: NDArray[Any]) -> None:
    assert sense_faults(record(signal), 5e-5) == []
    assert sense_faults(record(5e-4 * signal), 5e-5) == []  # a still one: noise of 2 codes alone


def test_a_stuck_channel(signal: NDArray[Any]) -> None:
    signal[3000:3200] = signal[3000]
    (line,) = sense_faults(record(signal), 5e-5)
    assert line == "channel x repeated one code for 0.199 s from 3 s on: it is stuck"


@pytest.mark.parametrize("sides", [1, 2])
def test_a_saturated_channel(signal: NDArray[Any], sides: int) -> None:
    clipped = np.clip(signal, -0.08 if sides == 2 else -1.0, 0.08)
    (line,) = sense_faults(record(clipped), 5e-5)
    assert line == "channel x went no further than 0.08 V: its amplifier saturates"


def test_without_noise_nothing_can_be_said(signal: NDArray[Any]) -> None:
    signal[3000:3200] = signal[3000]
    assert sense_faults(record(signal), 4e-6) == []


@pytest.mark.parametrize("cuts", [[], [1], [2, 3], [1, 2, 3, 4, 5], [3, 5]])
def test_a_stretch_across_parts_is_one(cuts: list[int]) -> None:
    codes = np.array([1, 1, 2, 2, 2, 1], np.int32)
    runs = Runs()
    for part in np.split(codes, cuts):
        runs.add(part)
    assert runs.longest == (2, 3)


def test_codes_of_all_parts_are_counted_together() -> None:
    counts = Counts()
    for low in (500, -300, 0):
        counts.add(np.arange(low, low + 400, dtype=np.int32))
    assert counts.crowded() is None
    counts.add(np.full(600, -17, np.int32))
    assert counts.crowded() == -17
