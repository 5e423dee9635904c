"""Rate sensors made here by other means than the chain's own functions; the trace must name what is in them."""

import math

import numpy as np
import pytest
from scipy.signal import lsim

from estimator.diagnosis import Verdict
from estimator.errors import ModelError
from estimator.rate_sensor.catalogue import EFFECTS, effect_for
from estimator.rate_sensor.declaration import Range
from estimator.rate_sensor.dynamics import first_order, second_order
from estimator.rate_sensor.record import SensorRecord
from estimator.rate_sensor.trace import alternate_blocks, trace_sensor

DEGREE = math.pi / 180
DECLARED = Range(100 * DEGREE, 2.0)
STEP = 1e-3


def table(curve, seed=1, noise=1e-4):
    """Steady states at repeated rates, the last quarter beyond those of the rest: volts = curve(share of the range)."""
    fraction = np.concatenate([np.linspace(-1, 1, 11), np.linspace(-1.6, 1.6, 11), np.linspace(-1, 1, 11)])
    fraction = np.append(fraction, np.linspace(-2, 2, 11))
    volts = curve(fraction) + noise * np.random.default_rng(seed).standard_normal(len(fraction))
    return SensorRecord(fraction * DECLARED.rate, volts), np.arange(len(fraction)) < 33


def motion(seconds=4.0, seed=2):
    """A rate that rests at first, then steps between levels with a sine on them, and its times."""
    t = np.arange(int(seconds / STEP)) * STEP
    rng = np.random.default_rng(seed)
    levels = rng.uniform(-0.8, 0.8, 40)[(t / 0.1).astype(int)]
    return t, np.where(t < 0.1, 0.0, DECLARED.rate * (levels + 0.1 * np.sin(2 * math.pi * 15 * t)))


@pytest.mark.beyond(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "curve", "coefficient", "value"),
    [
        ("saturation", lambda f: np.clip(0.1 + 2.0 * f, -2.4, 2.6), "hi", 2.6),
        ("quadratic", lambda f: 0.1 + 2.0 * (f + 0.02 * f**2), "q", 0.02),
        ("cubic", lambda f: 0.1 + 2.0 * (f - 0.02 * f**3), "c", -0.02),
        ("scale_asymmetry", lambda f: 0.1 + 2.0 * (f + 0.02 * np.abs(f)), "a", 0.02),
        ("dead_band", lambda f: 0.1 + 2.0 * np.sign(f) * np.maximum(np.abs(f) - 0.15, 0), "b", 0.15 * DECLARED.rate),
    ],
)
def test_a_curve_is_named_from_steady_states(name, curve, coefficient, value):
    record, fitting = table(curve)
    found = trace_sensor(record, DECLARED, 1e-4, fitting)
    assert [effect.name for effect in found.effects] == [name]
    assert found.verdict is Verdict.EXPLAINED
    interval = found.effects[0].coefficients[coefficient]
    assert interval.low - 0.01 * abs(value) < value < interval.high + 0.01 * abs(value)
    assert found.held_out_after.ratio < 2.0 < found.held_out_before.ratio
    (stated,) = found.probabilities
    assert stated.effect == name
    assert stated.probabilities[name] > 0.95


@pytest.mark.slow
def test_a_straight_line_is_adequate():
    for seed in range(10):
        record, fitting = table(lambda f: 0.1 - 2.0 * f, seed)
        (stated,) = trace_sensor(record, DECLARED, 1e-4, fitting).probabilities
        assert stated.effect is None
        assert stated.probabilities["nothing"] > 0.8
        found = trace_sensor(record, DECLARED, 1e-4, fitting)
        assert found.verdict is Verdict.ADEQUATE
        assert not found.effects


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("seed", [78, 151, 160])
def test_what_chance_makes_of_a_few_points_is_no_residual(seed):
    """A straight line of which an effect explains more than its price by chance, as on 5 of 300 such tables: no more
    than the best of so many kinds may.
    """
    rates = DECLARED.rate * np.concatenate([np.linspace(-0.9, 0.9, 42), np.linspace(-1, 1, 21)])
    noise = 2e-3 * np.random.default_rng(seed).standard_normal(63)
    record = SensorRecord(rates, 2.5 + 0.573 * rates + noise)
    found = trace_sensor(record, DECLARED, 2e-3, np.arange(63) < 42)
    assert found.verdict is Verdict.ADEQUATE
    assert not found.effects
    assert any("no more than chance" in one.reason for one in found.rejected)


