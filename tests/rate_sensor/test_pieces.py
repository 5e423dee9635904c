"""Pieces of a rate sensor's trace: laws, where they are searched, the fit's numbers, what a record shows of each."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from scipy.signal import butter, filtfilt

from estimator.rate_sensor.catalogue import EFFECTS, effect_for, names
from estimator.rate_sensor.chain import RateSensor, noise_floor, volts_of
from estimator.rate_sensor.declaration import Range, Stage
from estimator.rate_sensor.dynamics import first_order, second_order
from estimator.rate_sensor.record import SensorRecord
from estimator.rate_sensor.trace import alternate_blocks
from estimator.scaling import Array
from estimator.trace.fit import at, fit
from estimator.trace.likelihood import Model

DECLARED = Range(4.0, 2.0)
N, STEP = 300, 1e-3
TIME = np.arange(N) * STEP
RATE = 3.0 * np.sin(TIME / 0.02) + np.sin(TIME / 0.0051)
V0, S = 0.1, 0.5
PLAIN = SensorRecord(RATE, V0 + S * RATE, STEP, 20.0 + 10.0 * TIME)
ALL = np.ones(N, dtype=bool)


def sensor(record: SensorRecord, rows: Array = ALL, declared: Range = DECLARED) -> RateSensor:
    told, floor = np.flatnonzero(rows), (1e-2, math.inf, "the declared noise")
    return RateSensor(record, declared, told=told, counted=told, noise=1e-2, floor=floor)


def tried(of: RateSensor, *included: str) -> set[str]:
    """Kinds of effects that are tried beside those."""
    model = Model({name: {} for name in included}, np.zeros(2), of.declared_noise())
    return {name.partition(":")[0] for name in of.candidates(model, of.evaluate(of.layout({}), model))}


def acted(name: str, *coefficients: float, rate: Array = RATE) -> Array:
    """Volts with the effect, less the line."""
    record = SensorRecord(rate, V0 + S * rate, STEP, PLAIN.temperature)
    return volts_of([(effect_for(name), np.array(coefficients))], np.array([V0, S]), record, DECLARED)


# -- laws -------------------------------------------------------------------------------------------------------------


def test_curves_are_in_shares_of_the_range() -> None:
    for name, curve in (
        ("quadratic", RATE**2 / 4.0),
        ("cubic", RATE**3 / 16.0),
        ("scale_asymmetry", np.abs(RATE)),
    ):
        np.testing.assert_allclose(acted(name, 0.03), V0 + S * (RATE + 0.03 * curve))
    np.testing.assert_allclose(
        acted("dead_band", 0.7), V0 + S * np.sign(RATE) * np.maximum(np.abs(RATE) - 0.7, 0.0), atol=1e-12
    )


@pytest.mark.moderate
def test_a_play_follows_at_its_width() -> None:
    rate = np.array([0.0, 1.0, 2.0, 1.5, 0.5, -3.0, -2.5, 0.0, 9.0])
    expected = [0.0, 0.25, 1.25, 1.25, 1.25, -2.25, -2.25, -0.75, 8.25]
    record = SensorRecord(rate, rate)
    found = volts_of([(effect_for("hysteresis"), np.array([0.75]))], np.array([0.0, 1.0]), record, DECLARED)
    np.testing.assert_allclose(found, expected)


def test_a_knee_is_a_softened_limit() -> None:
    volts = V0 + S * RATE
    low, high, soft, hard = -0.8, 1.2, 0.1, 0.02
    expected = [
        v - hard * math.log1p(math.exp((v - high) / hard)) + soft * math.log1p(math.exp((low - v) / soft))
        for v in volts
    ]
    np.testing.assert_allclose(acted("soft_saturation", low, high, soft, hard), expected, rtol=1e-9)
    np.testing.assert_allclose(acted("soft_saturation", low, high, 1e-4, 1e-4), np.clip(volts, low, high), atol=1e-4)


def test_a_late_rate_is_the_one_before_and_a_lagging_reference_is_led() -> None:
    ramp = 2.0 * TIME / STEP / N
    np.testing.assert_allclose((acted("delay", 2.5 * STEP, rate=ramp) - V0)[5:], S * (ramp - 5.0 / N)[5:])
    np.testing.assert_allclose(acted("reference_lag", 0.01, rate=ramp), V0 + S * (ramp + 0.01 * 2.0 / STEP / N))
    np.testing.assert_allclose(acted("lag", 0.004), V0 + S * first_order(0.004, STEP).to(RATE))
    np.testing.assert_allclose(first_order(0.0, STEP).to(RATE), RATE, atol=2e-3 * np.max(np.abs(np.diff(RATE))))
    assert np.max(np.abs(first_order(1e-5, STEP).to(RATE) - RATE)) > 1e-4


@pytest.mark.parametrize("zeta", [0.3, 1.0, 3.0])
def test_a_response_that_began_elsewhere_is_one_at_rest_and_a_free_one(zeta: float) -> None:
    """Beside SciPy's, of a low-pass at 12 Hz and critical damping among others."""
    w, record = 2.0 * np.pi * 12.0, SensorRecord(RATE, RATE, STEP)
    system = scipy.signal.lti([w * w], [1.0, 2.0 * zeta * w, w * w]).to_ss()
    _, shown, _ = scipy.signal.lsim(system, RATE, TIME, X0=[0.02, -1e-4])
    free = second_order(12.0, zeta, STEP).free(record)
    missing = shown - second_order(12.0, zeta, STEP).to(RATE)
    assert free.shape == (N, 2)
    told = np.linalg.lstsq(free, missing, rcond=None)[0]
    assert np.max(np.abs(missing)) > 0.1
    np.testing.assert_allclose(free @ told, missing, atol=1e-9 * np.max(np.abs(missing)))


