"""Allan deviation against published values and closed forms, and what is read off it against what was put in."""

import numpy as np
import pytest
from scipy.signal import fftconvolve, lfilter

from estimator.allan.deviation import allan_deviation
from estimator.allan.noise import FLOOR, read_noise

RATE_HZ = 100.0


def curve(rate, lengths=None, rate_Hz=RATE_HZ, tick=None):
    tick = np.arange(len(rate)) if tick is None else tick
    lengths = None if lengths is None else np.array(lengths)
    return allan_deviation(np.asarray(rate, float), tick, rate_Hz, lengths)


def white(n, seed, density=1.0):
    """White noise of `density` per √Hz: σ(τ) = density/√τ."""
    return density * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal(n)


def flicker(n, seed, instability):
    """Noise of density B²/(2π f): Kasdin, Proc. IEEE 83(5), 1995, whose variance is then B²."""
    k = np.arange(1, n)
    response = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    return instability * fftconvolve(response, np.random.default_rng(seed).standard_normal(n))[:n]


def test_published_values_of_nine_numbers():
    """NIST SP 1065, table 30 (data of NBS Monograph 140, annex 8.E), overlapping Allan deviation."""
    found = curve([892, 809, 823, 798, 671, 644, 883, 903, 677], [1, 2], 1.0)
    assert found.deviation == pytest.approx([91.22945, 85.95287], abs=5e-6)


def test_published_values_of_a_thousand_numbers():
    """NIST SP 1065, section 12.4 and table 31."""
    numbers = [1234567890]
    while len(numbers) < 1000:
        numbers.append(16807 * numbers[-1] % 2147483647)
    found = curve(np.array(numbers) / 2147483647, [1, 10, 100], 1.0)
    assert found.deviation == pytest.approx([2.922319e-1, 9.159953e-2, 3.241343e-2], abs=5e-8)
    assert found.clusters == pytest.approx([1000, 100, 10])


def test_white_noise_falls_as_one_over_the_root():
    found = curve(white(200_000, 1, density=0.3))
    sure = found.clusters > 500
    assert found.deviation[sure] == pytest.approx(0.3 / np.sqrt(found.tau_s[sure]), rel=0.08)


def test_quantisation_noise_falls_as_one_over_the_length():
    """Rate from an angle read with independent errors of deviation Q: σ(τ) = √3 Q/τ."""
    angle = 0.01 * np.random.default_rng(2).standard_normal(200_001)
    found = curve(np.diff(angle) * RATE_HZ)
    sure = found.clusters > 200
    assert found.deviation[sure] == pytest.approx(np.sqrt(3) * 0.01 / found.tau_s[sure], rel=0.02)


def test_a_random_walk_rises_as_the_root():
    """K per √s: σ(τ) = K √(τ/3), for clusters of m samples times √(1 + 1/(2 m²))."""
    random_walk = np.cumsum(0.2 / np.sqrt(RATE_HZ) * np.random.default_rng(3).standard_normal(400_000))
    found = curve(random_walk, [1, 4, 30, 200])
    expected = 0.2 * np.sqrt(found.tau_s / 3) * np.sqrt(1 + 0.5 / np.array([1, 4, 30, 200]) ** 2)
    assert found.deviation == pytest.approx(expected, rel=0.05)


def test_a_ramp_is_exact():
    found = curve(0.5 * np.arange(3000) / RATE_HZ)
    assert found.deviation == pytest.approx(0.5 * found.tau_s / np.sqrt(2), rel=1e-9)


def test_a_sine_is_exact():
    """IEEE Std 952-1997, C.1.6: σ²(τ) = Ω² sin⁴(π f τ)/(π f τ)², here of a whole number of periods."""
    t = (np.arange(100_000) + 0.5) / RATE_HZ
    found = curve(2.0 * np.sin(2 * np.pi * 0.2 * t), [50, 100, 185, 250, 400])
    phase = np.pi * 0.2 * found.tau_s
    # a cluster's mean is over samples, not over time: sinc of half a sample
    held = np.pi * 0.2 / RATE_HZ / np.sin(np.pi * 0.2 / RATE_HZ)
    assert found.deviation == pytest.approx(2.0 * np.sin(phase) ** 2 / phase * held, rel=0.01)


