"""The closing scan beside independent sources: least squares, the emulator's truth, scatter over seeds."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.stats import chi2, multivariate_normal

from benchmarks.lockstep import Bench, ClosedLoop, Scenario, bench_of, close_loop, scenario_of
from estimator.completeness.answer import Completeness, Outcome
from estimator.completeness.closing import Limits, closing_scan, turning_of
from estimator.completeness.information import Information, ScannedCoefficient
from estimator.completeness.stretch import Stretch, joined, stretches_of
from estimator.completeness.turning import INSTANTS
from estimator.errors import ModelError
from estimator.gaps import Drives, Gaps
from estimator.record import Record
from estimator.settings import ControllerSettings
from estimator.trace.experiments import EXPERIMENTS, loop_record
from estimator.trace.filtered import Filtered
from estimator.trace.fit import at
from estimator.trace.likelihood import Model
from estimator.trace.problem import Problem
from estimator.trace.score_test import score_test
from hil.inputs.declared import device_of, observer_settings_of
from tests.estimator.test_scan import DEVICE, SETTINGS

SETTLE_S = 5.0
SAMPLES = 60_000  # 15 s


def bench() -> Bench:
    """S-slow."""
    return bench_of("s-slow")


@cache
def loop(*effects: tuple[str, tuple[tuple[str, float], ...]], samples: int = SAMPLES) -> ClosedLoop:
    """S-slow in lockstep, with effects that its bench file does not know."""
    table = scenario_of("s-slow").model_dump()
    table["effect"] = [{"name": name, **dict(given)} for name, given in effects]
    return close_loop(Scenario.model_validate(table), bench(), samples, seed=1)


def record_of(run: ClosedLoop) -> Record:
    """What was recorded of it, SI."""
    scenario = scenario_of("s-slow")
    volts = 2.0 * scenario.sense.adc_full_scale_V / 2**scenario.sense.adc_bits
    force = scenario.drive.full_scale_mps2 / 2 ** (scenario.drive.dac_bits - 1)
    step = np.full(len(run.capture), 1.0 / run.sample_rate_Hz)
    return Record(run.capture[:, 1:3] * volts, (run.capture[:, 3:5] * force)[:, :, None], step)


def scanned(record: Record, *, limit_rad: float = 0.0, open_loop: bool = False, **declared: float) -> Completeness:
    """The closing scan of a record of S-slow."""
    controller = ControllerSettings(
        latency=1, force_quantum=1.0, force_limit=10.0, sense_quantum=1.0,
        virtual_rotation=bench().controller.virtual_rotation_rad_s,
    )  # fmt: skip
    stretches = [Stretch(record.part(rows), 0.0, rows.start == 0) for rows in stretches_of(len(record))]
    return closing_scan(
        stretches, device_of(bench()), observer_settings_of(bench()), None if open_loop else controller,
        scored_s=(SETTLE_S, float(np.sum(record.step))), limits=Limits(limit_rad), declared=declared,
    )  # fmt: skip


def angle_error(run: ClosedLoop) -> np.ndarray:
    """Reported less true rotation over the scored window, zero at its start, rad; what the bench said in the run."""
    true = np.cumsum(run.truth["rate_rad_s"]) / run.sample_rate_Hz
    error = run.estimates["angle_rad"] - true[run.tick]
    scored = run.tick / run.sample_rate_Hz >= SETTLE_S
    return np.asarray((error - error[scored][0])[scored])


MISSING = {
    "drive_gain": (("drive_gain", (("hx", 0.01), ("hy", 0.01))), {"hx": 0.01, "hy": 0.01}),
    "sense_gain": (("sense_gain", (("gy", 0.007),)), {"gy": 0.007}),
    "sense_cross_coupling": (("sense_cross_coupling", (("ex", 0.006), ("ey", 0.003))), {"ex": 0.006, "ey": 0.003}),
    "drive_delay": (("drive_delay", (("tux", 5e-6), ("tuy", 2e-6))), {"tux": 5e-6, "tuy": 2e-6}),
    "drive_misalignment": (("drive_misalignment", (("mx", 0.01), ("my", -0.005))), {"mx": 0.01, "my": -0.005}),
}
LARGE = {"cubic_stiffness": (("cubic_stiffness", (("k3x", 1e13), ("k3y", 3e12))), {"k3x": 1e13, "k3y": 3e12})}
"""Turns the angle by another figure than its derivative says."""


@pytest.mark.beyond(1)
@pytest.mark.slow
@pytest.mark.parametrize("name", [*MISSING, "cubic_stiffness"])
def test_a_run_says_what_it_lacks_and_what_that_does_to_the_angle(name: str) -> None:
    effect, true = (MISSING | LARGE)[name]
    found = scanned(record_of(loop(effect)))
    assert found.outcome is Outcome.LACKS
    assert found.lacks[0].effect == name or name in found.lacks[0].alike
    for symbol, value in true.items():
        if found.lacks[0].effect == name:
            interval = found.lacks[0].coefficients[symbol]
            assert abs(interval.value - value) < max(2.0 * (interval.high - interval.low), 0.02 * abs(value))
    really = float(np.max(np.abs(angle_error(loop(effect)))))
    said, spare = found.lacks[0].angle, 0.05 * really + 0.004  # what is not linear, and the clean run's own error
    assert said.low - spare < really < said.high + spare
    assert said.high - said.low < 0.5 * really


@pytest.mark.beyond(1)
@pytest.mark.long
@pytest.mark.parametrize("name", MISSING)
def test_the_sensitivity_is_the_emulated_angle_error_sign_included(name: str) -> None:
    effect, true = MISSING[name]
    information = scanned(record_of(loop(effect))).information
    assert information is not None
    moved = information.sensitivity[:, information.columns(list(true))] @ np.array(list(true.values()))
    off = angle_error(loop(effect)) - angle_error(loop())[: len(angle_error(loop(effect)))]
    times = loop(effect).tick / loop(effect).sample_rate_Hz
    at = np.interp(information.time, times[times >= SETTLE_S], off)
    # Carried, the effect would be taken off the angle: it moves by what it is off, the other way.
    assert np.sqrt(np.mean((moved + at) ** 2)) < 0.05 * np.sqrt(np.mean(at**2)) + 0.003


OFF = {"hx": 0.009, "hy": -0.012, "mx": 0.003, "my": -0.0015, "gy": 0.006, "ex": -0.002, "ey": 0.003}
"""Of about the standard uncertainties that are assumed, each a device's own."""


