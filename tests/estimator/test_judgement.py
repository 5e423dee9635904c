"""What may be left: noise as it was predicted. What may not: power, memory and lines, each of a stated size."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.completeness import judgement
from estimator.completeness.judgement import left_in, power_over_prediction, predictable_share, steadied
from estimator.correlation import autocorrelation, effective_samples
from estimator.record import Record
from estimator.residual.floor import floor_deviation, quiet_bins
from estimator.residual.spectrum import periodogram

N, RATE, RESONANCE = 60_000, 4000.0, 200.0
CYCLE = 20
RECORD = Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 1.0 / RATE))
SIGMA = 2e-4


def model(innovation, *, noise: float = SIGMA, likelihood: float = 0.0):
    estimates = SimpleNamespace(innovation=SIGMA * innovation, innovation_deviation=np.full(innovation.shape, SIGMA))
    observer = SimpleNamespace(device=SimpleNamespace(noise=(noise, noise)))
    return SimpleNamespace(estimates=estimates, observer=observer, likelihood=likelihood)


def white(seed: int = 1, samples: int = N):
    return np.random.default_rng(seed).standard_normal((samples, 2))


def tone(frequency: float, power: float, samples: int = N):
    """Of that power over both axes together, where white noise has 2."""
    wave = np.sqrt(2.0 * power) * np.sin(2.0 * np.pi * frequency * np.arange(samples) / RATE)
    return np.stack([wave, np.zeros(samples)], axis=1)


def said(innovation, **other) -> tuple[str, ...]:
    return left(model(innovation, **other), RESONANCE)


def left(seen, resonance: float) -> tuple[str, ...]:
    estimates = seen.estimates
    noise = seen.observer.device.noise
    return left_in(estimates.innovation, estimates.innovation_deviation, noise, RECORD, resonance)


@pytest.mark.moderate
def test_white_noise_as_it_was_predicted_leaves_nothing_to_say():
    for seed in range(3):
        assert said(white(seed)) == ()


@pytest.mark.moderate
def test_noise_that_is_not_the_declared_one_is_noise_all_the_same():
    """The floor says how large it is, not the bench file."""
    assert said(1.3 * white()) == ()
    assert said(0.7 * white()) == ()


@pytest.mark.moderate
def test_the_uncertainty_of_the_estimate_is_none_of_the_floor():
    """Where noise is half of the prediction's variance, a floor that is 1.44 of it allows 1.22."""
    below = np.sqrt(0.5) * SIGMA
    assert len(said(1.2 * white(), noise=below)) == 1
    assert "× what its prediction and the noise floor allow" in said(1.2 * white(), noise=below)[0]