def test_an_output_folds_back_at_its_limits() -> None:
    volts = V0 + S * RATE
    expected = [1.1 - 0.4 * (v - 1.1) if v > 1.1 else -0.7 + 0.4 * (-0.7 - v) if v < -0.7 else v for v in volts]
    np.testing.assert_allclose(acted("fold_back", -0.7, 1.1, 0.4), expected, rtol=1e-9)


@pytest.mark.parametrize("samples", [0.4, 1.0, 3.0, 7.3])
def test_a_moving_mean_is_that_of_a_rate_straight_between_its_samples(samples: float) -> None:
    """By quadrature on a grid far finer than the samples; before the first, the sensor rests at its rate."""
    fine = 500
    window = samples * STEP
    grid = (np.arange(int(samples * fine)) + 0.5) / int(samples * fine) * window
    expected = [np.interp(t - grid, TIME, RATE).mean() for t in TIME]
    np.testing.assert_allclose(acted("moving_mean", window), V0 + S * np.array(expected), atol=1e-6)
    np.testing.assert_array_equal(acted("moving_mean", 0.0), V0 + S * RATE)


@pytest.mark.parametrize("cut", [50.0, 100.0, 480.0, 499.0])
def test_a_reference_is_read_below_its_frequency(cut: float) -> None:
    numerator, denominator = butter(2, min(cut / (0.5 / STEP), 0.99))
    expected = V0 + S * filtfilt(numerator, denominator, RATE)
    np.testing.assert_allclose(acted("reference_noise", cut), expected, rtol=1e-9)


def test_stages_are_in_order_whatever_the_order_of_the_effects() -> None:
    """Reference, rate, curve, surroundings, limit."""
    taken = {
        "saturation": {"lo": -0.9},
        "drift": {},
        "quadratic": {},
        "lag": {"tau": 1.0},
        "reference_lag": {"tau_r": 1.0},
    }
    of = sensor(PLAIN)
    layout = of.layout(taken)
    values = np.array([V0, S, -0.9, 1.4, 3.0, 0.05, 0.004, 0.002])
    rate = RATE + 0.002 * np.gradient(RATE, STEP)
    rate = first_order(0.004, STEP).to(rate)
    volts = V0 + S * (rate + 0.05 * rate**2 / 4.0) + 3.0 * (TIME - TIME.mean())
    np.testing.assert_allclose(of.predicted(layout, values / layout.factor).values, np.clip(volts, -0.9, 1.4))
    assert layout.names == ("V0", "S", "lo", "hi", "r", "q", "tau", "tau_r")
    model = at(of, layout, Model(taken, values / layout.factor, of.declared_noise()))
    units = [of.interval(model, k).unit for k in range(len(values))]
    assert units == ["V", "V·s/rad", "V", "V", "V/s", "1", "s", "s"]


# -- where they are searched ------------------------------------------------------------------------------------------


