"""The residual's analysis against series whose content is known, against scipy, and against chance."""

import math

import numpy as np
import pytest
from scipy import stats

from estimator.diagnosis import Finding
from estimator.record import Record
from estimator.residual import floor, spectrum, whiteness
from estimator.residual.analysis import FALSE_ALARM, analyse
from estimator.residual.significance import deviations, of_many

RATE, RESONANCE, NOISE = 4000.0, 200.0, 9e-5


def record_of(innovation: np.ndarray, seed: int, **channels: np.ndarray) -> Record:
    n, axes = innovation.shape
    drive = np.random.default_rng([seed, 1]).standard_normal((n, axes, 1))
    return Record(innovation, drive, np.full(n, 1 / RATE), channels)


def white(n: int, axes: int, seed: int) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).standard_normal((n, axes))


def findings(innovation: np.ndarray, seed: int = 0, **channels: np.ndarray) -> tuple[Finding, ...]:
    n, axes = innovation.shape
    deviation = np.full((n, axes), NOISE)
    _, found = analyse(innovation, deviation, record_of(innovation, seed, **channels), RESONANCE)
    return found


def only(found: tuple[Finding, ...], kind: str) -> list[Finding]:
    return [finding for finding in found if finding.kind == kind]


# -- chance ----------------------------------------------------------------------------------------------------------


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("axes", [1, 2])
def test_white_noise_raises_no_more_alarms_than_stated(axes: int) -> None:
    seeds = 100
    alarms = sum(bool(findings(white(6000, axes, seed), seed)) for seed in range(seeds))
    assert alarms <= stats.binom.ppf(0.9999, seeds, FALSE_ALARM)


@pytest.mark.slow
def test_the_test_of_whiteness_has_the_chance_it_states() -> None:
    series = [white(700, 2, seed) for seed in range(400)]
    portmanteau = [whiteness.portmanteau(one, 30).p for one in series]
    assert stats.kstest(portmanteau, "uniform").pvalue > 1e-3


# -- pieces against scipy --------------------------------------------------------------------------------------------


def test_portmanteau_is_that_of_ljung_and_box() -> None:
    series = np.random.default_rng(3).standard_normal(500)
    n, centred = len(series), series - series.mean()
    r = [centred[k:] @ centred[:-k] / (centred @ centred) for k in range(1, 16)]
    q = n * (n + 2) * sum(value**2 / (n - k) for k, value in enumerate(r, 1))
    found = whiteness.portmanteau(series, 15)
    assert found.statistic == pytest.approx(q)
    assert found.p == pytest.approx(stats.chi2.sf(q, 15))


def test_portmanteau_leaves_gaps_out() -> None:
    series = white(4000, 1, 2)[:, 0]
    series[np.random.default_rng(4).random(4000) < 0.2] = np.nan
    assert whiteness.portmanteau(series, 40).p > 1e-3
    assert whiteness.portmanteau(np.convolve(white(4000, 1, 2)[:, 0], [1, 0.3], "same"), 40).p < 1e-9


def test_deviations_are_those_of_the_normal_distribution_far_into_the_tail() -> None:
    for z in (1.0, 5.0, 30.0, 300.0):
        assert deviations(float(stats.norm.logsf(z))) == pytest.approx(z, rel=1e-6)
    assert of_many(math.log(1e-4), 100) == pytest.approx(math.log(1 - (1 - 1e-4) ** 100))
    assert of_many(-500.0, 100) == pytest.approx(-500.0 + math.log(100))


# -- what is in it is found ------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_level_of_white_noise_is_its_rms() -> None:
    noise = white(40000, 2, 1)
    fit, found = analyse(noise, np.full(noise.shape, NOISE), record_of(noise, 1), RESONANCE)
    assert fit.innovation_rms == pytest.approx(np.sqrt(np.mean(noise**2, axis=0)))
    assert fit.noise_floor == pytest.approx((NOISE, NOISE), rel=0.03)
    assert fit.ratio == pytest.approx(1.0, abs=0.03)
    assert found == ()


@pytest.mark.moderate
@pytest.mark.parametrize(("axes", "frequency"), [(1, 731.37), (2, 50.13), (2, 1903.1)])
def test_a_line_is_found_where_it_is_and_as_large_as_it_is(axes: int, frequency: float) -> None:
    series = white(20000, axes, 4)
    series[:, -1] += 1.2e-5 * np.sin(2 * np.pi * frequency * np.arange(20000) / RATE + 1.0)
    periodogram = spectrum.periodogram(series, RATE, RESONANCE)
    (line,) = spectrum.lines(periodogram, RATE, RESONANCE, 1e-3)
    assert line.frequency == pytest.approx(frequency, abs=0.2 * periodogram.spacing)
    assert line.rms == pytest.approx(1.2e-5 / math.sqrt(2), rel=0.3)
    assert line.order is None
    (finding,) = only(findings(series), "line")
    assert f"{frequency:.0f}" in finding.text
    assert "not a multiple" in finding.text