def burst(samples: int, energy: float):
    """Half a second of an oscillation beside the resonance, in the middle; energy: in samples' worth of noise."""
    at = np.arange(samples) / RATE
    wave = np.sin(2.0 * np.pi * 204.0 * at) * (np.abs(at - at[samples // 2]) < 0.25)
    wave *= np.sqrt(2.0 * energy / np.sum(wave**2))
    return np.stack([wave, np.zeros(samples)], axis=1)


@pytest.mark.moderate
@pytest.mark.parametrize("samples", [10_000, 20_000, 30_000])
def test_what_a_jump_of_the_rate_leaves_counts_by_its_size_not_by_how_short_the_record_is(samples):
    """One beside the resonance: 80 samples' worth in its middle look like 2 % of 10,000."""
    assert said(white(samples=samples) + burst(samples, 80.0)) == ()
    (told, *_) = said(white(samples=samples) + burst(samples, 700.0))
    assert "can be predicted" in told or "a line is left" in told


@pytest.mark.moderate
@pytest.mark.parametrize("samples", [10_000, 30_000])
def test_a_line_elsewhere_counts_by_its_share_however_short_the_record_is(samples):
    told = said(white(samples=samples) + tone(733.0, 0.026, samples))
    (line,) = [reason for reason in told if "a line is left" in reason]
    assert float(line.split()[-2]) == pytest.approx(733.0, abs=0.1)


@pytest.mark.moderate
@pytest.mark.parametrize(("share", "told"), [(0.03, False), (0.09, True)])
def test_power_beyond_the_floor_is_told_from_a_twentieth_on(share, told):
    """Low-passed noise below a quarter of the sampling rate, where the floor is not read."""
    low = np.fft.rfft(white(2), axis=0)
    frequency = np.fft.rfftfreq(N, 1.0 / RATE)
    low[(frequency < 250.0) | (frequency > 750.0)] = 0.0
    more = np.fft.irfft(low, N, axis=0)
    more *= np.sqrt(share / np.mean(more**2, axis=0))
    reasons = said(white() + more)
    assert any("noise floor allow" in reason for reason in reasons) is told


def test_an_echo_counts_up_to_the_last_lag_that_is_asked_for() -> None:
    """x_k = e_k + e_{k−7}: a correlation of a half at a lag of seven, and no other."""
    noise = white()
    series = noise[7:] + noise[:-7]
    assert predictable_share(series, 7) == pytest.approx(0.25, abs=0.01)
    assert predictable_share(series, 6) == pytest.approx(0.0, abs=0.01)


@pytest.mark.moderate
@pytest.mark.parametrize(("rho", "told"), [(0.1, False), (0.18, True)])
def test_memory_is_told_where_a_fiftieth_of_the_power_follows_from_the_past(rho, told):
    """Of x_k = ρ x_{k−1} + e, ρ² of the power does, and ρ⁴ more by two steps: ρ²/(1 − ρ²)."""
    from scipy.signal import lfilter

    series = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], white(), axis=0)
    assert predictable_share(series, 4 * CYCLE) == pytest.approx(rho**2 / (1.0 - rho**2), abs=0.006)
    assert any("predicted from those before" in reason for reason in said(series)) is told


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("frequency", "power", "told"),
    [(733.0, 0.006, True), (733.0, 0.0015, False), (200.0, 0.012, False), (200.0, 0.03, True)],
)
def test_a_line_is_told_from_a_thousandth_of_the_power_on_beside_the_resonance_from_a_hundredth(frequency, power, told):
    """Of a power of 2: a thousandth is 0.002, a hundredth 0.02."""
    lines = [reason for reason in said(white() + tone(frequency, power)) if "a line is left" in reason]
    assert bool(lines) is told
    if told:
        assert float(lines[0].split()[-2]) == pytest.approx(frequency, abs=RATE / N)


@pytest.mark.moderate
def test_the_start_of_a_record_is_not_judged():
    series = white()
    series[: 8 * CYCLE] *= 30.0
    assert said(series) == ()


@pytest.mark.moderate
def test_of_a_short_record_the_power_is_known_as_surely_as_is_said():
    """Of 5,000 samples a floor is known to 4 % and not to a twentieth of its power three times over."""
    short = 5000
    found = []
    for seed in range(300):
        series = np.random.default_rng(seed).standard_normal((short, 2))
        predicted = np.full((short, 2), SIGMA)
        found.append(power_over_prediction(predicted, (SIGMA, SIGMA), series, 0, RATE, RESONANCE))
    power, deviation = np.array(found).T
    assert np.std(power) == pytest.approx(np.mean(deviation), rel=0.2)
    # The power itself scatters as χ² over its degrees of freedom: the floor of one axis by as much more.
    count = int(np.sum(quiet_bins(periodogram(series, RATE, RESONANCE).frequency, RATE, RESONANCE)))
    of_one_axis = floor_deviation(count) ** 2 - chi2(short).var() / short**2
    assert deviation == pytest.approx(np.sqrt(of_one_axis / 2.0), rel=1e-9)
    assert np.mean(power - 1.0 > 0.05) > 0.05  # a twentieth above the floor is usual there
    assert np.mean(power - 1.0 > 2.326 * deviation) < 0.04


