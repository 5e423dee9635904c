"""A stuck channel and a saturated one are told from sound ones, by codes alone."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.records.capture import Capture, RowFlag
from hil.records.sensing import Counts, Runs, sense_faults

SCALE_V = 1e-5
N = 8000


def record(x: NDArray[Any], flagged: NDArray[np.bool_] | None = None) -> Capture:
    columns = {
        "tick": np.arange(N),
        "vx_code": np.rint(x / SCALE_V).astype(np.int32),
        "ux_code": np.zeros(N, np.int32),
    }
    scales = {name: {"unit": "V", "scale": SCALE_V} for name in columns}
    if flagged is not None:
        columns["flags"] = np.where(flagged, RowFlag.ADC_CLIPPED, 0).astype(np.uint8)
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
    (fault,) = sense_faults(record(signal), 5e-5)
    assert fault.text == "channel x repeated one code for 0.199 s from 3 s on: it is stuck"
    assert (fault.voids, fault.until_s) == (True, 3.199)


@pytest.mark.parametrize("sides", [1, 2])
def test_a_saturated_channel(signal: NDArray[Any], sides: int) -> None:
    clipped = np.clip(signal, -0.08 if sides == 2 else -1.0, 0.08)
    (fault,) = sense_faults(record(clipped), 5e-5)
    assert fault.text == "channel x went no further than 0.08 V: its amplifier saturates"
    assert not fault.voids


@pytest.mark.parametrize("noise_V", [5e-5, 4e-6])
def test_what_the_board_flags_as_clipped_is_the_converter(signal: NDArray[Any], noise_V: float) -> None:
    """The flag says so whatever the noise; before 4 s and after 5 s the channel is sound."""
    at = np.arange(N)
    flagged = (at >= 4000) & (at < 5000) & (np.abs(signal) >= 0.08)
    clipped = np.where(flagged, np.clip(signal, -0.08, 0.08), signal)
    (fault,) = sense_faults(record(clipped, flagged), noise_V)
    first, last = at[flagged][[0, -1]] / 1000.0
    said = f"the converter of channel x was at its end (flag CLIPPED) in {flagged.sum()} samples, from {first:.4g} s "
    assert fault.text == f"{said}to {last:.4g} s"
    assert (fault.voids, fault.until_s) == (True, last)


def test_the_fault_that_came_first_is_told_first(signal: NDArray[Any]) -> None:
    signal[3000:3200] = signal[3000]
    for first, second, at in (("repeated", "flag CLIPPED", 3100), ("flag CLIPPED", "repeated", 2900)):
        told = [fault.text for fault in sense_faults(record(signal, np.arange(N) // 100 == at // 100), 5e-5)]
        assert first in told[0]
        assert second in told[1]


def test_a_few_clipped_samples_are_no_fault(signal: NDArray[Any]) -> None:
    """As few as a trace takes: THRESHOLDS.fitness.clipped_share."""
    for count, faults in ((8, 0), (9, 1)):
        assert len(sense_faults(record(signal, np.arange(N) < count), 5e-5)) == faults


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
