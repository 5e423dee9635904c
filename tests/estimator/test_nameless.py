"""The nameless rival: what an unknown force of free spectrum gains, beside closed forms, and who beats it."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import lfilter

from estimator.trace import promises
from estimator.trace.criterion import TIE
from estimator.trace.engine import Estimate
from estimator.trace.nameless import Contest, Innovations, contest, level, nameless
from estimator.trace.promises import Claim, Errors

N, SPLIT, FIRST = 24_000, 14_000, 100
FITTED = slice(FIRST, SPLIT)


def white(seed: int, n: int = N, axes: int = 2):
    return np.random.default_rng(seed).standard_normal((n, axes))


def seen(series, deviation=1.0):
    return Innovations(series * deviation, np.full_like(series, deviation), FITTED)


def gain(series, rows=slice(SPLIT, None)) -> float:
    """Of twice the log-likelihood of the part held out."""
    none, some = level(series, FITTED), nameless(series, FITTED)
    return float(np.sum(some.terms(some.unpredicted(series))[rows] - none.terms(none.unpredicted(series))[rows]))


@pytest.mark.moderate
@pytest.mark.parametrize("correlation", [0.1, -0.4, 0.8])
def test_of_a_first_order_process_it_gains_what_prediction_can(correlation: float) -> None:
    """The innovation's variance is 1 − φ² of the whole."""
    series = lfilter([1.0], [1.0, -correlation], white(1), axis=0)
    expected = -2 * (N - SPLIT) * math.log(1.0 - correlation**2)
    chance = 2.0 * math.sqrt(expected)
    assert gain(series) == pytest.approx(expected, abs=4.0 * chance)


@pytest.mark.moderate
def test_of_a_narrow_resonance_in_noise_it_gains_nearly_what_any_predictor_can() -> None:
    """Kolmogorov and Szegő: the smallest variance is exp of the mean of the logarithm of the spectrum."""
    omega, memory, strength = 0.31, 800.0, 0.05
    pole = math.exp(-1.0 / memory)
    denominator = [1.0, -2.0 * pole * math.cos(omega), pole**2]
    series = white(2) + lfilter([strength], denominator, white(3), axis=0)

    def spectrum(w: float) -> float:
        z = np.exp(-1j * w)
        return 1.0 + strength**2 / abs(np.polyval(denominator[::-1], z)) ** 2

    edges = (0.0, omega - 0.02, omega, omega + 0.02, math.pi)
    power, log = (
        sum(quad(f, a, b, limit=500)[0] for a, b in pairwise(edges)) / math.pi
        for f in (spectrum, lambda w: math.log(spectrum(w)))
    )
    expected = 2 * (N - SPLIT) * (math.log(power) - log)
    assert 0.85 * expected < gain(series) < 1.15 * expected


@pytest.mark.moderate
def test_of_a_line_it_leaves_the_noise() -> None:
    t = np.arange(N)
    series = white(4) + 0.5 * np.sin(0.2345 * t)[:, None]
    expected = 2 * (N - SPLIT) * math.log(1.0 + 0.5**2 / 2.0)
    # one force that both axes see: their noises together, over what two lines in phase have
    together = (N - SPLIT) * math.log(1.0 + 2.0 * 0.5**2 / 2.0)
    assert 0.85 * together < gain(series) < expected


@pytest.mark.moderate
@pytest.mark.parametrize("seed", range(10, 18))
def test_of_white_noise_it_gains_nothing(seed: int) -> None:
    assert gain(white(seed)) < TIE
    assert nameless(white(seed), FITTED).order == 0


@pytest.mark.moderate
def test_what_one_axis_tells_of_the_other_is_predicted() -> None:
    """y is x of three samples before, in noise of its own: half of its power."""
    noise = white(5)
    series = np.stack([noise[:, 0], (np.roll(noise[:, 0], 3) + noise[:, 1])], axis=1)
    assert gain(series) == pytest.approx((N - SPLIT) * math.log(2.0), rel=0.05)


@pytest.mark.moderate
def test_a_prediction_sees_the_past_only() -> None:
    series = lfilter([1.0], [1.0, -0.7], white(6), axis=0) + np.sin(0.1 * np.arange(N))[:, None]
    model = nameless(series, FITTED)
    other = series.copy()
    other[20_000:] += 100.0
    predicted, same = (one - model.unpredicted(one) for one in (series, other))
    assert np.allclose(predicted[:20_001], same[:20_001], rtol=0.0, atol=1e-9)
    assert not np.allclose(predicted[20_001], same[20_001], rtol=0.0, atol=1e-3)


@pytest.mark.moderate
def test_lost_samples_stay_lost_and_count_for_nobody() -> None:
    series = lfilter([1.0], [1.0, -0.7], white(7), axis=0)
    series[::50] = np.nan
    found = contest(seen(series), seen(series), SPLIT)
    assert found.samples == 2 * (N - SPLIT) * 49 // 50
    # The best predictor of 49 in 50 samples, the one behind a loss without its past.
    assert found.nameless == pytest.approx(-2 * (N - SPLIT) * 48 / 50 * math.log(1.0 - 0.7**2), rel=0.05)


