"""Rails, lost values and levels of readings that were made with them, and of readings that were not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.missing_force.readings import lost_of, rails_of, readings_of

NOISE, SAMPLES = 5e-4, 40_000
LSB = 7.6e-5


def vibration(depth: float) -> NDArray[np.float64]:
    t = np.arange(SAMPLES) * 0.29
    return np.asarray(0.03 + (1.0 + depth * np.sin(0.004 * t)) * np.cos(t))


def noise() -> NDArray[np.float64]:
    return np.asarray(NOISE * np.random.default_rng(3).standard_normal(SAMPLES))


def test_a_rail_is_found_where_it_is() -> None:
    for level in (1.05, 1.2, 1.29):
        (found,) = rails_of(np.clip(vibration(0.3), -level, level) + noise(), NOISE)[:1]
        assert found == pytest.approx(level, abs=NOISE)


@pytest.mark.parametrize("depth", [0.0, 0.02, 0.3])
def test_a_vibration_has_no_rail(depth: float) -> None:
    assert rails_of(vibration(depth) + noise(), NOISE) == []


def test_what_stands_still_has_no_rail() -> None:
    assert rails_of(noise(), NOISE) == []


def lossy(codes: NDArray[np.int64], every: int, width: int) -> NDArray[np.int64]:
    beyond = codes % every
    return np.asarray(np.where(beyond < width, codes - beyond, codes))


@pytest.mark.parametrize("width", [30, 150])
def test_lost_values_are_found_with_what_stands_for_them(width: int) -> None:
    codes = np.round((vibration(0.3) + noise()) / LSB).astype(np.int64)
    found = lost_of(lossy(codes, 4096, width) * LSB)
    assert len(found) == 9
    np.testing.assert_allclose(found[:, 0] / LSB % 4096, 0.0, atol=1e-6)
    np.testing.assert_allclose(np.ptp(found, axis=1) / LSB, width, atol=4.0)


def test_a_converter_without_flaws_loses_nothing() -> None:
    codes = np.round((vibration(0.3) + noise()) / LSB)
    assert len(lost_of(codes * LSB)) == 0
    assert len(lost_of(vibration(0.3) + noise())) == 0


def test_what_lost_values_take_is_the_same_in_any_unit() -> None:
    """Also where the gain is negative, so that the first of two values is the larger one."""
    true = vibration(0.3)
    codes = np.round((true + noise()) / LSB).astype(np.int64)
    sense = (lossy(codes, 4096, 150) * LSB)[:, None]
    readings = readings_of(sense, np.array([NOISE]))
    for unit in (1.0, -0.4):
        own = readings.scaled(np.array([unit]))
        taken = own.taken(0, true / unit, sense[:, 0] / unit) * unit
        lost = np.abs(sense[:, 0] - true) > 8.0 * NOISE
        assert np.count_nonzero(lost) > 500
        assert np.max(np.abs(sense[lost, 0] - true[lost] - taken[lost])) < 5.0 * NOISE