def test_searches_begin_within_bounds_that_are_those_of_a_sensor() -> None:
    """Half of the range for a curve or a band, a tenth of the record for a response, the voltages seen for a limit."""
    low, high = float(np.min(PLAIN.voltage)), float(np.max(PLAIN.voltage))
    span, middle = high - low, 0.5 * (low + high)
    limits = ((low - 0.02 * span, middle), (middle, high + 0.02 * span))
    wider = ((low - 0.25 * span, middle), (middle, high + 0.25 * span))
    fraction, volts = ((-0.5, 0.5),), ((-2.0, 2.0),)
    longest = 0.1 * float(TIME[-1])
    expected = {
        "quadratic": fraction, "cubic": fraction, "scale_asymmetry": fraction,
        "dead_band": ((0.0, 2.0),), "hysteresis": ((0.0, 2.0),), "saturation": limits,
        "soft_saturation": (*limits, (2e-3, 0.6), (2e-3, 0.6)),
        "fold_back": (*wider, (0.0, 3.0)), "moving_mean": ((0.0, longest),),
        "lag": ((0.0, longest),), "delay": ((0.0, longest),), "reference_lag": ((0.0, longest),),
        "second_order": ((0.1 / longest, 500.0), (0.05, 5.0)), "reference_noise": ((10.0, 490.0),),
        "drift": volts, "temperature_offset": volts, "temperature_scale": ((-0.1, 0.1),),
    }  # fmt: skip
    inside = 0.05 * span
    starts = {
        **dict.fromkeys(("quadratic", "cubic", "scale_asymmetry", "drift"), ((0.0,),)),
        **dict.fromkeys(("temperature_offset", "temperature_scale"), ((0.0,),)),
        "dead_band": ((0.04,), (0.4,)), "hysteresis": ((0.08,),),
        "saturation": ((low, high), (low + inside, high - inside)),
        "soft_saturation": ((low, high, 0.1, 0.1), (low, high, 0.1, 0.01), (low, high, 0.01, 0.1)),
        "fold_back": tuple((*pair, s) for pair in ((low, high), (low + inside, high - inside)) for s in (0.2, 1.0)),
        "moving_mean": ((0.003,), (0.015,)),
        "lag": ((0.002,), (0.01,)), "delay": ((0.0005,), (0.005,)), "reference_lag": ((0.001,),),
        "second_order": ((30.0, 0.7), (100.0, 0.7)), "reference_noise": ((100.0,), (200.0,)),
    }  # fmt: skip
    assert set(expected) == set(starts) == set(names()) == {effect.name for effect in EFFECTS}
    for effect in EFFECTS:
        np.testing.assert_allclose(effect.bounds(PLAIN, DECLARED), expected[effect.name], err_msg=effect.name)
        np.testing.assert_allclose(effect.starts(PLAIN, DECLARED), starts[effect.name], err_msg=effect.name)


def test_an_effect_needs_what_it_says() -> None:
    steady = SensorRecord(RATE, RATE)
    timed, warm = replace(steady, step=STEP), replace(steady, temperature=PLAIN.temperature)
    for effect in EFFECTS:
        shown = [effect.applies_to(one) for one in (steady, timed, warm, PLAIN)]
        expected = {"": [True] * 4, "time": [False, True, False, True], "temperature": [False, False, True, True]}
        assert shown == expected[effect.needs]
    assert {effect.name for effect in EFFECTS if effect.needs == "temperature"} == {
        "temperature_offset", "temperature_scale"
    }  # fmt: skip
    assert {effect.name for effect in EFFECTS if effect.stage is Stage.LIMIT} == {
        "saturation", "soft_saturation", "fold_back"
    }  # fmt: skip


# -- the likelihood ---------------------------------------------------------------------------------------------------


def test_a_line_is_that_of_least_squares_of_the_rows_with_its_intervals() -> None:
    noisy = replace(PLAIN, voltage=PLAIN.voltage + 1e-2 * np.random.default_rng(1).standard_normal(N))
    rows = np.arange(N) < 200
    line = fit(sensor(noisy, rows), {})
    design = np.column_stack([np.ones(N), RATE])[rows]
    expected = np.linalg.lstsq(design, noisy.voltage[rows], rcond=None)[0]
    np.testing.assert_allclose(line.model.theta * line.layout.factor, expected, rtol=1e-5)
    left = noisy.voltage[rows] - design @ expected
    spread = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * np.mean(left**2))
    robust = np.sqrt(line.scatter)
    half = [line.interval(k, "V").high - line.interval(k, "V").value for k in range(2)]
    np.testing.assert_allclose(half, 1.96 * robust * spread, rtol=1e-3)
    assert 1.0 <= robust < 1.3