@pytest.mark.slow
def test_a_device_as_it_is_declared_is_called_by_no_other_name() -> None:
    """Gains, misalignment and cross-coupling off at once: no single effect explains that, and what comes nearest is not
    there.  With what the calibration declares of them, the constants do.
    """
    effects = {"drive_gain": ("hx", "hy"), "drive_misalignment": ("mx", "my"), "sense_gain": ("gy",)}
    effects["sense_cross_coupling"] = ("ex", "ey")
    run = loop(*((name, tuple((s, OFF[s]) for s in symbols)) for name, symbols in effects.items()))
    declared = {"hx": 0.01, "hy": 0.01, "mx": 0.002, "my": 0.002, "gy": 0.005, "ex": 0.002, "ey": 0.002}
    found = scanned(record_of(run), limit_rad=100.0, **declared)
    assert {item.effect for item in found.harmless} == set(effects), found.reason
    for item in found.harmless:
        for symbol, interval in item.coefficients.items():
            half = interval.high - interval.value
            assert abs(interval.value - OFF[symbol]) < 2.0 * half  # twice a 95 % interval
            assert half <= 1.97 * declared[symbol]
    really = float(abs(angle_error(run)[-1]))  # what is harmless counts at the end, as the budget does
    size = math.sqrt(sum(item.angle.value**2 for item in found.harmless))
    half = math.sqrt(sum((item.angle.high - item.angle.value) ** 2 for item in found.harmless))
    assert abs(really - size) < half + 0.1 * really