@pytest.mark.moderate
def test_gains_do_not_depend_on_how_large_the_noise_is_said_to_be() -> None:
    series = lfilter([1.0], [1.0, -0.5], white(8), axis=0)
    after = white(9)
    one, two = (contest(seen(series, s), seen(after, s), SPLIT) for s in (1.0, 3e-4))
    assert (two.named, two.nameless) == pytest.approx((one.named, one.nameless))
    other = Innovations(series, np.full_like(series, 1.7), FITTED)
    assert contest(other, seen(after), SPLIT).named == pytest.approx(one.named)


@pytest.mark.moderate
def test_of_a_long_record_all_that_are_compared_use_the_same_rows() -> None:
    """A noise that grew is no gain of a force: its level is that of the last rows for everyone."""
    series = white(22, n=100_000) * np.linspace(0.5, 1.0, 100_000)[:, None]
    one = Innovations(series, np.ones_like(series), slice(FIRST, 90_000))
    found = contest(one, one, 90_000)
    assert (found.named, found.nameless, found.both) == (0.0, 0.0, 0.0)
    assert found.dispersions == (1.0, 1.0)


@pytest.mark.moderate
def test_a_model_that_gets_lost_has_no_likelihood() -> None:
    series = white(20)
    lost = series.copy()
    lost[20_000:] = np.inf
    found = contest(seen(series), seen(lost), SPLIT)
    assert (found.named, found.both) == (-math.inf, -math.inf)
    assert promises.nameless(claim(found))


def claim(found: Contest | None, effects=None) -> Claim:
    given = {"cubic_stiffness": {"k3x": Estimate(1.0, 0.9, 1.1)}} if effects is None else effects
    return Claim(Errors(3.0, 1.0, 1.0, 1e5, gain=900.0), given, contest=found)


def cubic(seed: int):
    """What a cubic spring leaves of a vibration whose amplitude nobody could foresee."""
    amplitude = 1.0 + lfilter([0.05], [1.0, -0.99], white(seed)[:, :1], axis=0)
    return amplitude**3 * np.cos(0.3 * np.arange(N))[:, None] * np.array([1.0, 0.4])


@pytest.mark.moderate
def test_an_effect_beats_it_where_the_cause_is_there() -> None:
    noise, shape = white(30), cubic(31)
    before, after = noise + 0.5 * shape, noise
    found = contest(seen(before), seen(after), SPLIT)
    assert found.lead > 10.0 * TIE
    assert found.both == pytest.approx(found.named, abs=TIE)
    assert promises.nameless(claim(found)) == ()


@pytest.mark.moderate
def test_beside_what_both_leave_an_effect_is_held_to_what_it_adds() -> None:
    """A rate that jumps leaves something with the effect and without it: the force may have that in both."""
    rest, shape = white(32) + lfilter([0.2], [1.0, -0.98], white(33), axis=0), cubic(34)
    found = contest(seen(rest + 0.1 * shape), seen(rest), SPLIT)
    assert found.named < found.nameless < found.both - TIE
    assert promises.nameless(claim(found)) == ()


@pytest.mark.slow
def test_an_effect_that_imitates_coloured_noise_does_not() -> None:
    """A line fitted to a resonance of thermal noise gains hundreds where it was found, and it is not there."""
    t = np.arange(N)
    wave = np.stack([np.cos(0.3 * t), np.sin(0.3 * t)], axis=1)
    pole = math.exp(-1.0 / 3000.0)
    gained, refused = [], 0
    for seed in range(40, 52):
        thermal = lfilter([0.03], [1.0, -2.0 * pole * math.cos(0.3), pole**2], white(seed), axis=0)
        before = white(seed + 100) + thermal
        coefficients = np.linalg.lstsq(wave[FITTED], before[FITTED], rcond=None)[0]
        after = before - wave @ coefficients
        gained.append(np.sum(before[FITTED] ** 2) - np.sum(after[FITTED] ** 2))
        refused += bool(promises.nameless(claim(contest(seen(before), seen(after), SPLIT))))
    assert min(gained) > 1e4  # where it was found, by far more than chance gives white noise
    assert refused >= 11  # it is let through at odds of 20 to 1


def test_the_sentence_has_both_gains() -> None:
    found = Contest(named=90.0, nameless=150.0, both=155.0, samples=1000)
    (sentence,) = promises.nameless(claim(found))
    assert "unknown force" in sentence
    assert "gains 150" in sentence
    assert "named 155" in sentence
    assert promises.nameless(claim(replace(found, both=150.0 + TIE - 0.1)))
    ahead = replace(found, both=150.0 + TIE + 0.1)
    assert promises.nameless(claim(ahead)) == ()
    assert promises.nameless(claim(replace(ahead, dispersions=(1.1, 1.0))))  # less sure than white noise makes it
    assert promises.nameless(claim(replace(ahead, dispersions=(0.3, 9.0)))) == ()
    assert promises.nameless(claim(found, effects={})) == ()
    assert promises.nameless(claim(None)) == ()
    assert promises.nameless in promises.GUARDS
    assert promises.outdone in promises.PARTLY
