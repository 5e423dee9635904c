"""The measures behind a residual's findings, each beside the same written out with loops or by SciPy."""

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from scipy import signal, stats

from estimator.residual import floor, spectrum, whiteness
from estimator.residual.floor import noise_floor, quiet_bins, repeated_noise
from estimator.residual.significance import deviations, of_many
from estimator.residual.spectrum import Periodogram, bands, density, folded, lines, periodogram

RATE, HZ = 4000.0, 200.0
CYCLE = RATE / HZ
RNG = np.random.default_rng(11)


# -- seen from the vibration ------------------------------------------------------------------------------------------


# -- regression -------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(("bins", "blocks"), [(20_000, 10), (19_000, 9), (1500, 1), (100, 1)])
def test_a_local_floor_is_the_median_of_blocks_of_half_a_resonance(bins: int, blocks: int) -> None:
    """Or of 512 bins where these are more; joined by straight lines between the blocks' middles."""
    spacing = 0.05
    frequency = spacing * np.arange(1, bins + 1)
    power = np.random.default_rng(4).exponential(size=(bins, 2)) * (1.0 + frequency[:, None])
    found, degrees = spectrum._local_floor(power, frequency, HZ)
    edges = np.linspace(0, bins, blocks + 1).astype(int)
    middles = [np.mean(frequency[a:b]) for a, b in pairwise(edges)]
    for axis in range(2):
        medians = [np.median(power[a:b, axis]) / math.log(2.0) for a, b in pairwise(edges)]
        np.testing.assert_allclose(found[:, axis], np.interp(frequency, middles, medians))
    assert degrees == pytest.approx(2.0 * (bins / blocks) * math.log(2.0) ** 2 / 1.94)


@pytest.mark.moderate
def test_a_floor_has_the_degrees_of_freedom_of_medians_of_noise() -> None:
    """Twice the square of its mean over its variance."""
    random = np.random.default_rng(6)
    floors = []
    for _ in range(400):
        made = periodogram(random.standard_normal((1200, 1)), RATE, HZ)  # one block
        floors.append(made.floor[0, 0])
        degrees = made.degrees
    assert 2.0 * np.mean(floors) ** 2 / np.var(floors) == pytest.approx(degrees, rel=0.25)


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


def test_lines_are_the_largest_ordinates_each_with_its_lobe_and_its_skirts() -> None:
    seen = flat(3999)
    added: dict[int, float] = {700: 900.0, 799: 500.0, 1500: 60.0, 3000: 26.0}
    for peak, size in added.items():
        seen.density[peak, 0] += size
        seen.density[[peak - 1, peak + 1], 0] += size / 4.0
        seen.transform[peak, 0] = math.sqrt(size)
        seen.transform[[peak - 1, peak + 1], 0] = math.sqrt(size) / 2.0
    seen.density[704:708, 0] += 40.0  # skirts, beyond the lobe of three, above six times the floor of both channels
    seen.density[690:697, 1] += 29.0  # hardly so
    found = lines(seen, RATE, HZ, 1e-3)
    assert [one.frequency for one in found] == [350.5, 400.0, pytest.approx(750.5)]
    excess = [1.5 * 900.0 + 4 * 40.0, 1.5 * 500.0, 1.5 * 60.0]
    assert [one.order for one in found] == [None, 2, None]
    assert [one.offset for one in found] == [pytest.approx(-49.5), pytest.approx(0.0), pytest.approx(-49.5)]
    assert [one.rms for one in found] == pytest.approx([math.sqrt(one * 0.5) for one in excess])
    ordinate = 2.0 + 60.0 / 3.0
    x = 200.0 / (200.0 + 2.0 * ordinate)
    tail = x**100 * (1.0 + 100.0 * (1.0 - x))  # P of a sum of two exponentials over χ² of 200
    assert found[2].log_p == pytest.approx(math.log(1.0 - (1.0 - tail) ** 3999), rel=1e-6)
    assert lines(flat(3999), RATE, HZ, 1e-3) == ()


def test_of_a_comb_no_more_than_24_lines_are_told() -> None:
    seen = flat(9999)
    seen.density[100::300, :] += 1000.0
    assert len(lines(seen, RATE, HZ, 1e-3)) == 24


def test_a_line_within_the_lobe_of_another_is_the_same() -> None:
    seen = flat(3999)
    seen.density[1000, :] += 1000.0
    seen.density[1005, :] += 900.0  # five bins on: not its lobe, and nearer than twice that
    seen.density[1013, :] += 800.0
    found = [one.frequency for one in lines(seen, RATE, HZ, 1e-3)]
    assert found == [pytest.approx(500.5, abs=0.3), pytest.approx(507.0, abs=0.3)]