ASSUMED = {"hx": 0.01, "hy": 0.01, "mx": 0.002, "my": 0.002, "gy": 0.005, "ex": 0.002, "ey": 0.002}
ASSUMED |= {"tsx": 8e-7, "tsy": 8e-7, "tux": 8e-7, "tuy": 8e-7}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "true"),
    [("sense_delay", {"tsx": 1e-4, "tsy": 1e-4}), ("sense_gain", {"gy": 0.1})],
)
def test_a_constant_far_beyond_what_is_declared_is_not_shared_out(effect: str, true: dict[str, float]) -> None:
    """A channel late by half a sample is no half of a sense delay and half of a drive delay."""
    run = loop((effect, tuple(true.items())), samples=30_000)
    (lacks,) = scanned(record_of(run), **ASSUMED).lacks
    assert effect in (lacks.effect, *lacks.alike)
    for symbol, value in zip(lacks.coefficients, true.values(), strict=True):
        assert lacks.coefficients[symbol].low < value < lacks.coefficients[symbol].high
    assert lacks.angle.value == pytest.approx(np.max(np.abs(angle_error(run))), rel=0.05)


@pytest.mark.slow
def test_two_constants_far_beyond_what_is_declared_get_no_interval() -> None:
    run = loop(("sense_gain", (("gy", 0.1),)), ("drive_misalignment", (("mx", 0.02), ("my", 0.0))), samples=30_000)
    found = scanned(record_of(run), **ASSUMED)
    assert (found.outcome, found.lacks) == (Outcome.LACKS, ())
    assert "other constants of the calibration off by more than is declared" in found.reason


@pytest.mark.slow
@pytest.mark.parametrize("coupling", [6e12, -2e12])
def test_what_a_score_test_cannot_reach_gets_no_name_and_no_interval(coupling: float) -> None:
    """A coupling x y², x² y, an isotropic cubic spring less one of each axis: a cubic spring alone takes up nearly all
    of the residual, and leaves far more than the noise.
    """
    less = ("cubic_stiffness", (("k3x", -coupling), ("k3y", -coupling)))
    found = scanned(record_of(loop(("cubic_isotropic", (("k3", coupling),)), less, samples=20_000)))
    assert found.outcome is Outcome.LACKS
    assert found.lacks == ()
    assert found.reason.startswith("something is missing that no effect explains by itself: ")
    assert "hil trace" in found.reason
    assert "±" not in found.reason


@pytest.mark.long
def test_a_clean_run_is_complete() -> None:
    found = scanned(record_of(loop()))
    assert found.outcome is Outcome.COMPLETE, found.reason
    assert found.information is not None
    left = [found.information.posterior({}, effect).angle_uncertainty for effect in found.information.effects]
    assert np.max(left) < 0.05


@pytest.mark.long
def test_what_hardly_moves_the_angle_is_told_and_not_held_against_the_run() -> None:
    effect, _ = MISSING["sense_gain"]
    found = scanned(record_of(loop(effect)), limit_rad=10.0)
    assert found.outcome is Outcome.COMPLETE
    assert found.harmless[0].effect == "sense_gain"
    assert "sense_gain" in found.reason


@pytest.mark.long
def test_lost_samples_are_no_effect() -> None:
    record = record_of(loop())
    lost = np.random.default_rng(3).random(len(record)) < 0.01
    holed = replace(record, sense=np.where(lost[:, None], np.nan, record.sense))
    assert scanned(holed).outcome is Outcome.COMPLETE


def with_gaps(record: Record, longest: int) -> Record:
    """A tenth of the rows lost with their drives, in runs of 5 to `longest`, or one by one."""
    rng, n = np.random.default_rng(5), len(record)
    known = rng.random(n) > 0.1 if longest == 1 else np.ones(n, bool)
    while np.mean(~known) < 0.1:
        begin = int(rng.integers(100, n - 100))
        known[begin : begin + int(rng.integers(5, longest + 1))] = False
    known[[0, -1]] = True
    sense, drive = np.where(known[:, None], record.sense, np.nan), record.drive[:, :, 0]
    omega, step = float(np.sqrt(device_of(bench()).target)), float(record.step[0])
    drives = Drives(sense, drive, known, omega=omega, step=step, gain=1.0)
    drive, gap = drives.fill(sense, np.where(known[:, None], drive, 0.0), known)
    last = np.flatnonzero(gap)
    return replace(record, sense=sense, drive=drive[:, :, None], gaps=Gaps(last, drives.spread(gap[last])))