@pytest.mark.moderate
def test_what_only_the_held_out_part_shows_is_unexplained():
    record, fitting = table(lambda f: np.clip(2.0 * f, -3.4, 3.4))
    found = trace_sensor(record, DECLARED, 1e-4, fitting)
    assert found.verdict is Verdict.UNEXPLAINED
    assert not found.effects
    assert any("beyond those of the fitting part" in reason for reason in found.reasons)


@pytest.mark.moderate
def test_an_output_that_folds_back_does_not_saturate():
    """Flat at 3.2 V over the rates that are fitted; beyond them, held out, it reads 3.8 V, and then folds back."""

    def folded(f):
        size = np.minimum(2.0 * np.abs(f), 3.2)
        size = np.where(np.abs(f) > 1.7, 3.8, size)
        return np.sign(f) * np.where(np.abs(f) > 1.9, 1.0, size)

    fraction = np.concatenate([np.linspace(-1.65, 1.65, 34)] * 2 + [np.linspace(-2.0, 2.0, 41)])
    volts = folded(fraction) + 1e-4 * np.random.default_rng(4).standard_normal(len(fraction))
    record, fitting = SensorRecord(fraction * DECLARED.rate, volts), np.arange(len(fraction)) < 68
    found = trace_sensor(record, DECLARED, 1e-4, fitting)
    assert found.verdict is Verdict.UNEXPLAINED
    assert not found.effects
    limits = [one.reason for one in found.rejected if "saturation" in one.name]
    assert any("saturation ends at 3.2 V, and the part held out reads 3.8 V" in reason for reason in limits)
    assert any("beyond those of the fitting part" in reason for reason in found.reasons)


@pytest.mark.slow
def test_a_curve_of_which_something_is_left_is_explained_in_part():
    """A cubic curve and ripples that nothing in the catalogue has."""
    record, fitting = table(lambda f: 0.1 + 2.0 * (f - 0.05 * f**3) + 1e-3 * np.sin(40.0 * f))
    found = trace_sensor(record, DECLARED, 1e-4, fitting)
    assert found.verdict is Verdict.PARTLY
    assert [effect.name for effect in found.effects] == ["cubic"]
    assert found.share is not None
    assert 0.9 < found.share < 1.0
    assert found.reasons[0].startswith("something acts like cubic")
    assert "× the noise floor" in found.reasons[1]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "system", "coefficients"),
    [
        ("lag", ([1.0], [0.008, 1.0]), {"tau": 0.008}),
        ("second_order", ([1.0], [1 / 150.0**2, 0.8 / 150.0, 1.0]), {"f": 150.0 / (2 * math.pi), "zeta": 0.4}),
    ],
)
def test_a_response_is_named_from_a_motion(name, system, coefficients):
    t, rate = motion()
    _, filtered, _ = lsim(system, rate, t)
    volts = 0.05 + 2.0 * filtered / DECLARED.rate + 1e-3 * np.random.default_rng(3).standard_normal(len(t))
    found = trace_sensor(SensorRecord(rate, volts, STEP), DECLARED, 1e-3, alternate_blocks(len(t), 50))
    assert found.effects[0].name == name
    assert found.verdict is Verdict.EXPLAINED
    for coefficient, value in coefficients.items():
        assert found.effects[0].coefficients[coefficient].value == pytest.approx(value, rel=0.03)
    assert found.held_out_after.ratio == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_a_moving_mean_is_named_from_a_motion():
    """The mean of twelve samples, made at eight times their rate."""
    finely = 8
    t = np.arange(int(4.0 / STEP) * finely) * STEP / finely
    levels = np.random.default_rng(2).uniform(-0.8, 0.8, 40)[(t / 0.1).astype(int)]
    fine = np.where(t < 0.1, 0.0, DECLARED.rate * (levels + 0.1 * np.sin(2 * math.pi * 15 * t)))
    window = 12 * finely
    mean = np.convolve(np.concatenate([np.zeros(window - 1), fine]), np.ones(window) / window, "valid")[::finely]
    rate = fine[::finely]
    volts = 0.05 + 2.0 * mean / DECLARED.rate + 1e-2 * np.random.default_rng(3).standard_normal(len(rate))
    found = trace_sensor(SensorRecord(rate, volts, STEP), DECLARED, 1e-2, alternate_blocks(len(rate), 50))
    assert found.effects[0].name == "moving_mean"
    assert found.effects[0].coefficients["T"].value == pytest.approx(12 * STEP, rel=0.1)