def test_derivatives_are_the_law_s_and_a_signature_what_an_effect_adds() -> None:
    of = sensor(PLAIN)
    layout = of.layout({"quadratic": {}})
    theta = np.array([V0, S, 0.03]) / layout.factor
    model = Model({"quadratic": {}}, theta, of.declared_noise())
    seen = of.evaluate(layout, model, tested={"lag:1": {"tau": 0.004}, "cubic": {}})
    law = np.column_stack([np.ones(N), RATE + 0.03 * RATE**2 / 4.0, S * RATE**2 / 4.0]) * layout.factor
    cubic = S * RATE**3 / 16.0 * 0.5  # by one of half of its bounds
    slow = first_order(0.004, STEP).to(RATE)
    beside = (slow + 0.03 * slow**2 / 4.0)[:, None] ** [0, 1]
    line = np.linalg.lstsq(beside, PLAIN.voltage, rcond=None)[0]
    columns = np.column_stack([law, beside @ line - V0 - S * (RATE + 0.03 * RATE**2 / 4.0), cubic])
    expected = columns.T @ columns / of.noise**2
    np.testing.assert_allclose(seen.information.sum(axis=0), expected, rtol=1e-4, atol=1e-6 * np.max(np.diag(expected)))
    np.testing.assert_allclose(seen.innovation[:, 0], -S * 0.03 * RATE**2 / 4.0, atol=1e-12)


def test_a_fit_stays_within_bounds() -> None:
    much = replace(PLAIN, voltage=V0 + S * (RATE + 0.9 * RATE**2 / 4.0))
    found = fit(sensor(much), {"quadratic": {}})
    assert found.model.theta[2] * found.layout.factor[2] == pytest.approx(0.5)


def test_there_is_one_limit_and_one_low_pass_of_whichever_kind() -> None:
    def open_beside(*names: str) -> set[str]:
        of = sensor(replace(PLAIN, rate=np.resize(np.linspace(-3.0, 3.0, 9), N)))
        return tried(of, *names)

    limits, passes = {"saturation", "soft_saturation", "fold_back"}, {"lag", "second_order"}
    assert limits | passes <= open_beside()
    assert not limits & open_beside("soft_saturation:2")
    assert passes <= open_beside("soft_saturation:2")
    assert not passes & open_beside("lag:1")
    assert limits <= open_beside("lag:1")


def test_what_hangs_on_a_rate_before_the_record_does_not_count() -> None:
    """Nor does it make a model more or less likely: the others stand for it."""
    record = replace(PLAIN, voltage=PLAIN.voltage + 1e-3 * np.random.default_rng(4).standard_normal(N))
    of = sensor(record)
    layout = of.layout({"delay:1": {"delay": 0.004}})
    model = Model({"delay:1": {"delay": 0.004}}, np.array([V0, S, 0.004]) / layout.factor, of.declared_noise())
    seen = of.evaluate(layout, model, derivatives=False)
    assert np.isnan(seen.innovation[:4, 0]).all()
    assert np.isfinite(seen.innovation[4:, 0]).all()
    assert seen.count.sum() == pytest.approx(N)
    power = np.nansum((seen.innovation / of.noise) ** 2)
    assert seen.power.sum() == pytest.approx(power * N / (N - 4), rel=1e-5)  # but for a walk that is next to none


# -- what a record shows ----------------------------------------------------------------------------------------------


def test_repeated_rates_tell_the_noise() -> None:
    rates = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 1.0 + 1e-12])
    volts = np.array([1.0, 2.0, 3.0, 7.0, 9.0, 5.0, 90.0, -90.0, 2.0])
    rows = np.flatnonzero(np.arange(9) != 6)
    record = SensorRecord(rates, volts)
    floor, freedom, found = noise_floor(record, rows, 0.25)
    assert floor == pytest.approx(math.sqrt((2.0 + 2.0) / 4.0))  # of 1 and 2 rad/s: Σ(V − V̄)² is 2 each
    assert freedom == 4.0
    assert found == "the scatter of repeated rates"
    declared = (0.25, math.inf, "the declared noise")
    assert noise_floor(replace(record, step=0.1), rows, 0.25) == declared
    assert noise_floor(SensorRecord(np.arange(9.0), volts), rows, 0.25) == declared
    same = SensorRecord(np.repeat([1.0, 2.0, 3.0], 3), np.repeat([1.0, 2.0, 3.0], 3))
    assert noise_floor(same, np.arange(9), 0.25) == declared


@pytest.mark.parametrize(("levels", "shown"), [(4, True), (3, False)])
def test_a_curve_is_shown_by_more_than_three_steady_rates(levels: int, *, shown: bool) -> None:
    """Each rested at for a hundredth of the samples, rates within a fiftieth of the range being one."""
    rate = np.concatenate([np.tile(np.linspace(-3.0, 3.0, levels), 40), [3.5], np.linspace(-0.03, 0.03, 2)])
    of = sensor(SensorRecord(rate, V0 + S * rate, STEP), np.ones(len(rate), bool))
    found = tried(of)
    for name in ("cubic", "quadratic", "hysteresis", "dead_band", "saturation"):
        assert (name in found) is shown, name
    assert "lag" in found


def test_blocks_alternate_and_the_first_is_fitted() -> None:
    assert alternate_blocks(7, 2).tolist() == [True, True, False, False, True, True, False]