@pytest.mark.parametrize("off", [-0.4, -0.1, 0.0, 0.25, 0.5])
def test_a_frequency_between_bins_is_that_of_the_sine(off: float) -> None:
    n = 4000
    hertz = 333.0 + off
    wave = np.sin(2.0 * np.pi * hertz * np.arange(n) / RATE + 0.3)
    made = periodogram(np.stack([0.001 * RNG.standard_normal(n), wave], axis=1), RATE, HZ)
    peak = int(np.argmax(made.density[:, 1]))
    assert spectrum._between_bins(made, peak) == pytest.approx(hertz, abs=2e-3)
    assert spectrum._between_bins(made, 0) == made.frequency[0]
    assert spectrum._between_bins(made, len(made.frequency) - 1) == made.frequency[-1]


@pytest.mark.parametrize(("frequency", "order"), [(224.9, 1), (225.1, None), (10.0, 0), (1000.0, 5), (1200.0, None)])
def test_a_line_belongs_to_a_multiple_within_an_eighth_of_the_resonance(frequency: float, order: int | None) -> None:
    assert spectrum._order(frequency, RATE, HZ)[0] == order


@pytest.mark.parametrize(("ordinate", "axes"), [(5.0, 1), (12.0, 2), (40.0, 2)])
def test_the_tail_of_an_ordinate_is_that_of_fisher_s_f(ordinate: float, axes: int) -> None:
    """Sums of exponentials over a floor of so many degrees of freedom."""
    said = spectrum._log_tail(ordinate, axes, 80.0)
    assert said == pytest.approx(stats.f.logsf(ordinate / axes, 2 * axes, 80.0), rel=1e-9)


def test_a_tail_of_f_that_underflows_has_its_leading_term() -> None:
    """I_x(a, b) = xᵃ (1 − x)ᵇ / (a B(a, b)) · (1 + …), whose rest is less than e here."""
    mpmath.mp.dps = 60
    above, below, ratio = 300.0, 4000.0, 30.0
    x = mpmath.mpf(below) / (below + above * ratio)
    exact = mpmath.log(mpmath.betainc(below / 2, above / 2, 0, x, regularized=True))
    assert spectrum._log_f(ratio, above, below) == pytest.approx(float(exact), abs=1.0)


# -- the floor --------------------------------------------------------------------------------------------------------


def test_quiet_are_the_frequencies_of_the_upper_half_away_from_multiples() -> None:
    frequency = np.arange(1.0, 2000.0, 1.0)
    expected = [
        hertz > 1000.0 and all(abs(hertz - 200.0 * order) > 25.0 for order in range(6)) for hertz in frequency.tolist()
    ]
    np.testing.assert_array_equal(quiet_bins(frequency, RATE, HZ), expected)
    # A resonance of 700 Hz: above one and a half of it, away from where its multiples fold to.
    folds = [0.0, 700.0, 1400.0, 1900.0, 1200.0, 500.0]
    expected = [h > 1050.0 and all(abs(h - at) > 87.5 for at in folds) for h in frequency.tolist()]
    np.testing.assert_array_equal(quiet_bins(frequency, RATE, 700.0), expected)


def test_where_nothing_is_left_of_the_upper_half_the_whole_spectrum_counts() -> None:
    """Three samples a cycle: 1.5 resonances are half of the rate."""
    frequency = np.arange(1.0, 2000.0, 1.0)
    folds = [folded(order * 1333.0, RATE) for order in range(6)]
    expected = [all(abs(h - at) > 166.625 for at in folds) for h in frequency.tolist()]
    np.testing.assert_array_equal(quiet_bins(frequency, RATE, 1333.0), expected)
    few = np.linspace(1.0, 1999.0, 100)  # 43 bins of the upper half would be too few
    assert np.sum(quiet_bins(few, RATE, HZ) & (few < 1000.0)) > 0


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


