"""Figures of a data sheet against what was put into a record, and intervals against how often they hold it."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.stats import rice

from estimator.characteristics.angle_map import AngleMap, Correction, pattern_angle
from estimator.characteristics.rate_error import line
from estimator.characteristics.regression import Estimate, fitted
from estimator.characteristics.response import response
from estimator.characteristics.small_rates import small_rates
from estimator.characteristics.start_up import start_up
from estimator.characteristics.stretches import Stretches, pattern_columns
from hil.characterising.figures import figures_of
from hil.characterising.source import Axis, Block

RATE_HZ = 100.0


def stretches(rate, reference, **more):
    t = np.arange(len(rate)) / RATE_HZ
    return Stretches(t, np.asarray(rate), np.asarray(reference), **more)


def steps(rates, each=200):
    return np.repeat(np.asarray(rates, float), each)


def white(n, size, seed=1):
    return size * np.random.default_rng(seed).standard_normal(n)


def holds(estimate, truth):
    return estimate.low <= truth <= estimate.high


def test_bias_scale_factor_asymmetry_and_temperature():
    """A device with all of them at once, in closed form: what was put in comes out, without noise exactly."""
    turned = np.tile(steps(np.linspace(-3, 3, 25), 40), 5)
    warmer = np.linspace(-10.0, 15.0, turned.size)
    t = warmer - warmer.mean()
    rate = 0.02 + 1.001 * turned + 5e-4 * np.abs(turned) + 1e-4 * t + 2e-5 * turned * t
    found = line(stretches(rate, turned, temperature=warmer)).figures()
    assert found["bias"].value == pytest.approx(0.02, abs=1e-9)
    assert found["scale_factor_error"].value == pytest.approx(1e-3, abs=1e-9)
    assert found["scale_factor_asymmetry"].value == pytest.approx(2 * 5e-4 / 1.001, rel=1e-6)
    assert found["bias_temperature"].value == pytest.approx(1e-4, rel=1e-6)
    assert found["scale_factor_temperature"].value == pytest.approx(2e-5 / 1.001, rel=1e-6)


def test_figures_that_a_record_does_not_tell_apart_are_not_told():
    """A rate that only rises as the device warms; a rate of both signs, of one size but for a hundredth."""
    turned = steps(np.linspace(-3, 3, 25))
    warmer = np.linspace(-10.0, 15.0, turned.size)
    found = line(stretches(turned + white(turned.size, 1e-3), turned, temperature=warmer))
    assert "bias_temperature" in found.confounded
    assert "bias_temperature" not in found.figures()
    turned = steps([1.0, -1.0, 1.01, -1.01])
    found = line(stretches(turned + white(turned.size, 1e-3), turned))
    assert found.confounded == {"scale_factor_asymmetry"}
    assert holds(found.figures()["scale_factor_error"], 0.0)


def test_non_linearity_is_the_largest_distance_from_the_best_line():
    turned = steps(np.linspace(-2, 2, 21))
    rate = turned + 1e-3 * turned**3
    values = np.linspace(-2, 2, 21)
    best = np.polynomial.Polynomial.fit(values, values + 1e-3 * values**3, 1)
    expected = np.abs(values + 1e-3 * values**3 - best(values)).max() / 2 / best.deriv()(0)
    assert line(stretches(rate, turned)).figures()["scale_factor_nonlinearity"].value == pytest.approx(
        expected, rel=2e-3
    )


def test_non_linearity_of_a_straight_device_is_none():
    """The largest of 21 distances is one of noise: of a hundred records nearly all hold 0."""
    turned = np.tile(steps(np.linspace(-2, 2, 21), 40), 2)
    found = [line(stretches(turned + white(turned.size, 1e-2, seed), turned)).figures() for seed in range(100)]
    assert np.mean([one["scale_factor_nonlinearity"].low == 0.0 for one in found]) >= 0.92


def test_an_interval_of_a_reversed_output_has_its_ends_in_order():
    """A method that diverged may have a negative scale factor."""
    turned = steps(np.linspace(-2, 2, 21))
    found = line(stretches(-0.3 * turned + 0.3 * np.abs(turned) + white(turned.size, 1e-3), turned)).figures()
    assert all(figure.low <= figure.value <= figure.high for figure in found.values())


def test_delay_of_a_slow_motion():
    t = np.arange(6000) / RATE_HZ
    turned = np.sin(2 * np.pi * 0.2 * t)
    slope = 2 * np.pi * 0.2 * np.cos(2 * np.pi * 0.2 * t)
    found = line(stretches(np.sin(2 * np.pi * 0.2 * (t - 0.004)), turned, slope=slope)).figures()
    assert found["delay"].value == pytest.approx(0.004, rel=1e-3)


@pytest.mark.parametrize("noise", ["white", "random walk"])
def test_intervals_hold_what_was_put_in(noise):
    """Correlated noise widens them: of a hundred records nearly all hold the scale factor."""
    turned = np.tile(steps([-1.0, 0.0, 1.0], 20), 40)
    held = []
    for seed in range(100):
        off = white(turned.size, 0.01, seed)
        off = np.cumsum(off) * 0.05 if noise == "random walk" else off
        held.append(holds(line(stretches(1.002 * turned + off, turned)).figures()["scale_factor_error"], 2e-3))
    assert np.mean(held) > 0.88


def test_what_a_record_cannot_tell_is_not_there():
    still = Stretches(np.arange(500) / RATE_HZ, 0.01 + white(500, 1e-3))
    assert set(line(still).figures()) == {"bias"}
    one_way = steps(np.linspace(0.5, 3, 12))
    assert "scale_factor_asymmetry" not in line(stretches(one_way, one_way)).figures()
    assert line(Stretches(np.zeros(2), np.zeros(2))) is None
    assert small_rates(line(still).levels) == {}


def test_threshold_and_dead_zone_of_a_device_that_swallows_small_rates():
    """Output max(|Ω| − 0.02, 0): half of Ω first at 0.04, less than a tenth up to 0.0222."""
    rates = np.array([0, 0.01, 0.018, 0.025, 0.03, 0.038, 0.041, 0.06, 0.5, 1, 2])
    turned = steps(np.concatenate([-rates[::-1], rates]))
    rate = np.sign(turned) * np.maximum(np.abs(turned) - 0.02, 0.0) + white(turned.size, 1e-4)
    record = stretches(rate, turned)
    found = small_rates(line(record).levels)
    assert found["threshold"].value == pytest.approx(0.041, rel=0.01)
    assert holds(found["threshold"], 0.04)
    assert holds(found["dead_zone"], 0.0222)
    clean = small_rates(line(stretches(turned + white(turned.size, 1e-4), turned)).levels)
    assert (clean["threshold"].value, clean["dead_zone"].value) == (pytest.approx(0.01, rel=0.01), 0.0)
    assert clean["threshold"].said == "the least rate given"


def test_bandwidth_and_delay_of_a_low_pass():
    """Two poles at 10 Hz after Butterworth, and two samples late: −3 dB there; delay √2/(2π f) + 2 samples."""
    turned = white(60_000, 1.0, 4)
    b, a = butter(2, 10.0, fs=RATE_HZ)
    late = np.concatenate([np.zeros(2), lfilter(b, a, turned)[:-2]])
    found = response(late + white(60_000, 1e-3, 5), turned, RATE_HZ)
    assert found["bandwidth"].value == pytest.approx(10.0, rel=0.03)
    assert holds(found["bandwidth"], 10.0)
    warped = np.tan(np.pi * 10.0 / RATE_HZ) * RATE_HZ / np.pi  # the analogue corner behind the digital filter
    assert found["delay"].value == pytest.approx(np.sqrt(2) / (2 * np.pi * warped) + 2 / RATE_HZ, rel=0.1)
    assert response(white(4000, 1.0, 6), white(4000, 1.0, 7), RATE_HZ) == {}


def test_a_phase_that_no_polynomial_describes_still_gives_the_delay():
    """One pole at 15 Hz and a sample late, next to no noise, steps beside a noise: every term leaves something."""
    keep = np.exp(-2 * np.pi * 15.0 / RATE_HZ)
    n = 42_000
    turned = steps(np.tile([0.0, 0.4, -0.4, 1.2, -1.2, 0.0], 7), n // 42) + 0.05 * white(n, 1.0, 8)
    late = np.concatenate([[0.0], lfilter([1.0 - keep], [1.0, -keep], turned)[:-1]])
    found = response(late + white(n, 1e-7, 9), turned, RATE_HZ)["delay"]
    assert found.value == pytest.approx((keep / (1.0 - keep) + 1.0) / RATE_HZ, rel=0.05)


def test_an_output_that_is_its_reference_has_no_delay():
    """As of an emulator without noise: the coherence is 1 but for rounding, which may be above."""
    turned = white(8192, 1.0, 10)
    assert response(0.3 * turned, turned, RATE_HZ)["delay"].value == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("late_s", [0.01, 0.05])
def test_delay_of_a_table_that_ramps_between_its_rates(late_s):
    """Ramps of 2 s: next to nothing moves faster than a window of the spectrum resolves. The delay is that of the
    simulation itself, behind one pole at 20 Hz, whose own is 1/(2π 20 Hz)."""
    n, rates = 60_000, np.tile([-1.5, -0.5, 0.0, 0.5, 1.5], 3)
    hann = np.hanning(200) / np.hanning(200).sum()
    turned = np.convolve(np.pad(np.repeat(rates, n // 15), 200, "edge"), hann, "same")[200:-200]
    keep = np.exp(-2 * np.pi * 20.0 / RATE_HZ)
    late = turned[np.maximum(np.arange(n) - round(late_s * RATE_HZ), 0)]
    output, _ = lfilter([1.0 - keep], [1.0, -keep], late, zi=[keep * late[0]])
    truth = late_s + keep / (1.0 - keep) / RATE_HZ
    held = [holds(response(output + white(n, 1e-3, seed), turned, RATE_HZ)["delay"], truth) for seed in range(20)]
    assert np.mean(held) >= 0.9


def test_start_up_time():
    t = np.arange(0, 60, 0.1)
    error = 5.0 * np.exp(-t / 4.0) + white(t.size, 0.01)
    found = start_up(t, error)
    assert found.value == pytest.approx(4.0 * np.log(5.0 / 0.04), rel=0.1)
    assert start_up(t, white(t.size, 0.01)).value == 0.0


def test_an_answer_to_a_later_step_is_no_start_up():
    t = np.arange(0, 60, 0.1)
    noise = white(t.size, 0.01)
    late = 5.0 * np.exp(-np.maximum(t - 20.0, 0.0)) * (t >= 20.0)
    assert start_up(t, late + noise).value == 0.0
    early = 5.0 * np.exp(-t)
    assert start_up(t, early + late + noise).value == pytest.approx(np.log(5.0 / 0.04), rel=0.1)


def test_a_drift_that_goes_on_is_no_start_up():
    t = np.arange(0, 600, 0.1)
    assert start_up(t, 0.01 * t + white(t.size, 0.01)).value == 0.0


def harmonics(seed=2):
    generator = np.random.default_rng(seed)
    return AngleMap(1e-4 * generator.standard_normal((2, 4)), 1e-3 * generator.standard_normal((2, 4)))


def test_harmonics_over_the_angle():
    """Two turns each way at two rates: both maps, and their sizes as figures."""
    known = harmonics()
    turned = np.concatenate([np.full(4000, rate) for rate in (0.5, -0.5, 0.2, -0.2)])
    theta = 0.3 - np.cumsum(turned) * 2 * np.pi / 500
    bias, scale = known.at(theta)
    record = stretches(turned + bias + scale * turned, turned, pattern=pattern_columns(theta, turned))
    found = line(record)
    for k in (1, 2, 3, 4):
        assert found.figures()[f"bias_{k}theta"].value == pytest.approx(np.hypot(*known.bias[:, k - 1]), rel=1e-6)
        assert found.figures()[f"scale_factor_{k}theta"].value == pytest.approx(
            np.hypot(*known.scale[:, k - 1]), rel=1e-6
        )
        assert found.fit.of(f"bias_cos{k}") == pytest.approx(known.bias[0, k - 1], rel=1e-6)
    half = turned[:60] * 0 + 0.1
    few = stretches(half, half, pattern=pattern_columns(np.linspace(0, 0.3, 60), half))
    assert line(few).angles == ()


@pytest.mark.parametrize("size", [0.5, 1.0, 2.0, 3.0, 5.0, 12.0])
def test_the_interval_of_a_length_is_that_of_rice(size):
    """Beside SciPy's Rice distribution, by the lengths that the one found denies; wider of few degrees of freedom."""
    found = Estimate.of_two(0.6 * size, 0.8 * size, 1.0, 1e6)
    if found.low > 0.0:
        assert rice.sf(size, found.low) == pytest.approx(0.025, abs=1e-4)
    else:
        assert rice.sf(size, 0.0) > 0.025
    assert rice.cdf(max(size, rice.median(0.0)), found.high) == pytest.approx(0.025, abs=1e-4)
    few = Estimate.of_two(0.6 * size, 0.8 * size, 1.0, 2.0)
    assert 0.0 <= few.low <= found.low
    assert few.high > found.high