@pytest.mark.moderate
def test_the_interval_holds_the_truth_as_often_as_it_says():
    inside, scatter = [], []
    for seed in range(200):
        found = curve(white(3000, seed), [1, 2, 10, 100, 500])
        scatter.append(found.deviation * np.sqrt(found.tau_s))
        low, high = found.interval(0.95)
        inside.append((low <= found.tau_s**-0.5) & (found.tau_s**-0.5 <= high))
    assert (np.mean(inside, 0) > 0.92).all()
    assert found.relative_sd[2:4] == pytest.approx(np.std(scatter, 0)[2:4], rel=0.15)


def test_missing_samples_neither_shift_nor_add():
    """A ramp with gaps keeps its slope; white noise its level; nothing is read across a long gap."""
    tick = np.delete(np.arange(20_000), [5, 6, 1000, *range(9000, 9040)])
    found = curve(0.5 * tick / RATE_HZ, [1, 10, 100], tick=tick)
    assert found.deviation == pytest.approx(0.5 * found.tau_s / np.sqrt(2), rel=1e-3)
    noise = white(20_000, 4)[tick]
    holes, whole = curve(noise, [1, 10, 100], tick=tick), curve(white(20_000, 4), [1, 10, 100])
    assert holes.deviation == pytest.approx(whole.deviation, rel=0.02)
    split = np.concatenate([np.arange(500), np.arange(50_000, 50_500)])
    assert curve(np.repeat([0.0, 7.0], 500), [100], tick=split).deviation == pytest.approx([0.0], abs=1e-12)


def test_long_clusters_do_not_need_every_place():
    """Beyond a few hundred places a cluster the curve is the plain definition's all the same."""
    rate = white(30_000, 5)
    sums = np.concatenate([[0.0], np.cumsum(rate)])
    m = 3000
    means = (sums[m:] - sums[:-m]) / m
    plain = np.sqrt(0.5 * np.mean((means[m:] - means[:-m]) ** 2))
    assert curve(rate, [m]).deviation == pytest.approx([plain], rel=1e-3)


@pytest.mark.moderate
def test_angle_random_walk_is_found_and_covered():
    covered = []
    for seed in range(100):
        found = read_noise(curve(white(3000, seed, 0.3)))
        read = found.readings["white"]
        covered.append(read.low <= 0.3 <= read.high)
        assert read.value == pytest.approx(0.3, rel=0.1)
        assert found.bias_instability is None
        assert found.told_s == pytest.approx(2.56)
        assert found.bias_bound_rad_s is not None
    assert np.mean(covered) > 0.9


@pytest.mark.moderate
def test_a_short_record_bounds_the_bias_instability_from_above():
    """White noise over a flicker floor that forty seconds do not reach."""
    below = []
    for seed in range(60):
        found = read_noise(curve(white(4000, seed, 0.3) + flicker(4000, 900 + seed, 0.02)))
        assert found.bias_instability is None
        below.append(found.bias_bound_rad_s > 0.02)
    assert np.mean(below) > 0.95


@pytest.mark.slow
def test_bias_instability_is_found_where_the_record_reaches_it():
    covered, values = [], []
    for seed in range(12):
        found = read_noise(curve(white(200_000, seed, 0.1) + flicker(200_000, 900 + seed, 0.2)))
        assert found.readings["white"].value == pytest.approx(0.1, rel=0.03)
        covered.append(found.bias_instability.low <= 0.2 <= found.bias_instability.high)
        values.append(found.bias_instability.value)
    assert np.mean(values) == pytest.approx(0.2, rel=0.1)
    assert np.mean(covered) >= 0.75
    assert pytest.approx(0.664, abs=5e-4) == FLOOR