@pytest.mark.slow
def test_a_hysteresis_is_named_from_a_table_that_goes_up_and_down():
    up = np.linspace(-1.0, 1.0, 21)
    fraction = np.concatenate([up, up[::-1]] * 4)
    at, shown = fraction[0], []
    for value in fraction:
        at = min(max(at, value - 0.07), value + 0.07)
        shown.append(at)
    volts = 0.1 + 2.0 * np.array(shown) + 1e-4 * np.random.default_rng(5).standard_normal(len(fraction))
    record = SensorRecord(fraction * DECLARED.rate, volts)
    found = trace_sensor(record, DECLARED, 1e-4, np.arange(len(fraction)) < 126)
    assert [effect.name for effect in found.effects] == ["hysteresis"]
    assert found.effects[0].coefficients["w"].value == pytest.approx(0.07 * DECLARED.rate, rel=0.01)


@pytest.mark.slow
def test_an_output_that_folds_back_where_it_is_fitted_is_named():
    def folded(f):
        return np.where(np.abs(f) > 1.2, np.sign(f) * (2.4 - 0.7 * (2.0 * np.abs(f) - 2.4)), 2.0 * f)

    record, fitting = table(folded)
    found = trace_sensor(record, DECLARED, 1e-4, fitting)
    assert [effect.name for effect in found.effects] == ["fold_back"]
    assert found.effects[0].coefficients["s"].value == pytest.approx(0.7, abs=0.01)
    assert found.effects[0].coefficients["hi"].value == pytest.approx(2.4, abs=0.01)


def test_filters_are_those_of_lsim():
    t, rate = motion(0.5)
    for ours, system in (
        (first_order(0.008, STEP).to(rate), ([1.0], [0.008, 1.0])),
        (second_order(30.0, 0.4, STEP).to(rate), ([(60 * math.pi) ** 2], [1.0, 48 * math.pi, (60 * math.pi) ** 2])),
    ):
        _, other, _ = lsim(system, rate - rate[0], t)
        np.testing.assert_allclose(ours, rate[0] + other, atol=1e-9)


@pytest.mark.slow
def test_a_step_between_two_rates_says_nothing_of_a_curve():
    rng = np.random.default_rng(4)
    rate = np.where(np.arange(2000) < 800, 0.0, 0.5 * DECLARED.rate) + 0.003 * rng.standard_normal(2000)
    volts = 0.05 + 2.0 * rate / DECLARED.rate + 1e-3 * rng.standard_normal(2000)
    found = trace_sensor(SensorRecord(rate, volts, STEP), DECLARED, 1e-3, alternate_blocks(2000, 4))
    named = {effect.name for effect in found.effects}
    tried = named | {effect.name for effect in found.rejected}
    assert not tried & {"saturation", "cubic", "quadratic", "dead_band", "scale_asymmetry", "hysteresis"}


def test_every_effect_has_names_units_and_bounds_that_hold_its_starts():
    assert len({effect.name for effect in EFFECTS}) == len(EFFECTS)
    t, rate = motion(0.5)
    record = SensorRecord(rate, 2.0 * rate / DECLARED.rate, STEP, 25.0 + 0.1 * t)
    for effect in EFFECTS:
        bounds = effect.bounds(record, DECLARED)
        assert len(bounds) == len(effect.coefficients)
        for start in effect.starts(record, DECLARED):
            assert all(low <= value <= high for value, (low, high) in zip(start, bounds, strict=True)), effect.name
        for other in effect.look_alikes:
            effect_for(other)


def test_bad_records_are_refused():
    with pytest.raises(ModelError, match="voltage has 9 rows, rate has 10"):
        SensorRecord(np.zeros(10), np.zeros(9))
    with pytest.raises(ModelError, match="voltage: row 3 is not a number"):
        SensorRecord(np.zeros(10), np.array([0, 0, 0, np.nan] + 6 * [0.0]))
    with pytest.raises(ModelError, match="too few; record at least 8"):
        SensorRecord(np.zeros(3), np.zeros(3))
    still = SensorRecord(np.zeros(10), np.zeros(10))
    with pytest.raises(ModelError, match="the rate never changes"):
        trace_sensor(still, DECLARED, 1e-3, np.arange(10) < 5)
    with pytest.raises(ModelError, match="keep some rows to fit and some to score"):
        trace_sensor(still, DECLARED, 1e-3, np.ones(10, bool))
    with pytest.raises(ModelError, match="no effect 'wobble' of a rate sensor"):
        effect_for("wobble")