@pytest.mark.beyond(1)
@pytest.mark.long
@pytest.mark.parametrize("longest", [1, 50])
def test_a_clean_device_is_not_accused_over_gaps_of_unknown_drive(longest: int) -> None:
    holed = with_gaps(record_of(loop()), longest)
    assert scanned(holed).outcome is Outcome.COMPLETE
    # Not told of the gaps, the scan accuses it: that is what this test would be blind to.
    assert longest == 1 or scanned(replace(holed, gaps=None)).outcome is Outcome.LACKS


@pytest.mark.beyond(1)
@pytest.mark.long
@pytest.mark.parametrize("longest", [1, 50])
@pytest.mark.parametrize("name", ["drive_gain", "sense_gain"])
def test_what_is_lacking_is_found_over_gaps_of_unknown_drive(name: str, longest: int) -> None:
    effect, true = MISSING[name]
    if name == "drive_gain":
        effect, true = ("drive_gain", (("hx", 0.02), ("hy", 0.02))), {"hx": 0.02, "hy": 0.02}
    found = scanned(with_gaps(record_of(loop(effect)), longest))
    assert found.outcome is Outcome.LACKS
    assert found.lacks[0].effect == name
    for symbol, value in true.items():
        interval = found.lacks[0].coefficients[symbol]
        assert abs(interval.value - value) < max(2.0 * (interval.high - interval.low), 0.02 * abs(value))


@pytest.mark.slow
@pytest.mark.parametrize("samples", [0, 3, 150, 1999])
def test_a_short_record_is_unknown_with_its_reason(samples: int) -> None:
    found = scanned(record_of(loop()).part(slice(0, samples)))
    assert found.outcome is Outcome.UNKNOWN
    assert "too few" in found.reason


@pytest.mark.slow
@pytest.mark.parametrize("what", ["dead", "noise", "nan", "infinite"])
def test_a_record_of_nothing_is_no_traceback(what: str) -> None:
    record = record_of(loop()).part(slice(0, 20_000))
    noise = 1e-4 * np.random.default_rng(0).standard_normal(record.sense.shape)
    sense = {"dead": 0.0 * noise, "noise": noise, "nan": np.nan * noise, "infinite": np.inf * noise}[what]
    found = scanned(replace(record, sense=sense))
    assert found.outcome is not Outcome.COMPLETE
    assert found.reason


@pytest.mark.slow
def test_an_open_loop_has_no_drive_to_be_judged() -> None:
    record = record_of(loop()).part(slice(0, 20_000))
    still = replace(record, drive=np.zeros_like(record.drive))
    found = scanned(still, open_loop=True)
    if found.information is not None:
        assert not found.information.watches("hx") or np.all(
            found.information.normal[:, found.information.columns(["hx"])] == 0.0
        )


@pytest.mark.slow
def test_estimates_scatter_over_seeds_as_the_information_says() -> None:
    everything = next(experiment for experiment in EXPERIMENTS if experiment.name == "all")
    watched = {name: {} for name in ("drive_gain", "sense_gain", "sense_delay", "cubic_stiffness")}
    clean = loop_record(everything, DEVICE, SETTINGS, latency=1, noise=0.0)
    chi_squared, degrees, seeds = 0.0, 0, 25
    for seed in range(seeds):
        noise = np.random.default_rng(seed).standard_normal(clean.sense.shape) * np.array(DEVICE.noise)
        of = Filtered(Problem(replace(clean, sense=clean.sense + noise), DEVICE, SETTINGS))
        layout = of.layout({})
        for score in score_test(of, at(of, layout, Model({}, layout.mean, of.declared_noise())), watched):
            chi_squared += score.gain
            degrees += len(score.size)
    low, high = chi2.ppf([0.005, 0.995], degrees)
    assert low * 0.85 < chi_squared < high * 1.15  # four effects of one record are not independent