@pytest.mark.moderate
@pytest.mark.parametrize("blue", [False, True], ids=["white", "of an angle that is read directly"])
@pytest.mark.parametrize("size", [0.0, 0.3])
def test_a_harmonic_s_interval_holds_it_in_the_noise_that_is_there(blue, size):
    """Nineteen of twenty, also where there is none: the length of two noisy coefficients is never 0, and the noise of
    an angle grows with frequency. White noise of density 1 would give each coefficient a deviation of 0.045."""
    covered = {k: [] for k in (1, 4)}
    turned = np.zeros(4000)
    theta = 0.1 + 0.6 * np.arange(turned.size)  # 4 θ at 0.38 of the rate
    for seed in range(200):
        error = np.diff(white(turned.size + 1, 1.0, seed)) if blue else white(turned.size, 1.0, seed)
        rate = error + size * np.cos(theta + 0.5) + size * np.cos(4 * theta - 1.0)
        found = line(stretches(rate, turned, pattern=pattern_columns(theta, turned))).figures()
        for k, held in covered.items():
            held.append(holds(found[f"bias_{k}theta"], size))
    for held in covered.values():
        assert np.mean(held) >= 0.92
    if not blue:
        assert np.mean(covered[4]) <= 0.995


def test_the_map_is_taken_off_row_by_row():
    known = AngleMap(np.array([[0, 1e-3, 0, 2e-3], [0, 0, 0, 5e-4]]), np.array([[0, 2e-3, 0, 0], [0, 0, 0, 1e-3]]))
    t = np.arange(20_000) / RATE_HZ
    true = 0.4 * t + 0.3 * np.sin(0.1 * t)
    rate = np.gradient(true, t)
    theta = 0.2 - true
    bias, scale = known.at(theta)
    angle = true + np.concatenate([[0], np.cumsum((bias + scale * rate)[:-1] / RATE_HZ)])
    correction, angles, rates = Correction(known), [], []
    for part in np.array_split(np.arange(t.size), 9):
        wrapped = np.mod(theta[part], np.pi)  # the pattern is known within half a turn
        done = correction.follow(t[part], wrapped, angle[part], (rate + bias + scale * rate)[part])
        angles.append(done[0])
        rates.append(done[1])
    left = np.concatenate(angles) - true
    assert np.abs(left - left[0]).max() < 0.01 * np.abs(angle - true).max()
    assert np.abs(np.concatenate(rates) - rate).max() < 1e-5


