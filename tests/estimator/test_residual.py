"""The residual's analysis against series whose content is known, against scipy, and against chance."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy import stats

from estimator.diagnosis import Finding
from estimator.effects.catalogue import EFFECTS
from estimator.effects.search import Sign
from estimator.errors import ModelError
from estimator.observer import Estimates
from estimator.record import Record
from estimator.residual import dependence, floor, spectrum, whiteness
from estimator.residual.analysis import analyse
from estimator.residual.demodulation import demodulate, motion
from estimator.residual.significance import deviations, of_many
from estimator.residual.suspects import suspects
from estimator.thresholds import THRESHOLDS

RATE, RESONANCE, NOISE = 4000.0, 200.0, 9e-5


def vibration(n: int, axes: int) -> Estimates:
    """A modulated vibration whose pattern turns, as an observer would report it at every sample."""
    t = np.arange(n) / RATE
    w = 2 * np.pi * RESONANCE
    amplitude = 1e-4 * (1 + 0.3 * np.sin(2 * np.pi * 1.1 * t))
    theta = 3.0 * t + 0.3 * np.sin(np.pi * t)
    position, velocity = amplitude * np.cos(w * t), -amplitude * w * np.sin(w * t)
    columns = {"x": position * np.cos(theta), "vx": velocity * np.cos(theta)}
    if axes == 2:
        columns |= {"y": position * np.sin(theta), "vy": velocity * np.sin(theta), "rate": 1.0 + np.sin(2.0 * t)}
    state = np.stack(list(columns.values()), axis=1)
    zero, none = np.zeros(n), np.zeros((n, axes))
    still = (field.name for field in fields(Estimates) if field.name.startswith("angle_"))
    return Estimates(
        tuple(columns), np.arange(n), state, 0 * state, none, none,
        angle=theta, energy_ratio=zero, quadrature_ratio=zero, **dict.fromkeys(still, zero),
    )  # fmt: skip


def record_of(innovation: np.ndarray, seed: int, **channels: np.ndarray) -> Record:
    n, axes = innovation.shape
    drive = np.random.default_rng([seed, 1]).standard_normal((n, axes, 1))
    return Record(innovation, drive, np.full(n, 1 / RATE), channels)


def white(n: int, axes: int, seed: int) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).standard_normal((n, axes))


def findings(innovation: np.ndarray, seed: int = 0, **channels: np.ndarray) -> tuple[Finding, ...]:
    n, axes = innovation.shape
    deviation = np.full((n, axes), NOISE)
    _, found, _ = analyse(innovation, deviation, vibration(n, axes), record_of(innovation, seed, **channels), RESONANCE)
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
    assert alarms <= stats.binom.ppf(0.9999, seeds, THRESHOLDS.residual.false_alarm)


@pytest.mark.slow
def test_the_tests_of_whiteness_have_the_chances_they_state() -> None:
    series = [white(700, 2, seed) for seed in range(400)]
    portmanteau = [whiteness.portmanteau(one, 30).p for one in series]
    cumulative = [whiteness.cumulative_periodogram(one[:, 0]).p for one in series]
    assert stats.kstest(portmanteau, "uniform").pvalue > 1e-3
    assert stats.kstest(cumulative, "uniform").pvalue > 1e-3


@pytest.mark.slow
def test_regression_has_the_chances_it_states_under_noise_that_remembers() -> None:
    """Autocorrelated errors and an autocorrelated regressor: ordinary t-values would alarm several times too often."""
    random = np.random.default_rng(5)
    alarms, ordinary, tries = 0, 0, 300
    for _ in range(tries):
        error, regressor = np.zeros(400), np.zeros(400)
        kick = random.standard_normal((2, 400))
        for i in range(1, 400):
            error[i] = 0.5 * error[i - 1] + kick[0, i]
            regressor[i] = 0.8 * regressor[i - 1] + kick[1, i]
        entries = dependence.dependences({"c": error}, {"r": regressor})
        alarms += entries[1].log_p < math.log(0.01)
        ordinary += stats.linregress(regressor, error).pvalue < 0.01
    assert ordinary > 0.05 * tries
    assert alarms < 0.04 * tries


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


def test_cumulative_periodogram_is_kolmogorovs_and_smirnovs() -> None:
    series = np.random.default_rng(7).standard_normal(301)
    power = np.abs(np.fft.rfft(series))[1:] ** 2
    share = np.cumsum(power)[:-1] / power.sum()
    expected = stats.kstest(share, "uniform")
    found = whiteness.cumulative_periodogram(series)
    assert found.statistic == pytest.approx(expected.statistic)
    assert found.p == pytest.approx(expected.pvalue)


def test_deviations_are_those_of_the_normal_distribution_far_into_the_tail() -> None:
    for z in (1.0, 5.0, 30.0, 300.0):
        assert deviations(float(stats.norm.logsf(z))) == pytest.approx(z, rel=1e-6)
    assert of_many(math.log(1e-4), 100) == pytest.approx(math.log(1 - (1 - 1e-4) ** 100))
    assert of_many(-500.0, 100) == pytest.approx(-500.0 + math.log(100))


def test_regression_is_least_squares() -> None:
    random = np.random.default_rng(11)
    regressor, target = random.standard_normal(300), random.standard_normal(300)
    target += 0.4 * regressor
    entry = dependence.dependences({"c": target}, {"r": regressor})[1]
    expected = stats.linregress(regressor, target)
    assert entry.slope == pytest.approx(expected.slope * np.std(regressor))
    assert abs(entry.t) <= 1.0001 * abs(expected.slope / expected.stderr)  # never surer than the ordinary one
    assert dependence.log_tail(4.0, 50) == pytest.approx(math.log(2 * stats.t.sf(4.0, 50)))


def test_a_regressor_that_says_nothing_new_is_left_out() -> None:
    random = np.random.default_rng(12)
    a, target = random.standard_normal(300), random.standard_normal(300)
    entries = dependence.dependences({"c": target}, {"a": a, "again": 2.0 * a + 1.0, "still": np.full(300, 3.0)})
    assert sorted(entry.regressor for entry in entries)[0:2] in (["a", "always"], ["again", "always"])
    assert len(entries) == 2


# -- what is in it is found ------------------------------------------------------------------------------------------


@pytest.mark.moderate
def test_level_of_white_noise_is_its_rms() -> None:
    noise = white(40000, 2, 1)
    fit, found, residual = analyse(
        noise, np.full(noise.shape, NOISE), vibration(len(noise), 2), record_of(noise, 1), RESONANCE
    )
    assert fit.innovation_rms == pytest.approx(np.sqrt(np.mean(noise**2, axis=0)))
    assert fit.noise_floor == pytest.approx((NOISE, NOISE), rel=0.03)
    assert fit.ratio == pytest.approx(1.0, abs=0.03)
    assert found == ()
    power = np.trapezoid(residual.density, residual.frequency, axis=0)
    assert power == pytest.approx(np.var(noise, axis=0), rel=0.02)


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
def test_harmonics_and_their_sidebands_are_told_by_their_order() -> None:
    t = np.arange(20000) / RATE
    series = white(20000, 2, 5)
    series[:, 0] += 4e-5 * np.sin(2 * np.pi * 3 * RESONANCE * t) * np.cos(6.0 * t)
    found = only(findings(series), "line")
    assert [finding.text.startswith("around 3 × the resonance") for finding in found] == [True]
    assert "2 lines" in found[0].text
    assert "cubic_stiffness" in found[0].points_at
    assert found[0].size == pytest.approx(2e-5, rel=0.3)


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
    _, found, _ = analyse(series, deviation, vibration(n, 2), record_of(series, 16), RESONANCE)
    assert [finding.kind for finding in found if finding.kind != "level"] == []


@pytest.mark.moderate
@pytest.mark.parametrize(
    ("sign", "kind", "size"),
    [("amplitude", "amplitude", 4e-6), ("sin 4θ", "orientation", 4e-6), ("rate", "rate", 4e-6)],
)
def test_dependence_on_the_motion_is_found(sign: str, kind: str, size: float) -> None:
    n = 40000
    moving = motion(vibration(n, 2), n, RATE / RESONANCE)
    drivers = {
        "amplitude": (moving.amplitude - moving.amplitude.mean()) / moving.amplitude.std(),
        "sin 4θ": np.sqrt(2) * np.sin(4 * moving.angle),
        "rate": np.sqrt(2) * np.sin(2.0 * np.arange(n) / RATE),
    }
    along = drivers[sign] * size * np.sqrt(2) * moving.phasor.real
    series = white(n, 2, 17)
    series[:, 0] += along * np.cos(moving.angle)
    series[:, 1] += along * np.sin(moving.angle)
    found = [finding for finding in only(findings(series), kind) if sign in finding.text]
    assert len(found) == 1
    assert "in phase with the motion and along it" in found[0].text
    assert found[0].size == pytest.approx(size, rel=0.25)


@pytest.mark.moderate
def test_dependence_on_temperature_is_found() -> None:
    n = 40000
    moving = motion(vibration(n, 1), n, RATE / RESONANCE)
    temperature = 20.0 + 5.0 * np.sin(np.arange(n) / 7000.0)
    series = white(n, 1, 18) + (1e-5 * (temperature - 20.0) / 5.0 * moving.phasor.imag)[:, None]
    (found,) = only(findings(series, temperature=temperature), "temperature")
    assert "in quadrature" in found.text
    assert only(findings(series), "temperature") == []


@pytest.mark.moderate
def test_feedthrough_of_the_drive_is_found() -> None:
    series = white(20000, 2, 19)
    drive = record_of(series, 3).drive[:, :, 0]
    series[:, 1] += 0.05 * NOISE * drive[:, 0]
    (found,) = only(findings(series, 3), "drive")
    assert found.text.startswith("νy follows the drive ux")
    assert found.size == pytest.approx(0.05 * NOISE, rel=0.3)


# -- phase -----------------------------------------------------------------------------------------------------------


def test_demodulation_gives_amplitude_and_phase_along_a_turning_ellipse() -> None:
    n, cycle = 40000, RATE / RESONANCE
    moving = motion(vibration(n, 2), n, cycle)
    across = 3e-6 * moving.phasor.imag
    series = np.stack([-across * np.sin(moving.angle), across * np.cos(moving.angle)], axis=1)
    seen = demodulate(series, moving, cycle).components
    assert abs(np.mean(seen["in quadrature, across"])) == pytest.approx(3e-6, rel=1e-3)
    for name in ("in phase, along", "in quadrature, along", "in phase, across"):
        assert abs(np.mean(seen[name])) < 1e-8


def test_states_every_few_samples_do_as_well_and_too_far_apart_are_refused() -> None:
    full = vibration(8000, 2)
    sparse = replace(full, index=full.index[4::5], state=full.state[4::5], deviation=full.deviation[4::5])
    whole, joined = motion(full, 8000, 20.0), motion(sparse, 8000, 20.0)
    assert np.max(np.abs(whole.phasor - joined.phasor)[10:-10]) < 0.02
    coarse = replace(full, index=full.index[::20], state=full.state[::20], deviation=full.deviation[::20])
    with pytest.raises(ModelError, match="twice a cycle"):
        motion(coarse, 8000, 20.0)


def test_suspects_are_effects_of_the_catalogue_and_every_effect_that_a_record_can_show_is_one() -> None:
    shown = {effect.name for effect in EFFECTS if not (effect.declared_only or effect.rare)}
    assert {name for sign in Sign for name in suspects(sign)} == shown