@pytest.mark.moderate
def test_an_innovation_above_its_floor_is_told_with_what_is_above() -> None:
    """A line of as much power as the noise. The square of an rms of n samples of two axes is off by √(2/2n), that of a
    floor by twice its own uncertainty.
    """
    n, series = 20000, white(20000, 2, 4)
    series += math.sqrt(2.0) * NOISE * np.sin(2 * np.pi * 731.37 * np.arange(n) / RATE)[:, None]
    deviation = np.full(series.shape, NOISE)
    fit, found = analyse(series, deviation, record_of(series, 0), RESONANCE)
    (level,) = only(found, "level")
    unsure = floor.noise_floor(spectrum.periodogram(series, RATE, RESONANCE), deviation, RATE, RESONANCE).uncertainty
    assert level.text.startswith(f"the innovation is {fit.ratio:.3g} × the noise floor")
    assert fit.ratio == pytest.approx(math.sqrt(2.0), rel=0.02)
    assert level.size == pytest.approx(NOISE, rel=0.1)  # as of one axis
    (white_,) = only(found, "whiteness")
    assert white_.size == pytest.approx(math.sqrt(np.mean(np.square(fit.innovation_rms))))
    assert level.significance == pytest.approx(
        (fit.ratio**2 - 1.0) / math.hypot(math.sqrt(1.0 / n), 2.0 * unsure), rel=0.01
    )


@pytest.mark.moderate
def test_harmonics_and_their_sidebands_are_told_by_their_order() -> None:
    t = np.arange(20000) / RATE
    series = white(20000, 2, 5)
    series[:, 0] += 4e-5 * np.sin(2 * np.pi * 3 * RESONANCE * t) * np.cos(6.0 * t)
    found = only(findings(series), "line")
    assert [finding.text.startswith("around 3 × the resonance") for finding in found] == [True]
    assert "2 lines" in found[0].text
    assert found[0].size == pytest.approx(2e-5 / math.sqrt(2.0), rel=0.3)  # over both axes, of which one has it


def test_a_harmonic_beyond_half_the_rate_is_found_where_it_folds_to() -> None:
    rate, resonance = 4000.0, 900.0
    t = np.arange(20000) / rate
    series = white(20000, 1, 6) + 1e-5 * np.sin(2 * np.pi * 3 * resonance * t)[:, None]
    (line,) = spectrum.lines(spectrum.periodogram(series, rate, resonance), rate, resonance, 1e-3)
    assert line.order == 3
    assert line.frequency == pytest.approx(1300.0, abs=0.1)


def test_a_broad_hump_around_a_multiple_is_found_without_any_line() -> None:
    """As much again as the floor, over 15 Hz around 2 ω: no bin stands out."""
    n = 80000
    rng = np.random.default_rng(8)
    hump = np.fft.rfft(rng.standard_normal(n))
    frequency = np.fft.rfftfreq(n, 1 / RATE)
    hump[np.abs(frequency - 2 * RESONANCE) > 7.5] = 0.0
    series = white(n, 1, 9)[:, 0] + NOISE * np.fft.irfft(hump, n)
    around = {
        band.order: band
        for band in spectrum.bands(spectrum.periodogram(series[:, None], RATE, RESONANCE), RATE, RESONANCE)
    }
    assert deviations(around[2].log_p) > 5.0
    assert all(deviations(around[order].log_p) < 4.0 for order in (0, 1, 3, 4, 5))


def test_the_floor_is_not_moved_by_what_stands_on_it() -> None:
    t = np.arange(40000) / RATE
    series = white(40000, 2, 10)
    series += (40 * NOISE * np.sin(2 * np.pi * RESONANCE * t) + 3 * NOISE * np.sin(6 * np.pi * RESONANCE * t))[:, None]
    found = floor.noise_floor(
        spectrum.periodogram(series, RATE, RESONANCE), np.full(series.shape, 7 * NOISE), RATE, RESONANCE
    )
    assert found.rms == pytest.approx([NOISE, NOISE], rel=0.03)


def test_the_floor_of_a_short_record_is_the_declared_one() -> None:
    series = white(100, 1, 10)
    found = floor.noise_floor(
        spectrum.periodogram(series, RATE, RESONANCE), np.full(series.shape, 7 * NOISE), RATE, RESONANCE
    )
    assert found.rms == pytest.approx([7 * NOISE])
    assert "declared" in found.source


def test_repeats_of_the_drive_tell_the_noise_of_the_sense() -> None:
    random = np.random.default_rng(13)
    drive = np.tile(random.standard_normal((500, 1)), (6, 1))
    response = np.convolve(drive[:, 0], np.exp(-np.arange(80) / 15.0), "full")[:3000]
    sense = (response + 0.01 * random.standard_normal(3000))[:, None]
    assert floor.repeated_noise(sense, drive) == pytest.approx([0.01], rel=0.06)
    assert floor.repeated_noise(sense, random.standard_normal((3000, 1))) is None
    assert floor.repeated_noise(sense, np.zeros((3000, 1))) is None


def test_short_repeats_are_not_quiet_by_chance() -> None:
    random = np.random.default_rng(5)
    drive = np.tile([[1.0], [0.0], [-1.0], [0.0]], (2500, 1))
    sense = drive + 0.01 * random.standard_normal(drive.shape)
    assert floor.repeated_noise(sense, drive) == pytest.approx([0.01], rel=0.06)


@pytest.mark.moderate
def test_gaps_are_no_findings() -> None:
    series = white(20000, 2, 14)
    series[np.random.default_rng(15).random(20000) < 0.01] = np.nan
    assert findings(series) == ()


@pytest.mark.moderate
def test_what_follows_a_gap_is_not_held_against_the_model() -> None:
    """Where the observer knows that it does not know, a large innovation is expected."""
    n = 20000
    series, deviation = white(n, 2, 16), np.full((n, 2), NOISE)
    series[5000:5020] *= 100.0
    deviation[5000:5020] *= 100.0
    _, found = analyse(series, deviation, record_of(series, 16), RESONANCE)
    assert [finding.kind for finding in found if finding.kind != "level"] == []