def test_pattern_angle_of_a_known_ellipse():
    k, theta, phase = 1e4, 0.7, 0.4
    along = np.cos(phase)
    motion = [
        along * np.cos(theta),
        -100 * np.sin(phase) * np.cos(theta),
        along * np.sin(theta),
        -100 * np.sin(phase) * np.sin(theta),
    ]
    assert pattern_angle(*(np.array([value]) for value in motion), k) == pytest.approx([theta])


def test_a_column_that_tells_nothing_is_left_out():
    x = np.linspace(0, 1, 50)
    found = fitted({"a": np.ones(50), "b": x, "c": 2 * x + 1}, 3 + 4 * x)
    assert found.names == ("a", "b")
    assert found.of("c") == 0.0
    assert Estimate(-2.0, -3.0, 1.0).size == Estimate(2.0, 0.0, 3.0)


def turned_axis(rate, turned):
    """A record of one axis, in blocks."""

    def blocks():
        for begin in range(0, rate.size, 1000):
            end = min(begin + 1000, rate.size)
            yield Block(np.arange(begin, end), rate[begin:end], turned[begin:end], None, None)

    return Axis("x", RATE_HZ, 0, rate.size, 0, False, blocks)


@pytest.mark.parametrize("late", [20, 30])
@pytest.mark.parametrize("kind", ["sine of 0.5 Hz", "sine of 1.5 Hz", "ramps", "vibration"])
def test_the_scale_factor_of_a_late_output_is_that_of_one_in_time(kind, late):
    """Right but late by a sample or one and a half, 10 and 15 ms: a sine, ramps of half a second between the rates of a
    table, motion of a wide band.

    To a fit beside the reference as it is, a sine is smaller by (ωτ)²/2: 490 and 4,440 ppm.
    """
    fine = 20  # steps of a sample
    n = 12_000 * fine
    t = np.arange(n) / (RATE_HZ * fine)
    if kind.startswith("sine"):
        turned = 1.7 * np.sin(2 * np.pi * float(kind.split()[2]) * t)
    elif kind == "ramps":
        wide = fine * 50
        turned = np.convolve(np.repeat([0.0, 1.2, -1.2, 0.4, -0.4, 0.0], n // 6), np.ones(wide) / wide, "same")
    else:
        b, a = butter(4, 8.0, fs=RATE_HZ * fine)
        turned = lfilter(b, a, white(n, 3.0, 11))
    output = np.concatenate([np.full(late, turned[0]), turned[:-late]])[::fine] + white(12_000, 5e-4, 12)
    found = figures_of([turned_axis(output, turned[::fine])]).found
    assert holds(found["scale_factor_error"], 0.0)
    assert abs(found["scale_factor_error"].value) < 1e-4
    assert found["delay"].value == pytest.approx(late / fine / RATE_HZ, abs=1e-4)


@pytest.mark.parametrize("late_s", [0.0123, 1.0])
def test_the_delay_of_a_few_tones_is_not_read_between_them(late_s):
    """Between the tones of a multisine a window shows what leaks there, and its phase is no output's."""
    t_s, held = np.arange(round(200.0 * RATE_HZ)) / RATE_HZ, []
    for seed in range(8):
        random = np.random.default_rng(seed)
        tones, phases = random.uniform(0.02, 3.0, 12), random.uniform(0.0, 2.0 * np.pi, 12)

        def turned(at, tones=tones, phases=phases):
            return 0.3 * np.sin(2.0 * np.pi * np.outer(at, tones) + phases).sum(axis=1)

        output = 0.998 * turned(t_s - late_s) + 2e-3 + white(t_s.size, 1e-4, 100 + seed)
        held.append(holds(figures_of([turned_axis(output, turned(t_s))]).found["delay"], late_s))
    assert sum(held) >= 6  # of 95 %, fewer once in five hundred
