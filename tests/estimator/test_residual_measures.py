"""The measures behind a residual's findings, each beside the same written out with loops or by SciPy."""

import math

import mpmath
import numpy as np
import pytest
from scipy import signal, stats

from estimator.residual import spectrum, whiteness
from estimator.residual.floor import noise_floor, quiet_bins
from estimator.residual.significance import deviations, of_many
from estimator.residual.spectrum import Periodogram, bands, density, folded, periodogram

RATE, HZ = 4000.0, 200.0


# -- chances ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("log_p", "tries"), [(-0.01, 3), (-2.0, 10), (-20.0, 1000), (-31.0, 1000), (-29.0, 7), (-700.0, 5)]
)
def test_the_best_of_many_is_sidak_s(log_p: float, tries: int) -> None:
    mpmath.mp.dps = 400
    exact = mpmath.log(1 - (1 - mpmath.exp(mpmath.mpf(log_p))) ** tries)
    assert of_many(log_p, tries) == pytest.approx(float(exact), rel=1e-6)


def test_a_certainty_is_one_however_often_it_is_tried_and_no_deviation() -> None:
    assert of_many(0.0, 5) == 0.0
    assert of_many(-31.0, 10**20) == 0.0
    assert of_many(0.1, 5) == 0.0  # rounding
    assert deviations(0.0) == 0.0
    assert deviations(math.log(0.9)) == 0.0
    assert deviations(math.log(0.5)) == pytest.approx(0.0, abs=1e-9)


