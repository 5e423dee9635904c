"""Links of a rate sensor's chain, each beside its equation."""

import math
from typing import Any

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.rate_sensor.catalogue import EFFECTS, effect_for
from estimator.rate_sensor.chain import volts_of
from estimator.rate_sensor.declaration import Range, Stage
from estimator.rate_sensor.dynamics import second_order
from estimator.rate_sensor.record import SensorRecord

DECLARED = Range(3.0, 0.5)
N, STEP = 400, 1e-3
TIME = np.arange(N) * STEP
WARM = 25.0 + 3.0 * TIME + np.sin(TIME / 0.01)
RATE = 2.0 * np.sin(TIME / 0.03)
RECORD = SensorRecord(RATE, 0.1 + RATE / 6.0, STEP, WARM)


def volts(name: str, *coefficients: float, rate: Any = RATE) -> Any:
    record = SensorRecord(rate, 0.1 + rate / 6.0, STEP, WARM)
    given = [(effect_for(name), np.array(coefficients))]
    return volts_of(given, np.array([0.1, 1.0 / 6.0]), record, DECLARED) - (0.1 + rate / 6.0)


def test_time_is_in_seconds_or_in_steady_states() -> None:
    np.testing.assert_allclose(RECORD.time, TIME)
    np.testing.assert_array_equal(SensorRecord(np.arange(9.0), np.zeros(9)).time, np.arange(9.0))


def test_eight_samples_are_enough() -> None:
    assert len(SensorRecord(np.arange(8.0), np.zeros(8))) == 8


def test_the_surroundings_act_in_proportion_to_their_departure() -> None:
    warmth = WARM - np.mean(WARM)
    np.testing.assert_allclose(volts("drift", 0.02), 0.02 * (TIME - np.mean(TIME)), atol=1e-15)
    np.testing.assert_allclose(volts("temperature_offset", 0.02), 0.02 * warmth, atol=1e-15)
    np.testing.assert_allclose(volts("temperature_scale", 0.02), 0.02 * warmth * RATE / 6.0, atol=1e-15)


def test_a_limit_is_one_of_the_volts_and_of_nothing_before() -> None:
    stages = [Stage.REFERENCE, Stage.RATE, Stage.CHARACTERISTIC, Stage.SURROUNDINGS, Stage.LIMIT]
    assert sorted(set(stages)) == stages
    saturated = volts("saturation", -0.1, 0.3) + 0.1 + RATE / 6.0
    np.testing.assert_allclose(saturated, np.clip(0.1 + RATE / 6.0, -0.1, 0.3))


def test_a_second_order_is_by_its_frequency_and_its_damping() -> None:
    expected = (second_order(60.0, 0.4, STEP).to(RATE) - RATE) / 6.0
    np.testing.assert_allclose(volts("second_order", 60.0, 0.4), expected, atol=1e-12)


def test_noise_of_a_reference_is_what_is_fast() -> None:
    """Below f_r the reading is the rate, without phase; above it is noise."""
    slow, fast = np.sin(2.0 * math.pi * 5.0 * TIME), np.sin(2.0 * math.pi * 200.0 * TIME)
    inner = slice(100, -100)
    np.testing.assert_allclose((volts("reference_noise", 50.0, rate=slow) * 6.0)[inner], 0.0, atol=0.01)
    np.testing.assert_allclose((volts("reference_noise", 50.0, rate=fast) * 6.0 + fast)[inner], 0.0, atol=0.02)


def test_an_unknown_effect_is_told_with_those_that_are() -> None:
    with pytest.raises(ModelError) as refusal:
        effect_for("wobble")
    for effect in EFFECTS:
        assert effect.name in str(refusal.value)