@pytest.mark.moderate
@pytest.mark.parametrize(("deviation", "told"), [(0.0, True), (0.025, True), (0.0265, False)])
def test_what_chance_makes_of_the_floor_is_not_told(monkeypatch, deviation, told):
    """A power of 1.06 where one in a hundred lies 2.326 deviations above 1."""
    monkeypatch.setattr(judgement, "power_over_prediction", lambda *given: (1.06, deviation))
    assert bool(said(white())) is told


@pytest.mark.moderate
def test_all_is_judged_in_cycles_of_the_resonance(monkeypatch):
    """Eight of 19.9 samples are left to the start, four are asked about the past."""
    asked = {}

    def steady(innovation, deviation, first, cycle):
        asked["steadied"] = first, cycle
        return white()[first:]

    def power(deviation, noise, series, first, sample_rate, resonance_hz):
        asked["power"] = len(series), first, sample_rate, resonance_hz
        return 1.0, 0.0

    monkeypatch.setattr(judgement, "steadied", steady)
    monkeypatch.setattr(judgement, "power_over_prediction", power)
    monkeypatch.setattr(judgement, "predictable_share", lambda series, lags: asked.setdefault("lags", lags) * 0.0)
    assert left(model(white()), 201.0) == ()
    assert asked == {
        "steadied": (8 * 19, 19), "power": (N - 8 * 19, 8 * 19, pytest.approx(RATE), 201.0), "lags": 4 * 19
    }  # fmt: skip


def test_around_a_jump_of_the_rate_innovations_are_brought_down_to_three_times_the_usual_power():
    series = np.where(np.arange(2 * N).reshape(N, 2) % 2, 1.0, -1.0)
    series[30_000:30_400] *= 10.0
    left = model(series).estimates
    level = np.mean(steadied(left.innovation, left.innovation_deviation, 0, CYCLE) ** 2, axis=1)
    assert level[30_200] == pytest.approx(3.0)
    assert level[20_000] == pytest.approx(1.0)


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("share", "says"), [(0.5, "50.0%"), (0.999, "99.9%"), (1.0, "nearly all"), (1.2, "nearly all")]
)
def test_how_much_can_be_predicted_is_told_as_a_share(monkeypatch, share, says):
    monkeypatch.setattr(judgement, "predictable_share", lambda series, lags: share)
    assert said(white())[0] == f"{says} of the innovation can be predicted from those before"


def test_an_autocorrelation_is_about_the_mean_and_does_not_turn_round() -> None:
    """Its products written out."""
    series = np.array([6.0, 6.0, 4.0])
    centred = series - 16.0 / 3.0
    products = [centred @ centred, centred[:-1] @ centred[1:], centred[0] * centred[2]]
    np.testing.assert_allclose(autocorrelation(series), np.array(products) / products[0], atol=1e-12)
    np.testing.assert_array_equal(autocorrelation(np.full(4, 3.0)), np.zeros(4))


def test_what_follows_from_the_past_is_told_of_each_axis_and_meant_over_them() -> None:
    """Of (1, −1, 1, −1) with ρ₁ = −3/4, ρ₂ = 1/2, and of one that is constant, whose ρ are 0; less a quarter each."""
    series = np.stack([[1.0, -1.0, 1.0, -1.0], [2.0] * 4], axis=1)
    assert predictable_share(series, 2) == pytest.approx(((9.0 + 4.0) / 16.0 - 2 * 0.25 - 2 * 0.25) / 2.0)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_a_series_with_memory_is_worth_fewer_samples(rho):
    """(1 − ρ)/(1 + ρ) of them."""
    from scipy.signal import lfilter

    series = lfilter([1.0], [1.0, -rho], white()[:, 0])
    assert effective_samples(series + 7.0) == pytest.approx(N * (1.0 - rho) / (1.0 + rho), rel=0.1)


def test_a_series_is_worth_four_samples_at_least_and_all_of_them_at_most():
    assert effective_samples(np.sin(np.linspace(0.0, 3.0, 500))) == pytest.approx(4.0, abs=1.0)
    assert effective_samples(np.where(np.arange(500) % 2, 1.0, -1.0)) == 500.0
    assert effective_samples(np.ones(500)) == 500.0