# -- spectrum ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "lost"), [(4000, 0), (4001, 0), (4000, 400)])
def test_a_periodogram_is_scipy_s_with_lost_samples_made_up_for(n: int, lost: int) -> None:
    """The window's middle is that of the record, its ends are half a sample outside."""
    series = 3.0 + 2.0 * np.random.default_rng(2).standard_normal((n, 2))
    series[700 : 700 + lost, 0] = np.nan
    made = periodogram(series, RATE, HZ)
    window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
    for axis in range(2):
        known = np.isfinite(series[:, axis])
        filled = np.where(known, series[:, axis] - np.mean(series[known, axis]), 0.0)
        frequency, power = signal.periodogram(filled, RATE, window=window, detrend=False)
        share = np.sum(window**2) / np.sum(window[known] ** 2)
        inner = slice(1, (n + 1) // 2)  # neither the mean nor half the rate
        np.testing.assert_allclose(made.frequency, frequency[inner])
        np.testing.assert_allclose(made.density[:, axis], power[inner] * share, rtol=1e-9)
        assert np.sum(made.density[:, axis]) * made.spacing == pytest.approx(4.0, rel=0.15)
    np.testing.assert_allclose(made.ordinates, (made.density / made.floor).sum(axis=1))
    assert made.spacing == pytest.approx(RATE / n)
    np.testing.assert_allclose(np.abs(made.transform[:, 1]) ** 2 / made.density[:, 1],
                               np.abs(made.transform[0, 1]) ** 2 / made.density[0, 1])  # fmt: skip


@pytest.mark.moderate
def test_a_density_for_figures_is_welch_s() -> None:
    series = np.random.default_rng(5).standard_normal((5000, 2))
    series[7] = np.nan
    frequency, power = density(series, RATE)
    expected = signal.welch(np.nan_to_num(series), RATE, nperseg=512, axis=0)
    np.testing.assert_allclose(frequency, expected[0][1:])
    np.testing.assert_allclose(power, expected[1][1:])
    assert len(density(series[:300], RATE)[0]) == 32  # 64 samples at least
    assert len(density(series[:40], RATE)[0]) == 20  # of a record that has so many
    assert len(density(np.tile(series, (30, 1)), RATE)[0]) == 4096


@pytest.mark.parametrize(
    ("frequency", "shows"), [(300.0, 300.0), (2000.0, 2000.0), (2300.0, 1700.0), (4100.0, 100.0), (7900.0, 100.0)]
)
def test_a_frequency_shows_where_sampling_folds_it(frequency: float, shows: float) -> None:
    assert folded(frequency, RATE) == pytest.approx(shows)


def flat(n: int, axes: int = 2) -> Periodogram:
    """A spectrum that is its own floor."""
    frequency = np.arange(1, n + 1) * 0.5
    one = np.full((n, axes), 3.0)
    return Periodogram(frequency, one.copy(), one.copy(), 200.0, np.ones((n, axes), dtype=complex))


def test_bands_hold_what_is_above_the_floor_near_the_resonance() -> None:
    seen = flat(3999)
    inside = np.abs(seen.frequency - 400.0) <= 12.5
    seen.density[inside] += np.array([2.0, 1.0])
    found = {one.order: one for one in bands(seen, RATE, HZ)}
    assert set(found) == {0, 1, 2, 3, 4, 5}
    assert [one.frequency for one in found.values()] == [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0]
    assert found[2].rms == pytest.approx(math.sqrt(51 * 3.0 * 0.5))
    effective = 2.0 * 2 * 51 / 1.94
    assert found[2].log_p == pytest.approx(stats.f.logsf(1.5, effective, 200.0), rel=1e-6)
    assert found[3].rms == 0.0
    assert found[3].log_p == pytest.approx(stats.f.logsf(1.0, effective, 200.0), rel=1e-6)
    assert found[0].log_p == pytest.approx(stats.f.logsf(1.0, 2.0 * 2 * 25 / 1.94, 200.0), rel=1e-6)
    seen.density[:] = 1.0  # below the floor is nothing
    assert all(one.rms == 0.0 for one in bands(seen, RATE, HZ))
    one_bin = {one.order: one for one in bands(flat(20, 1), RATE, 6.0)}
    assert one_bin[1].log_p == pytest.approx(stats.f.logsf(1.0, 2.0, 200.0), rel=1e-6)  # one ordinate at least
    assert {one.order for one in bands(flat(20, 1), RATE, HZ)} == {0}  # the others are not in so short a spectrum


def test_a_tail_of_f_that_underflows_has_its_leading_term() -> None:
    """I_x(a, b) = xᵃ (1 − x)ᵇ / (a B(a, b)) · (1 + …), whose rest is less than e here."""
    mpmath.mp.dps = 60
    above, below, ratio = 300.0, 4000.0, 30.0
    x = mpmath.mpf(below) / (below + above * ratio)
    exact = mpmath.log(mpmath.betainc(below / 2, above / 2, 0, x, regularized=True))
    assert spectrum._log_f(ratio, above, below) == pytest.approx(float(exact), abs=1.0)


# -- the floor --------------------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_the_floor_is_the_level_of_quiet_bins_and_as_sure_as_their_median() -> None:
    random = np.random.default_rng(9)
    levels, said = [], 0.0
    for _ in range(300):
        series = 2.0 * random.standard_normal((1000, 1))
        found = noise_floor(periodogram(series, RATE, HZ), np.ones((1000, 1)), RATE, HZ)
        assert found.source == "the spectrum away from the resonance"
        levels.append(found.rms[0])
        said = found.uncertainty
    assert np.mean(levels) == pytest.approx(2.0, rel=0.01)
    assert np.std(levels) / 2.0 == pytest.approx(said, rel=0.2)
    count = int(np.sum(quiet_bins(periodogram(np.zeros((1000, 1)), RATE, HZ).frequency, RATE, HZ)))
    assert said == pytest.approx(math.sqrt(1.94 / count) / math.log(2.0) / 2.0)


# -- whiteness --------------------------------------------------------------------------------------------------------


def test_a_portmanteau_of_two_channels_is_hosking_s() -> None:
    """n² Σ tr(C_k' C₀⁻¹ C_k C₀⁻¹)/(n − k), and (n + 2)/n of it; over the pairs that are there."""
    n, lags = 300, 6
    series = np.random.default_rng(2).standard_normal((n, 2)) @ np.array([[1.0, 0.8], [0.0, 0.6]]) + 5.0
    for lost in (0, 25):
        series[50 : 50 + lost, 0] = np.nan
        known = np.all(np.isfinite(series), axis=1)
        total = int(known.sum())
        centred = np.where(known[:, None], series - series[known].mean(axis=0), 0.0)
        inverse = np.linalg.inv(centred.T @ centred / total)
        q = 0.0
        for lag in range(1, lags + 1):
            cross = centred[lag:].T @ centred[:-lag]
            pairs = sum(bool(known[k] and known[k - lag]) for k in range(lag, n))
            q += np.trace(cross.T @ inverse @ cross @ inverse) / pairs
        q *= (total + 2.0) / total
        found = whiteness.portmanteau(series, lags)
        assert found.statistic == pytest.approx(q)
        assert found.p == pytest.approx(stats.chi2.sf(q, 4 * lags))
        assert found.log_p == pytest.approx(stats.chi2.logsf(q, 4 * lags))


def test_lags_at_which_no_pair_is_left_count_for_nothing() -> None:
    series = np.random.default_rng(2).standard_normal(60)
    series[1::2] = np.nan
    found = whiteness.portmanteau(series, 3)
    known = series[::2] - np.nanmean(series)
    r = known[1:] @ known[:-1] / (known @ known)
    assert found.statistic == pytest.approx(30 * 32.0 * r**2 / 29)


def test_a_channel_without_a_single_sample_leaves_the_other_as_it_is() -> None:
    """An observer that diverges at its first sample predicts nothing; nobody is warned by NumPy of that."""
    series = np.random.default_rng(3).standard_normal((4096, 2))
    series[100:140, 0] = np.nan
    alone = periodogram(series[:, :1], 4000.0, 200.0)
    series[:, 1] = np.nan
    with np.errstate(all="ignore"):
        beside = periodogram(series, 4000.0, 200.0)
    np.testing.assert_allclose(beside.density[:, 0], alone.density[:, 0], rtol=1e-6)