def information(k: int, seed: int) -> tuple[Information, np.ndarray, np.ndarray]:
    """Of a linear model y = A c + noise of deviation 1 with k coefficients; A (n, k) and the data behind."""
    random = np.random.default_rng(seed)
    a, data = random.standard_normal((50, k)), random.standard_normal(50)
    coefficients = tuple(ScannedCoefficient(f"effect{i // 2}", f"c{i}", "1", 1.0) for i in range(k))
    # An innovation loses what is carried: its sensitivity is −A, the data its value.
    found = Information(coefficients, a.T @ a, -a.T @ data, np.arange(3.0), random.standard_normal((3, k)))
    return found, a, data


def test_the_posterior_is_least_squares_with_priors_as_measurements() -> None:
    found, a, data = information(4, 1)
    prior = {"c0": 0.05, "c1": 0.5, "c3": 2.0}
    places = [0, 1, 3]
    rows = np.vstack([a[:, places], np.diag([1.0 / sd for sd in prior.values()])])
    solved = lsq_linear(rows, np.concatenate([data, np.zeros(3)]))
    posterior = found.posterior(prior)
    assert posterior.mean == pytest.approx(solved.x, rel=1e-6)
    assert posterior.covariance == pytest.approx(np.linalg.inv(rows.T @ rows), rel=1e-9)
    g = found.sensitivity[:, places]
    assert posterior.angle_deviation == pytest.approx(np.sqrt(np.diag(g @ np.linalg.inv(rows.T @ rows) @ g.T)))


def test_what_is_known_exactly_stays_so_and_look_alikes_share_their_priors() -> None:
    found, _, _ = information(2, 2)
    assert found.posterior({"c0": 0.0, "c1": 1.0}).deviation[0] == 0.0
    alike = replace(found, normal=1e8 * np.ones((2, 2)), score=np.zeros(2))
    posterior = alike.posterior({"c0": 0.01, "c1": 0.01})
    assert posterior.deviation == pytest.approx(0.01 / np.sqrt(2.0), rel=1e-3)
    assert posterior.covariance[0, 1] == pytest.approx(-posterior.covariance[0, 0], rel=1e-3)


def test_an_unknown_symbol_is_refused_by_name() -> None:
    found, _, _ = information(2, 2)
    with pytest.raises(ModelError, match="zz"):
        found.columns(["zz"])
    assert found.posterior({"zz": 1.0}).symbols == ()


def test_a_course_goes_on_with_its_mean_slope_where_nobody_looked() -> None:
    times = [np.linspace(2.0, 3.0, 11), np.linspace(7.0, 8.0, 11)]
    courses = [(times[0] * 2.0)[:, None], (times[1] * 4.0)[:, None]]
    time, course = joined(times, courses, 0.0, 10.0)
    assert time[0] == 0.0
    assert time[-1] == 10.0
    assert course[0, 0] == 0.0
    assert course[-1, 0] == pytest.approx(2.0 * 3.0 + 3.0 * 4.0 + 4.0 * 3.0)


def test_a_long_run_is_looked_at_in_its_beginning_its_middle_and_its_end() -> None:
    parts = stretches_of(6_000_000)
    assert parts[0].start == 0
    assert parts[-1].stop == 6_000_000
    assert sum(part.stop - part.start for part in parts) <= 120_000
    assert stretches_of(96_000) == (slice(0, 96_000),)


