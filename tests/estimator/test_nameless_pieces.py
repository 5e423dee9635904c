"""The nameless rival's pieces: regressors, their least squares, its orders, roots and where it looks for them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from estimator.thresholds import THRESHOLDS
from estimator.trace import nameless as module
from estimator.trace.criterion import TIE
from estimator.trace.nameless import Contest, Innovations, Nameless, _Equations, contest, nameless, regressors

RNG = np.random.default_rng(21)
N = 700
ROOTS = (complex(0.9, 0.0), complex(0.6, 0.5))


def remembered(series, root):
    """What a root remembers of a series: Σ √(1 − |r|²) rᵏ⁻¹ z₋ₖ, sample by sample."""
    found = np.zeros(series.shape, complex)
    for n in range(1, len(series)):
        found[n] = root * found[n - 1] + math.sqrt(1.0 - abs(root) ** 2) * series[n - 1]
    return found


def written_out(series, order, roots):
    """All regressors, by loops: samples before, then of each root the real part, and the imaginary one if any."""
    columns = []
    for lag in range(1, order + 1):
        columns += [[0.0] * lag + column[:-lag].tolist() for column in series.T]
    for root in roots:
        memory = remembered(series, root)
        columns += [column.tolist() for column in memory.real.T]
        if root.imag:
            columns += [column.tolist() for column in memory.imag.T]
    return np.array(columns).T.reshape(len(series), -1)


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize(("order", "roots"), [(0, ()), (3, ()), (0, ROOTS), (2, ROOTS)])
def test_the_past_is_the_last_samples_and_what_each_root_remembers(axes, order, roots) -> None:
    series = RNG.standard_normal((60, axes))
    np.testing.assert_allclose(regressors(series, order, roots), written_out(series, order, roots), atol=1e-12)


def fitted(series, order, roots):
    made = _Equations.of(series)
    if order:
        made = made.with_order(order)
    for root in roots:
        made = made.with_root(root)
    return made


@pytest.mark.parametrize("lost", [0, 40])
@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize(("order", "roots"), [(0, ()), (3, ()), (0, ROOTS), (2, ROOTS)])
def test_a_predictor_is_least_squares_of_the_rows_that_are_there(axes, order, roots, lost) -> None:
    series = np.random.default_rng(5).standard_normal((N, axes))
    series[1:] += 0.5 * series[:-1, ::-1]
    series[100 : 100 + lost, 0] = np.nan
    there = np.all(np.isfinite(series), axis=1)
    past, now = written_out(np.nan_to_num(series), order, roots)[there], series[there]
    weights = np.linalg.lstsq(past, now, rcond=None)[0] if past.size else np.zeros((0, axes))
    left = now - past @ weights
    made = fitted(series, order, roots)
    np.testing.assert_allclose(made.weights, weights, atol=1e-6)
    np.testing.assert_allclose(made.covariance, left.T @ left / len(now), atol=1e-6)
    imaginary = len([root for root in roots if root.imag])
    numbers = past.shape[1] * axes + len(roots) + imaginary + (1 if axes == 1 else 3)
    assert made.numbers == numbers
    likelihood = 2.0 * np.sum(stats.multivariate_normal.logpdf(left, cov=left.T @ left / len(now)))
    constant = -len(now) * axes * (1.0 + math.log(2.0 * math.pi))
    assert made.standing == pytest.approx(likelihood - constant - numbers * math.log(len(now)), rel=1e-6)
    found = made.solved()
    assert (found.order, found.roots, found.numbers) == (order, roots, numbers)
    unpredicted = found.unpredicted(series)
    np.testing.assert_array_equal(np.isnan(unpredicted), np.isnan(series))
    np.testing.assert_allclose(unpredicted[there], left, atol=1e-5)


def test_a_shorter_order_is_the_same_fitted_by_itself() -> None:
    series = RNG.standard_normal((N, 2))
    long = _Equations.of(series).with_order(8)
    for order in (1, 3, 8):
        short, alone = long.up_to(order), _Equations.of(series).with_order(order)
        assert (short.order, short.numbers) == (order, alone.numbers)
        np.testing.assert_allclose(short.weights, alone.weights, atol=1e-12)
        assert short.standing == pytest.approx(alone.standing)
        np.testing.assert_allclose(short.with_root(ROOTS[1]).weights, alone.with_root(ROOTS[1]).weights, atol=1e-9)


def test_two_roots_on_one_another_do_no_harm() -> None:
    series = RNG.standard_normal((N, 1))
    one, two = fitted(series, 0, ROOTS[:1]), fitted(series, 0, ROOTS[:1] * 2)
    np.testing.assert_allclose(two.solved().unpredicted(series), one.solved().unpredicted(series), atol=1e-6)
    assert two.standing < one.standing  # and are paid for


def test_of_nothing_there_is_a_predictor_all_the_same() -> None:
    empty = _Equations.of(np.full((5, 2), np.nan))
    assert np.isfinite(empty.standing)
    assert np.all(np.isfinite(empty.covariance))


def test_the_likelihood_of_a_row_is_that_of_the_normal_distribution() -> None:
    covariance = np.array([[2.0, 0.7], [0.7, 1.0]])
    model = Nameless(0, (), np.zeros((0, 2)), covariance, 3)
    rows = RNG.standard_normal((9, 2))
    expected = 2.0 * stats.multivariate_normal.logpdf(rows, cov=covariance) + 2.0 * math.log(2.0 * math.pi)
    np.testing.assert_allclose(model.terms(rows), expected)


@pytest.mark.parametrize(
    ("most", "orders"), [(0.9, []), (1.0, [1]), (7.9, [1, 2, 4]), (8.0, [1, 2, 4, 8]), (1e9, None)]
)
def test_orders_are_powers_of_two_up_to_what_the_record_can_show(most, orders) -> None:
    longest = THRESHOLDS.nameless.order
    assert module._orders(most) == (orders or ([] if orders == [] else [2**k for k in range(20) if 2**k <= longest]))


@pytest.mark.parametrize(
    ("frequency", "samples", "roots"),
    [
        (0.5, 63, [(8.0, 0.0)]),  # one root at least
        (0.5, 64, [(8.0, 0.5)]),  # eight memories
        (0.01, 1024, [(8.0, 0.0), (16.0, 0.0), (32.0, 0.0), (64.0, 0.0), (128.0, 0.01)]),  # slow: on the real axis
        (0.125, 128, [(8.0, 0.125), (16.0, 0.125)]),
        (0.12, 128, [(8.0, 0.0), (16.0, 0.12)]),
    ],
)
def test_roots_are_there_with_every_memory_that_the_record_can_show(frequency, samples, roots) -> None:
    found = module._roots_at(frequency, samples)
    expected = [np.exp(-1.0 / memory) * np.exp(1j * angle) for memory, angle in roots]
    np.testing.assert_allclose(found, expected)
    assert [root.imag == 0.0 for root in found] == [angle == 0.0 for _, angle in roots]


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize(("frequency", "width"), [(0.7, 0.0), (0.7, 0.05), (1.5, 0.3), (3.0, 0.0)])
def test_it_looks_where_the_spectrum_departs_most_from_white(axes, frequency, width) -> None:
    """A line, or a band: its middle."""
    n = 4096
    white = np.random.default_rng(3).standard_normal((n, axes))
    t = np.arange(n)
    if width:
        spectrum = np.fft.rfft(np.random.default_rng(4).standard_normal(n))
        at = np.linspace(0.0, np.pi, len(spectrum))
        spectrum[np.abs(at - frequency) > width / 2.0] = 0.0
        white[:, 0] += 2.0 * np.fft.irfft(spectrum, n)
    else:
        white[:, 0] += 0.6 * np.sin(frequency * t)
    white[5] = np.nan
    assert module._loudest(white) == pytest.approx(frequency, abs=max(0.25 * width, 4.0 * np.pi / n))


def test_a_hole_in_the_spectrum_departs_from_white_as_a_peak_does() -> None:
    n = 4096
    spectrum = np.fft.rfft(np.random.default_rng(6).standard_normal(n))
    spectrum[600:700] *= 0.05
    found = module._loudest(np.fft.irfft(spectrum, n)[:, None])
    assert found == pytest.approx(np.pi * 650.0 / 2048.0, abs=0.06)


def test_a_mean_is_at_frequency_zero() -> None:
    series = np.random.default_rng(7).standard_normal((4096, 1)) + 0.4
    assert module._loudest(series) == pytest.approx(0.0, abs=1e-3)
    assert module._loudest(np.zeros((64, 1))) >= 0.0
    assert module._loudest(np.ones((1, 1))) == 0.0
    assert module._loudest(np.array([[1.0], [-1.0], [1.0]])) == 0.0  # of so few nothing is told


@pytest.mark.parametrize(("share", "at"), [(1.2, 0.0), (0.8, 0.7)])
def test_a_mean_counts_twice_since_it_has_one_side_only(share: float, at: float) -> None:
    """Of a mean m and a sine a in n samples squares are n² m² and, on either side, n² a²/4: 2000 of noise."""
    n = 4096
    turn = 2.0 * np.pi * round(0.7 * n / (2.0 * np.pi)) / n  # in one bin
    series = math.sqrt(share * 1000.0 / n) + math.sqrt(8000.0 / n) * np.sin(turn * np.arange(n))
    white = np.random.default_rng(5).standard_normal(n)
    assert module._loudest((series + white)[:, None]) == pytest.approx(at, abs=2e-3)


def test_a_band_of_up_to_a_quarter_of_the_spectrum_is_seen_as_one() -> None:
    """All of it as loud, however wide: its middle, though each bin of it departs as much."""
    n = 2 * 4096 - 2
    for bins in (1024, 512, 256, 32, 2):
        spectrum = np.full(n // 2 + 1, math.sqrt(0.5), complex)
        spectrum[1000 : 1000 + bins] = 1.0
        series = np.fft.irfft(spectrum * np.exp(2j * np.pi * np.random.default_rng(6).random(n // 2 + 1)), n)
        assert module._loudest(series[:, None]) == pytest.approx(np.pi * (1000 + (bins - 1) / 2.0) / 4095.0)


@pytest.mark.parametrize(("start", "stop", "first"), [(0, 100, 40), (50, 100, 50), (10, 90, 30), (0, 30, 0)])
def test_of_what_is_fitted_the_last_rows_are_used(monkeypatch, start, stop, first) -> None:
    monkeypatch.setattr(module, "_SET", replace(THRESHOLDS.nameless, samples=60))
    series = np.arange(200.0)[:, None]
    np.testing.assert_array_equal(module._last(series, slice(start, stop))[:, 0], np.arange(first, stop))


def test_no_more_roots_are_taken_than_may_be_and_none_that_is_not_worth_its_price(monkeypatch) -> None:
    n = 6000
    t = np.arange(n)
    lines = sum(0.8 * np.sin((0.4 + 0.5 * k) * t + k) for k in range(5))
    series = np.random.default_rng(8).standard_normal((n, 1)) + lines[:, None]
    monkeypatch.setattr(module, "_SET", replace(THRESHOLDS.nameless, roots=2, order=1))
    found = nameless(series, slice(0, n))
    assert len(found.roots) == 2
    monkeypatch.setattr(module, "_SET", replace(THRESHOLDS.nameless, roots=2, order=0))
    assert nameless(series[:, :1] - lines[:, None], slice(0, n)).roots == ()


def test_no_longer_order_is_tried_than_an_eighth_of_the_samples_allows(monkeypatch) -> None:
    asked = []
    inner = module._orders
    monkeypatch.setattr(module, "_orders", lambda most: asked.append(most) or inner(most))
    nameless(RNG.standard_normal((160, 2)), slice(0, 160))
    assert asked == [160 / (8.0 * 2)]


def test_a_contest_is_over_the_rows_that_the_model_as_it_was_has_and_as_wide_as_predicted_there() -> None:
    """Gains of twice the log-likelihood of rows that are wide for one model and not for the other."""
    random = np.random.default_rng(9)
    n, split = 4000, 2000
    white = random.standard_normal((n, 2))
    wide = np.where(np.arange(n)[:, None] % 4 == 0, 3.0, 1.0) * np.ones((1, 2))
    lost = white.copy()
    lost[3000:3100, 1] = np.nan
    before = Innovations(2.0 * lost * wide, 2.0 * wide, slice(100, split))
    after = Innovations(lost * wide, wide, slice(100, split))
    found = contest(before, after, split)
    assert found.samples == 2 * (n - split - 100)
    assert found.named == pytest.approx(2.0 * found.samples * math.log(2.0), rel=1e-9)
    assert found.both == pytest.approx(found.named)
    assert found.nameless == 0.0
    assert (found.lead, found.left) == (pytest.approx(found.named), 0.0)
    assert found.dispersions == (1.0, 1.0)


def test_what_is_ahead_and_what_is_left_is_told_beside_the_effects() -> None:
    found = Contest(named=7.0, nameless=4.0, both=9.0, samples=9)
    assert (found.lead, found.left) == (5.0, 2.0)
    assert found.dispersions == (1.0, 1.0)  # as sure as white innovations, unless it is said otherwise


def test_a_lead_is_bound_by_odds_of_twenty_or_more_where_it_is_less_sure() -> None:
    assert Contest(0.0, 0.0, 0.0, 9, (0.2, 5.0)).bound == pytest.approx(TIE)
    assert Contest(0.0, 0.0, 0.0, 9, (3.0, 5.0)).bound == pytest.approx(3.0 * TIE)


def test_what_has_no_deviation_is_no_number() -> None:
    innovation = np.array([[1.0], [2.0], [np.nan], [4.0]])
    deviation = np.array([[2.0], [0.0], [1.0], [np.nan]])
    np.testing.assert_array_equal(Innovations(innovation, deviation, slice(0, 4)).series[:, 0], [0.5, *[np.nan] * 3])