def test_the_other_terms_are_found():
    n = 200_000
    angle = 0.002 * np.random.default_rng(6).standard_normal(n + 1)
    random_walk = np.cumsum(0.05 / np.sqrt(RATE_HZ) * np.random.default_rng(7).standard_normal(n))
    found = read_noise(curve(np.diff(angle) * RATE_HZ + white(n, 8, 0.02) + random_walk))
    assert found.readings["quantisation"].value == pytest.approx(0.002, rel=0.05)
    assert found.readings["rate random walk"].value == pytest.approx(0.05, rel=0.2)
    assert found.bias_instability is None


@pytest.mark.moderate
@pytest.mark.parametrize(("instability", "walk"), [(0.0, 0.02), (0.02, 0.02), (0.02, 0.001)])
def test_bias_instability_is_bounded_where_other_noise_makes_the_minimum(instability, walk):
    """White noise of 0.1, and a random walk or a ramp: without a flicker that shows, an upper limit above it."""
    n, seen = 200_000, []
    drift = 2e-5 * np.arange(n) / RATE_HZ
    for seed in range(20):
        random_walk = np.cumsum(walk / np.sqrt(RATE_HZ) * np.random.default_rng(500 + seed).standard_normal(n))
        rate = white(n, seed, 0.1) + flicker(n, 900 + seed, instability)
        for slow in (random_walk, 10.0 * walk * drift / 0.02):
            found = read_noise(curve(rate + slow))
            if found.fit is None:
                continue
            if found.bias_instability is None:
                seen.append(instability < found.bias_bound_rad_s)
            else:
                seen.append(found.bias_instability.low <= instability <= found.bias_instability.high)
    assert len(seen) >= 36
    assert np.mean(seen) >= 0.95


@pytest.mark.moderate
def test_a_filter_in_the_sensor_is_left_out_of_the_fit():
    """A two-pole low-pass at an eighth of the sample rate: the shortest clusters are not those of white noise."""
    values, covered = [], []
    for seed in range(20):
        found = read_noise(curve(lfilter([0.25], [1.0, -1.0, 0.25], white(100_000, seed, 0.3))))
        assert found.curve.deviation[0] < 0.5 * 0.3 / np.sqrt(found.curve.tau_s[0])
        assert 0.02 < found.fit.from_s < 5.0
        read = found.readings["white"]
        values.append(read.value)
        covered.append(read.low <= 0.3 <= read.high)
    assert np.mean(values) == pytest.approx(0.3, rel=0.02)
    assert np.mean(covered) >= 0.85


@pytest.mark.moderate
def test_the_walk_of_an_angle_that_is_read_through_a_filter():
    """A whole-angle gyro's: white noise of the rate, and noise of the angle itself with the memory of an observer.
    Behind that memory it falls as one over the length, σ² = 3 s²/τ², and is no walk."""
    n, walk, size, keep = 360_000, 0.01, 0.02, np.exp(-0.05)
    covered, told = [], []
    for seed in range(20):
        step = size * np.sqrt(1.0 - keep**2) * np.random.default_rng(500 + seed).standard_normal(n + 1)
        angle = lfilter([1.0], [1.0, -keep], step)
        found = read_noise(curve(np.diff(angle) * RATE_HZ + white(n, seed, walk)))
        if (read := found.readings.get("white")) is not None:
            covered.append(read.low <= walk <= read.high)
        if (angles := found.readings.get("quantisation")) is not None:
            told.append(angles.low <= size <= angles.high)
    assert min(len(covered), len(told)) >= 15
    assert np.mean(covered) >= 0.85
    assert np.mean(told) >= 0.85


def test_a_turning_sensor_is_no_noise():
    t = np.arange(20_000) / RATE_HZ
    found = read_noise(curve(white(20_000, 10, 0.01) + 5.0 * np.sin(2 * np.pi * 0.5 * t)))
    assert (found.fit, found.readings, found.bias_instability) == (None, {}, None)


@pytest.mark.parametrize("n", [0, 1, 2, 5, 30])
def test_next_to_nothing(n):
    found = read_noise(curve(np.zeros(n)))
    assert (found.fit, found.readings, found.bias_instability, found.bias_bound_rad_s) == (None, {}, None, None)