@pytest.mark.parametrize(("bins", "source"), [(64, "the spectrum"), (63, "the declared noise")])
def test_from_64_quiet_bins_on_the_spectrum_tells_the_floor(
    monkeypatch: pytest.MonkeyPatch, bins: int, source: str
) -> None:
    chosen = np.arange(3999) < bins
    monkeypatch.setattr(floor, "quiet_bins", lambda *given: chosen)
    predicted = np.full((9, 2), 7.0)
    predicted[0] = np.nan
    found = noise_floor(flat(3999), predicted, RATE, HZ)
    assert found.source.startswith(source)
    assert found.rms == pytest.approx([math.sqrt(3.0 / math.log(2.0) * RATE / 2.0)] * 2 if bins == 64 else [7.0, 7.0])
    told = noise_floor(flat(3999), predicted, RATE, HZ, np.array([5.0, 6.0]))
    assert (told.rms.tolist(), told.uncertainty, told.source) == ([5.0, 6.0], 0.0, "repeats of the drive")


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize(("period", "repeats"), [(500, 6), (40, 60), (300, 3)])
def test_repeats_are_found_and_the_quieter_half_tells_the_noise(axes: int, period: int, repeats: int) -> None:
    """The first stretch is still settling, and does not count."""
    random = np.random.default_rng(period)
    drive = np.tile(random.standard_normal((period, axes)), (repeats, 1))
    n = len(drive)
    assert floor._period(drive) == period
    noise = np.array([0.01, 0.04])[:axes] * random.standard_normal((n, axes))
    sense = noise + 5.0 * np.exp(-np.arange(n) / 40.0)[:, None]
    found = repeated_noise(sense, drive)
    assert found is not None
    length = period * math.ceil(256 / period)
    apart = (sense[length:] - sense[:-length]) ** 2
    pairs = len(apart) // length
    sizes = np.array([apart[k * length : (k + 1) * length].mean(axis=0) for k in range(pairs)])
    quieter = sizes[np.argsort(sizes.sum(axis=1))[: (pairs + 1) // 2]]
    np.testing.assert_allclose(found, np.sqrt(quieter.mean(axis=0) / 2.0))
    if repeats > 3:
        np.testing.assert_allclose(found, [0.01, 0.04][:axes], rtol=0.15)


def test_a_drive_of_one_size_repeats_as_any_other() -> None:
    """±1 at random: its rms is 1."""
    signs = np.tile(np.sign(np.random.default_rng(8).standard_normal((300, 1))), (4, 1))
    assert floor._period(signs) == 300
    steps = np.tile([[1.0], [-1.0], [2.0], [0.5]], (40, 1))
    assert floor._period(steps[:64]) == floor._period(steps[:63]) == 4
    assert floor._period(steps[:7]) is None


def test_a_drive_that_is_off_most_of_the_time_repeats_as_any_other() -> None:
    """What is looked for again is where it is largest."""
    pulse = np.zeros((300, 1))
    pulse[200:203, 0] = 1.0, 3.0, -2.0
    assert floor._period(np.tile(pulse, (5, 1))[:1240]) == 300


def test_one_axis_that_stands_still_does_not_hide_the_period_of_the_other() -> None:
    drive = np.ones((1200, 2))
    drive[:, 1] = np.tile(np.random.default_rng(6).standard_normal(300), 4)
    assert floor._period(drive) == 300


def test_64_quiet_bins_of_the_upper_half_are_enough() -> None:
    """And with 63 the whole spectrum counts."""
    upper = np.linspace(1300.0, 1900.0, 64)  # of 233 Hz: no multiple is there
    assert quiet_bins(np.concatenate([[300.0, 320.0], upper]), RATE, 233.0).tolist() == [False] * 2 + [True] * 64
    assert quiet_bins(np.concatenate([[300.0, 320.0], upper[1:]]), RATE, 233.0).all()


def test_what_comes_back_only_nearly_does_not_repeat() -> None:
    """To a ten-thousandth of its rms."""
    random = np.random.default_rng(3)
    drive = np.tile(random.standard_normal((400, 1)), (4, 1))
    for off, period in ((0.5e-4, 400), (2e-4, None)):
        noisy = drive + off * random.standard_normal(drive.shape)
        assert [floor._period(size * noisy) for size in (1e-3, 1.0, 1e3)] == [period] * 3  # in whatever unit
    lost = np.tile(random.standard_normal((700, 1)), (2, 1))
    assert floor._period(lost[:900]) is None  # what comes back once, for a part of the record
    assert floor._period(np.zeros((400, 1))) is None
    assert floor._period(drive[:63]) is None


def test_two_periods_are_one_pair_and_less_is_none() -> None:
    random = np.random.default_rng(4)
    drive = np.tile(random.standard_normal((400, 1)), (2, 1))
    sense = random.standard_normal((800, 1))
    assert repeated_noise(sense, drive) == pytest.approx(math.sqrt(np.mean((sense[400:] - sense[:400]) ** 2) / 2.0))
    assert repeated_noise(sense[:799], drive[:799]) is None


# -- whiteness --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("samples", "cycle", "lags"),
    [(10_000, 20.0, 40), (10_000, 3.0, 10), (200, 20.0, 25), (5, 20.0, 1), (10_000, 20.1, 41)],
)
def test_lags_are_two_cycles_ten_at_least_and_an_eighth_at_most(samples: int, cycle: float, lags: int) -> None:
    assert whiteness.sensible_lags(samples, cycle) == lags


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