def test_the_angle_counts_in_the_scored_window_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 200 kS/s the first stretch ends before the observer has settled: what turns the angle in it does not count."""
    asked: list[float] = []

    def scanned(problem: Problem, _: object) -> tuple[dict[str, slice], np.ndarray]:
        begin_s = float(problem.record.sense[0, 0])  # as told below
        asked.append(begin_s)
        course = begin_s + np.linspace(0.0, 1.0, INSTANTS)[:, None]
        wild = 1e6 * (begin_s == 0.0)
        return {"drive_gain": slice(0, 1)}, (2.0 + wild) * course

    monkeypatch.setattr("estimator.completeness.closing.followed", scanned)
    step = np.full(4000, 1.0 / 4000.0)
    stretches = [
        Stretch(Record(np.full((4000, 2), begin), np.zeros((4000, 2)), step), begin, begin == 0.0)
        for begin in (0.0, 5.0, 9.0)
    ]
    settings = replace(observer_settings_of(bench()), memory=0.1)
    turning = turning_of(stretches, Problem(stretches[0].record, device_of(bench()), settings, None), {}, (2.0, 10.0))
    assert asked == [5.0, 9.0]
    assert np.all(np.diff(turning.time) > 0.0)
    assert (turning.time[0], turning.sensitivity[0, 0]) == (2.0, 0.0)
    assert turning.sensitivity[-1, 0] == pytest.approx(2.0 * 8.0, rel=1e-2)


def test_what_nobody_declared_is_a_mean_over_what_may_be_there() -> None:
    """By Bayes' rule on the data themselves: each effect and size by its marginal likelihood, a normal density, and by
    what it then does to the angle; none as probable beforehand as all together.
    """
    found, a, data = information(6, 4)
    found = replace(found, found=np.array([0.0, 1.0, 2.0]))
    prior = {"c0": 0.1, "c1": 0.1}

    def account(places: list[int], sd: list[float]) -> tuple[float, np.ndarray]:
        """Density of the data, mean square of the angle."""
        of, p0 = a[:, places], np.diag(np.square(sd))
        density = multivariate_normal(np.zeros(50), np.eye(50) + of @ p0 @ of.T).pdf(data)
        covariance = np.linalg.inv(of.T @ of + np.linalg.inv(p0))
        mean, g = covariance @ of.T @ data, found.sensitivity[:, places]
        return density, np.einsum("mi,ij,mj->m", g, covariance + np.outer(mean, mean), g)

    none, known = account([0, 1], [0.1, 0.1])
    chances, squares = [none], [np.zeros(3)]
    for places in ([2, 3], [4, 5]):
        for size in (1.0, 0.1, 0.01, 0.001):
            density, square = account([0, 1, *places], [0.1, 0.1, size, size])
            chances.append(0.5 * 0.25 * density)
            squares.append(np.maximum(square - known, 0.0))
    expected = np.einsum("k,km->m", np.array(chances) / sum(chances), np.array(squares))
    effect, course = found.beyond(prior)
    assert effect in ("effect1", "effect2")
    assert course == pytest.approx(np.sqrt(expected + np.array([0.0, 1.0, 4.0])))


def test_what_the_record_excludes_counts_less_than_what_it_says_nothing_of() -> None:
    """One effect, to which the angle is as sensitive; records that say more and more, and none of it for the effect."""
    of = [ScannedCoefficient("effect0", "c0", "1", 1.0)]
    rows = []
    for information_on_it in (0.0, 1e2, 1e4, 1e8):
        normal = np.array([[information_on_it]])
        told = Information(tuple(of), normal, np.zeros(1), np.arange(2.0), np.array([[0.0], [1.0]]))
        rows.append(float(told.beyond({})[1][-1]))
    assert rows[0] == pytest.approx(math.sqrt(0.5 * np.mean(np.square([1.0, 0.1, 0.01, 0.001]))))
    assert np.all(np.diff(rows) < 0.0)
    assert rows[-1] < 1e-4


def test_what_the_score_test_suggests_counts_nearly_whole() -> None:
    """Five deviations from nothing, which chance gives once in two million: its posterior, mean and all."""
    normal, score = np.array([[1e4]]), np.array([-5.0 * 1e2])
    told = Information(
        (ScannedCoefficient("effect0", "c0", "1", 1.0),), normal, score, np.arange(2.0), np.array([[0.0], [1.0]])
    )
    assert float(told.beyond({})[1][-1]) == pytest.approx(0.05, rel=0.05)
