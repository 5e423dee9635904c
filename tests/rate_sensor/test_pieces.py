"""Pieces of a rate sensor's trace: laws, where they are searched, the fit's numbers, what a record shows of each."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from estimator.rate_sensor import chain_model, trace
from estimator.rate_sensor.catalogue import EFFECTS, effect_for, names
from estimator.rate_sensor.chain_model import ChainModel
from estimator.rate_sensor.declaration import Range, Stage
from estimator.rate_sensor.dynamics import first_order
from estimator.rate_sensor.model import Chain, SensorFit, fit, straight_line
from estimator.rate_sensor.record import SensorRecord
from estimator.scaling import Array

DECLARED = Range(4.0, 2.0)
N, STEP = 300, 1e-3
TIME = np.arange(N) * STEP
RATE = 3.0 * np.sin(TIME / 0.02) + np.sin(TIME / 0.0051)
V0, S = 0.1, 0.5
PLAIN = SensorRecord(RATE, V0 + S * RATE, STEP, 20.0 + 10.0 * TIME)
ALL = np.ones(N, dtype=bool)


def acted(name: str, *coefficients: float, rate: Array = RATE) -> Array:
    """Volts with the effect, less the line."""
    record = SensorRecord(rate, V0 + S * rate, STEP, PLAIN.temperature)
    return Chain((effect_for(name),), record, DECLARED).volts(np.array([V0, S, *coefficients]))


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
    chain = Chain((effect_for("hysteresis"),), record, DECLARED)
    np.testing.assert_allclose(chain.volts(np.array([0.0, 1.0, 0.75])), expected)


def test_a_knee_is_a_softened_limit() -> None:
    volts = V0 + S * RATE
    low, high, soft, hard = -0.8, 1.2, 0.1, 0.02
    expected = [
        v - hard * math.log1p(math.exp((v - high) / hard)) + soft * math.log1p(math.exp((low - v) / soft))
        for v in volts
    ]
    np.testing.assert_allclose(acted("soft_saturation", low, high, soft, hard), expected, rtol=1e-9)
    np.testing.assert_allclose(acted("soft_saturation", low, high, 1e-4, 1e-4), np.clip(volts, low, high), atol=1e-4)


def test_what_is_late_is_the_rate_of_before_and_a_reference_that_lags_is_led() -> None:
    ramp = 2.0 * TIME / STEP / N
    np.testing.assert_allclose((acted("delay", 2.5 * STEP, rate=ramp) - V0)[5:], S * (ramp - 5.0 / N)[5:])
    np.testing.assert_allclose(acted("reference_lag", 0.01, rate=ramp), V0 + S * (ramp + 0.01 * 2.0 / STEP / N))
    np.testing.assert_allclose(acted("lag", 0.004), V0 + S * first_order(RATE, 0.004, STEP))
    np.testing.assert_array_equal(first_order(RATE, 0.9e-6, STEP), RATE)
    assert np.max(np.abs(first_order(RATE, 1e-5, STEP) - RATE)) > 1e-4


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


def test_stages_follow_one_another_whatever_the_order_in_which_effects_were_taken() -> None:
    """Reference, rate, curve, surroundings, limit."""
    taken = tuple(effect_for(name) for name in ("saturation", "drift", "quadratic", "lag", "reference_lag"))
    chain = Chain(taken, PLAIN, DECLARED)
    values = np.array([V0, S, -0.9, 1.4, 3.0, 0.05, 0.004, 0.002])
    rate = RATE + 0.002 * np.gradient(RATE, STEP)
    rate = first_order(rate, 0.004, STEP)
    volts = V0 + S * (rate + 0.05 * rate**2 / 4.0) + 3.0 * (TIME - TIME.mean())
    np.testing.assert_allclose(chain.volts(values), np.clip(volts, -0.9, 1.4))
    assert chain.names == ("V0", "S", "lo", "hi", "r", "q", "tau", "tau_r")
    assert chain.units == ("V", "V·s/rad", "V", "V", "V/s", "1", "s", "s")


# -- where they are searched ------------------------------------------------------------------------------------------


def test_searches_begin_within_bounds_that_are_those_of_a_sensor() -> None:
    """Half of the range for a curve or a band, a tenth of the record for a response, the voltages seen for a limit."""
    low, high = float(np.min(PLAIN.voltage)), float(np.max(PLAIN.voltage))
    span, middle = high - low, 0.5 * (low + high)
    limits = ((low - 0.02 * span, middle), (middle, high + 0.02 * span))
    fraction, volts = ((-0.5, 0.5),), ((-2.0, 2.0),)
    longest = 0.1 * float(TIME[-1])
    expected = {
        "quadratic": fraction, "cubic": fraction, "scale_asymmetry": fraction,
        "dead_band": ((0.0, 2.0),), "hysteresis": ((0.0, 2.0),), "saturation": limits,
        "soft_saturation": (*limits, (2e-3, 0.6), (2e-3, 0.6)),
        "fold_back": (*limits, (0.0, 3.0)), "moving_mean": ((0.0, longest),),
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


# -- the fit ----------------------------------------------------------------------------------------------------------


def test_sizes_are_those_of_the_starts_or_a_tenth_of_the_bounds() -> None:
    chain = Chain((effect_for("quadratic"), effect_for("second_order")), PLAIN, DECLARED)
    np.testing.assert_allclose(chain.scales, [2.0, 0.5, 0.1, 30.0, 0.7])
    low, high = chain.bounds()
    np.testing.assert_allclose(low, [-np.inf, -np.inf, -0.5, 1.0 / TIME[-1], 0.05])
    np.testing.assert_array_equal(high, [np.inf, np.inf, 0.5, 500.0, 5.0])


def test_derivatives_are_those_of_the_law() -> None:
    chain = Chain((effect_for("quadratic"),), PLAIN, DECLARED)
    values = np.array([V0, S, 0.03])
    expected = np.column_stack([np.ones(N), RATE + 0.03 * RATE**2 / 4.0, S * RATE**2 / 4.0])
    np.testing.assert_allclose(chain.jacobian(values), expected, atol=1e-8)


def test_a_line_is_of_the_rows_within_the_range() -> None:
    volts = np.where(np.abs(RATE) <= 2.0, V0 + S * RATE, 0.0)
    narrow = Range(2.0, 1.0)
    rows = np.arange(N) % 3 > 0
    record = replace(PLAIN, voltage=volts)
    found = straight_line(record, narrow, rows)
    np.testing.assert_allclose(found.parameters, [V0, S])
    np.testing.assert_allclose(found.residual, volts - V0 - S * RATE, atol=1e-12)
    assert found.cost == pytest.approx(np.sum(found.residual[rows] ** 2))
    assert found.rms(~rows) == pytest.approx(np.sqrt(np.mean(found.residual[~rows] ** 2)))
    steps = np.tile([1.0, 3.0, 5.0], 4)
    edge = SensorRecord(steps, 7.0 * steps)
    assert straight_line(edge, Range(3.0, 1.0), np.ones(12, bool)).parameters == pytest.approx([0.0, 7.0])
    beyond = SensorRecord(steps, np.where(steps == 1.0, 0.0, steps))  # one rate within: all rows tell the line
    expected = np.polyfit(beyond.rate, beyond.voltage, 1)[::-1]
    np.testing.assert_allclose(straight_line(beyond, Range(2.0, 1.0), np.ones(12, bool)).parameters, expected)


def test_intervals_are_those_of_linear_regression_of_so_many_independent_samples() -> None:
    noisy = replace(PLAIN, voltage=PLAIN.voltage + 1e-2 * np.random.default_rng(1).standard_normal(N))
    rows = np.arange(N) < 200
    line = straight_line(noisy, Range(9.0, 2.0), rows)
    design = np.column_stack([np.ones(N), RATE])[rows]
    for effective in (200.0, 50.0):
        # Ordinary regression where all are independent; else as if only so many of the rows were there.
        variance = line.cost / 200.0 * effective / (effective - 2.0) * 200.0 / effective
        expected = 1.96 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * variance)
        np.testing.assert_allclose(line.half_widths(rows, effective), expected, rtol=1e-5)


def test_a_fit_is_the_best_of_its_starts_and_stays_within_bounds() -> None:
    record = replace(PLAIN, voltage=V0 + S * (RATE + 0.03 * RATE**2 / 4.0))
    chain = Chain((effect_for("quadratic"),), record, DECLARED)
    found = fit(chain, ALL, [np.array([0.0, 0.1, 9.0]), np.array([0.0, 0.4, 0.0])])  # the first lies outside
    np.testing.assert_allclose(found.parameters, [V0, S, 0.03], atol=1e-6)
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-7)
    assert found.cost == pytest.approx(np.sum(found.residual**2), abs=1e-12)
    much = replace(PLAIN, voltage=V0 + S * (RATE + 0.9 * RATE**2 / 4.0))
    assert fit(Chain((effect_for("quadratic"),), much, DECLARED), ALL, [np.zeros(3)]).parameters[2] <= 0.5


# -- the choice -------------------------------------------------------------------------------------------------------


def made(cost: float, count: int, residual: Array | None = None, *effects: str) -> Any:
    chain = Chain(tuple(effect_for(name) for name in effects), PLAIN, DECLARED)
    series = np.random.default_rng(2).standard_normal(N) if residual is None else residual
    return SensorFit(chain, np.zeros(count), series, cost)


def model(floor: float = 0.5) -> ChainModel:
    candidates = tuple(effect_for(name) for name in ("saturation", "soft_saturation", "lag", "second_order", "cubic"))
    return ChainModel(candidates, np.arange(N) < 200, floor, made(1.0, 2, 3.0 * np.ones(N)))


def test_there_is_one_limit_and_one_low_pass_of_whichever_kind() -> None:
    assert model().promise(made(1.0, 2), ()) == ("saturation", "soft_saturation", "lag", "second_order", "cubic")
    assert model().promise(made(1.0, 4, None, "soft_saturation"), ("lag",)) == ("second_order", "cubic")
    assert model().promise(made(1.0, 3, None, "lag"), ()) == ("saturation", "soft_saturation", "cubic")
    assert model().promise(made(1.0, 3, None, "cubic"), ()) == ("saturation", "soft_saturation", "lag", "second_order")
    assert model().hopeful(("a", "b"), {}, (), 0) == ("a", "b")


def test_gains_are_of_the_independent_samples_that_the_closest_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Array] = []
    monkeypatch.setattr(chain_model, "effective_samples", lambda residual: asked.append(residual) or 60.0)
    near = made(2.0, 3, np.arange(float(N)))
    fits = {"cubic": made(4.0, 3), "lag": near, "saturation": made(3.0, 4)}
    scores = model().score(made(8.0, 2), (), fits)
    np.testing.assert_array_equal(asked[0], np.arange(200.0))
    for name, (cost, added) in {"cubic": (4.0, 1), "lag": (2.0, 1), "saturation": (3.0, 2)}.items():
        gain = (60.0 - 2 - added) * math.log(8.0 / cost)
        price = added * math.log(60.0)
        one = scores[name]
        assert (one.likelihood, one.gain) == (pytest.approx(gain), pytest.approx(gain))
        assert (one.price, one.bar) == (pytest.approx(price), pytest.approx(price + 2.0 * math.log(5.0)))


@pytest.mark.parametrize(("later", "objects"), [(3.0, False), (3.04, False), (3.05, True)])
def test_held_out_it_may_be_worse_by_the_floor(later: float, *, objects: bool) -> None:
    """√(3² + 0.5²) is 3.041; the first is compared with the line of the data sheet, others with the model before."""
    residual = np.where(np.arange(N) < 200, 0.0, later)
    trial: Any = SimpleNamespace(fit=made(1.0, 3, residual, "cubic"))
    bare, carrying = made(1.0, 2, 9.0 * np.ones(N)), made(1.0, 3, 3.0 * np.ones(N), "lag")
    for current in (bare, carrying):
        said = model().objection(current, "cubic", trial)
        assert (said is not None) is objects
    worse = made(1.0, 3, 0.1 * np.ones(N), "lag")
    assert model().objection(worse, "cubic", trial) is not None


# -- what a record shows ----------------------------------------------------------------------------------------------


def test_repeated_rates_tell_the_noise() -> None:
    rates = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0, 4.0, 1.0 + 1e-12])
    volts = np.array([1.0, 2.0, 3.0, 7.0, 9.0, 5.0, 90.0, -90.0, 2.0])
    rows = np.arange(9) != 6
    record = SensorRecord(rates, volts)
    floor, freedom = trace.noise_floor(record, rows, 0.25)
    assert floor == pytest.approx(math.sqrt((2.0 + 2.0) / 4.0))  # of 1 and 2 rad/s: Σ(V − V̄)² is 2 each
    assert freedom == 4.0
    assert trace.noise_floor(replace(record, step=0.1), rows, 0.25) == (0.25, math.inf)
    assert trace.noise_floor(SensorRecord(np.arange(9.0), volts), rows, 0.25) == (0.25, math.inf)
    same = SensorRecord(np.repeat([1.0, 2.0, 3.0], 3), np.repeat([1.0, 2.0, 3.0], 3))
    assert trace.noise_floor(same, np.ones(9, bool), 0.25) == (0.25, math.inf)


def test_a_rate_is_rested_at_for_a_hundredth_of_the_samples() -> None:
    """Within a fiftieth of the range: classes of 0.08 rad/s."""
    rate = np.concatenate([np.zeros(500), np.full(480, 1.0), np.full(10, 2.0), np.full(9, 3.0), [3.5]])
    record = SensorRecord(rate, rate)
    assert trace.steady_rates(record, DECLARED, np.ones(1000, bool)) == 3
    near = SensorRecord(np.concatenate([np.full(500, 0.03), np.full(500, -0.03)]), np.zeros(1000))
    assert trace.steady_rates(near, DECLARED, np.ones(1000, bool)) == 1
    assert trace.steady_rates(record, DECLARED, np.arange(1000) < 500) == 1


@pytest.mark.parametrize(("levels", "shown"), [(4, True), (3, False)])
def test_a_curve_is_shown_by_more_than_three_steady_rates(levels: int, *, shown: bool) -> None:
    rate = np.tile(np.linspace(-3.0, 3.0, levels), 40)
    record = SensorRecord(rate, V0 + S * rate, STEP)
    line = straight_line(record, DECLARED, np.ones(len(rate), bool))
    for name in ("cubic", "quadratic", "hysteresis", "dead_band"):
        assert trace.excited(line, effect_for(name), np.ones(len(rate), bool)) is shown, name


def test_what_is_a_shift_and_a_stretch_of_what_is_there_is_not_shown() -> None:
    """An offset that follows a temperature that follows the rate."""
    follows = replace(PLAIN, temperature=20.0 + RATE)
    for record, shown in ((follows, False), (replace(follows, temperature=20.0 + RATE + 0.2 * TIME / STEP % 7), True)):
        line = straight_line(record, Range(9.0, 2.0), ALL)
        assert trace.excited(line, effect_for("temperature_offset"), ALL) is shown


def test_blocks_alternate_and_the_first_is_fitted() -> None:
    assert trace.alternate_blocks(7, 2).tolist() == [True, True, False, False, True, True, False]


def test_less_some_the_rest_begins_where_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(trace, "fit", lambda chain, rows, starts: asked.append((chain, rows, starts)) or "fitted")
    chain = Chain(tuple(effect_for(name) for name in ("saturation", "cubic", "second_order")), PLAIN, DECLARED)
    current = SensorFit(chain, np.arange(7.0), np.zeros(N), 0.0)
    before: Any = "before"
    assert trace._less(current, before, ("cubic",), ALL) == "fitted"
    ((kept, rows, (start,)),) = asked
    assert [effect.name for effect in kept.effects] == ["saturation", "second_order"]
    assert start.tolist() == [0.0, 1.0, 2.0, 3.0, 5.0, 6.0]
    assert rows is ALL
    assert trace._less(current, before, ("saturation", "cubic", "second_order"), ALL) == "before"


def test_alike_are_signatures_beside_all_that_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each named one is taken out with its own coefficients only; the cosine of two signatures, above 0.98."""
    asked: list[list[float]] = []

    def refit(chain: Chain, rows: Array, starts: Any) -> Any:
        asked.append(starts[0].tolist())
        return SensorFit(chain, starts[0], np.zeros(N), 0.0)

    axes = np.eye(N)
    signatures = {
        "saturation": axes[0], "cubic": axes[3], "lag": 0.99 * axes[0] + math.sqrt(1 - 0.99**2) * axes[1],
        "delay": -0.97 * axes[0] + math.sqrt(1 - 0.97**2) * axes[2], "drift": 0.0 * axes[0],
        "quadratic": -5.0 * axes[3],
    }  # fmt: skip
    monkeypatch.setattr(trace, "fit", refit)
    monkeypatch.setattr(trace, "_signature", lambda without, effect, rows: signatures[effect.name])
    chain = Chain((effect_for("saturation"), effect_for("cubic")), PLAIN, DECLARED)
    after = SensorFit(chain, np.arange(5.0), np.zeros(N), 0.0)
    candidates = tuple(effect_for(name) for name in ("saturation", "cubic", "lag", "delay", "drift", "quadratic"))
    found = trace._separations(after, candidates, ALL, {})
    assert [(one.effect, one.other, one.correlation) for one in found] == [
        ("saturation", "lag", pytest.approx(0.99)), ("cubic", "quadratic", pytest.approx(1.0)),
    ]  # fmt: skip
    assert asked == [[0.0, 1.0, 4.0], [0.0, 1.0, 2.0, 3.0]]
    assert found[0].separate_by is None
    near = trace._separations(after, candidates, ALL, {"cubic": {"drift"}})  # by its likelihood, whatever its signature
    assert [(one.effect, one.other, one.correlation) for one in near if one not in found] == [("cubic", "drift", 0.0)]
    signatures["saturation"] = axes[3]
    alone = replace(after, chain=replace(chain, effects=(effect_for("cubic"),)), parameters=np.zeros(3))
    (told,) = trace._separations(alone, (effect_for("saturation"),), ALL, {})
    assert told.separate_by == effect_for("cubic").look_alikes["saturation"]


def test_a_signature_is_what_a_fit_changes_beside_the_line() -> None:
    record = replace(PLAIN, voltage=V0 + S * (RATE + 0.03 * RATE**3 / 16.0))
    wide = Range(4.0, 2.0)
    line = fit(Chain((), record, wide), ALL, [np.array([V0, S])])
    found = trace._signature(line, effect_for("cubic"), ALL)
    cube = RATE**3
    design = np.column_stack([np.ones(N), RATE])
    expected = cube - design @ np.linalg.lstsq(design, cube, rcond=None)[0]
    cosine = found @ expected / np.linalg.norm(found) / np.linalg.norm(expected)
    assert cosine == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(design.T @ found, 0.0, atol=1e-6)
