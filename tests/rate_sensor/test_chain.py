"""Links of a rate sensor's chain, each beside its equation."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.rate_sensor import chain_model, trace
from estimator.rate_sensor.catalogue import EFFECTS, effect_for
from estimator.rate_sensor.declaration import Range, Stage
from estimator.rate_sensor.dynamics import second_order
from estimator.rate_sensor.model import Chain, straight_line
from estimator.rate_sensor.record import SensorRecord

DECLARED = Range(3.0, 0.5)
N, STEP = 400, 1e-3
TIME = np.arange(N) * STEP
WARM = 25.0 + 3.0 * TIME + np.sin(TIME / 0.01)
RATE = 2.0 * np.sin(TIME / 0.03)
RECORD = SensorRecord(RATE, 0.1 + RATE / 6.0, STEP, WARM)


def volts(name: str, *coefficients: float, rate: Any = RATE) -> Any:
    record = SensorRecord(rate, 0.1 + rate / 6.0, STEP, WARM)
    chain = Chain((effect_for(name),), record, DECLARED)
    return chain.volts(np.array([0.1, 1.0 / 6.0, *coefficients])) - (0.1 + rate / 6.0)


def test_time_is_in_seconds_or_in_steady_states() -> None:
    np.testing.assert_allclose(RECORD.time, TIME)
    np.testing.assert_array_equal(SensorRecord(np.arange(9.0), np.zeros(9)).time, np.arange(9.0))


def test_eight_samples_are_enough() -> None:
    assert len(SensorRecord(np.arange(8.0), np.zeros(8))) == 8


def test_what_the_surroundings_do_is_in_proportion_to_what_departs_from_the_mean() -> None:
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
    expected = (second_order(RATE, 60.0, 0.4, STEP) - RATE) / 6.0
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


def test_a_perfect_fit_has_a_gain_however_large() -> None:
    current: Any = SimpleNamespace(cost=1.0)
    perfect: Any = SimpleNamespace(cost=0.0, unknowns=3)
    assert chain_model._gain(current, perfect, 50.0) == pytest.approx(47.0 * 300.0 * math.log(10.0))
    assert chain_model._gain(perfect, perfect, 50.0) == 0.0


def test_an_interval_of_few_independent_samples_is_wide_and_finite() -> None:
    rows = np.ones(N, dtype=bool)
    noisy = SensorRecord(RATE, 0.1 + RATE / 6.0 + 1e-3 * np.cos(np.arange(N)), STEP)
    line = straight_line(noisy, DECLARED, rows)
    few, many = line.half_widths(rows, 2.0), line.half_widths(rows, float(N))
    assert np.all(np.isfinite(few))
    assert np.all(few > 3.0 * many)


def test_what_leaves_nothing_is_white() -> None:
    rows = np.ones(40, dtype=bool)
    fitted: Any = SimpleNamespace(residual=np.zeros(40), rms=lambda rows: 0.0)
    assert trace._score(fitted, rows, 1e-3, "").whiteness_p == 1.0
    alternating: Any = SimpleNamespace(residual=np.tile([1.0, -1.0], 20), rms=lambda rows: 1.0)
    assert trace._score(alternating, rows, 1e-3, "").whiteness_p < 1e-6
    five = np.arange(40) < 5  # one lag
    assert trace._score(alternating, five, 1e-3, "").whiteness_p < 0.2
