"""A second mode that rings by itself: where its search begins, and several decays of two modes in one trace."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator.diagnosis import Diagnosis, Verdict
from estimator.effects.catalogue import EFFECTS
from estimator.effects.search import Search
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, Gain, ObserverSettings, Sensed, Spread
from estimator.trace.pool import Member, Pool
from estimator.trace.pool_trace import trace_pool
from estimator.trace.problem import Problem
from estimator.trace.start_values import rings
from estimator.trace.trace import trace

RATE, SAMPLES, ITSELF = 400.0, 480, 2.0 * np.pi * 20.0
K, D, NOISE = ITSELF**2, 3.0, 1e-4
WM, DM = 2.0 * np.pi * 33.0, 5.0
(NAME,) = (effect.name for effect in EFFECTS if effect.search is Search.RINGS)
T = np.arange(SAMPLES) / RATE


def decaying(omega: float, decay: float, phase: float) -> Array:
    return np.asarray(np.exp(-0.5 * decay * T) * np.cos(omega * T + phase))


def noisy(seed: int, *lines: tuple[float, float, float, float]) -> Array:
    """A residual (n, 1): sizes, frequencies rad/s, rates of decay 1/s, phases."""
    noise = 0.01 * np.random.default_rng(seed).standard_normal(SAMPLES)
    return (noise + sum(size * decaying(*line) for size, *line in lines))[:, None]


def test_lines_are_found_with_how_fast_they_die_away() -> None:
    first, second = (1.0, WM, DM, 0.3), (0.4, 2.6 * ITSELF, 12.0, -1.0)
    found = rings([noisy(1, first, second), noisy(2, (0.6, WM, DM, 2.0), second)], RATE, ITSELF)
    for (omega, decay), (_, true, rate, _) in zip(found[:2], (first, second), strict=True):
        assert abs(omega - true) < 0.5 * rate  # so near, least squares find it
        assert 0.3 * rate < decay < 3.0 * rate


def test_what_the_mode_that_is_modelled_leaves_is_no_other() -> None:
    itself, third = (5.0, 1.02 * ITSELF, DM, 0.0), (3.0, 3.0 * ITSELF, 3.0 * DM, 0.0)
    ((omega, _), *_) = rings([noisy(1, itself, third, (0.2, WM, DM, 1.0))], RATE, ITSELF)
    assert omega == pytest.approx(WM, rel=0.02)


def clear(*lines: tuple[float, float, float, float], level: float = 0.0, samples: int = SAMPLES) -> Array:
    """The same without noise, about a level that stays, over so many samples."""
    return (level + sum(size * decaying(*line) for size, *line in lines))[:samples, None]


def test_the_strongest_line_is_that_with_the_most_power_over_all_residuals() -> None:
    """One shows in one residual alone, the other, smaller, in both: 1 against 0.8² + 0.8²."""
    lone, shared = (1.0, WM, DM, 0.3), (0.8, 2.6 * ITSELF, DM, 0.3)
    (first, _), (second, _), *_ = rings([clear(lone, shared), clear(shared)], RATE, ITSELF)
    assert (first, second) == pytest.approx((2.6 * ITSELF, WM), rel=0.02)


def test_a_level_that_stays_moves_nothing() -> None:
    line = (1.0, WM, DM, 0.3)
    ((omega, decay), *_) = rings([clear(line)], RATE, ITSELF)
    assert omega == pytest.approx(WM, rel=0.02)
    ((same, as_fast), *_) = rings([clear(line, level=30.0)], RATE, ITSELF)
    assert (same, as_fast) == (pytest.approx(omega, rel=1e-9), pytest.approx(decay, rel=1e-6))


def device(sensed: Sensed = Sensed.VELOCITY) -> Device:
    gain = ITSELF if sensed is Sensed.VELOCITY else 1.0
    return Device(
        sample_rate=RATE, stiffness=(1.004 * K,), damping=(1.2 * D,), amplitude=1e-3, sense_gain=(gain,),
        noise=(NOISE,), sensed=(sensed,),
    )  # fmt: skip


def decay(rng: np.random.Generator, ringing: bool) -> Record:
    """A linear decay, V of velocity, and another mode beside it, each from where this record begins."""
    omega = math.sqrt(K - 0.25 * D * D)
    first = rng.uniform(0.5, 1.5) * 1e-3 * K / omega * np.exp(-0.5 * D * T) * np.sin(omega * T)
    second = rng.uniform(0.01, 0.03) * decaying(WM, DM, rng.uniform(0.0, 6.0)) if ringing else 0.0
    seen = -first + second + rng.normal(0.0, NOISE, SAMPLES)
    return Record(seen[:, None], np.zeros((SAMPLES, 1, 1)), np.full(SAMPLES, 1.0 / RATE))


SETTINGS = ObserverSettings(gain=Gain.EKF, spread=Spread(offset=NOISE, drive_gain=0.0, stiffness=0.02, damping=1.0))


ALONE = replace(SETTINGS, spread=replace(SETTINGS.spread, drive_gain=0.1))


def together(*, ringing: bool = True) -> Diagnosis:
    rng = np.random.default_rng(3)
    members = tuple(Member(f"ring {number}", decay(rng, ringing)) for number in range(4))
    return trace_pool(Pool(members, device(), SETTINGS), (1,))


def inside(found: Diagnosis) -> None:
    (mode,) = found.effects
    assert mode.name == NAME
    for symbol, true in (("wm", WM), ("dm", DM)):
        one = mode.coefficients[symbol]
        half = 0.5 * (one.high - one.low)
        assert half < 0.01 * true
        assert abs(one.value - true) < 1.5 * half, symbol


@pytest.mark.moderate
def test_decays_share_its_frequency_and_damping_and_begin_each_as_it_does() -> None:
    found = together()
    assert found.verdict is Verdict.EXPLAINED
    inside(found)
    assert set(found.effects[0].coefficients) == {"wm", "dm"}
    assert found.held_out_after.ratio == pytest.approx(1.0, abs=0.15)
    assert found.held_out_before.ratio > 10.0


@pytest.mark.moderate
def test_one_mode_alone_needs_no_other() -> None:
    found = together(ringing=False)
    assert (found.verdict, found.effects) == (Verdict.ADEQUATE, ())


@pytest.mark.moderate
def test_one_decay_tells_it_too_and_predicts_the_part_held_out() -> None:
    """Which begins at another phase of both modes."""
    problem = Problem(decay(np.random.default_rng(5), True), device(), ALONE)
    found = trace(problem, split=round(0.6 * SAMPLES))
    assert found.verdict is Verdict.EXPLAINED
    inside(found)


@pytest.mark.moderate
def test_a_displacement_shows_it_in_the_same_form() -> None:
    record = decay(np.random.default_rng(5), True)
    seen = replace(record, sense=record.sense / ITSELF)
    shows = replace(device(Sensed.DISPLACEMENT), noise=(NOISE / ITSELF,))
    inside(trace(Problem(seen, shows, ALONE), split=round(0.6 * SAMPLES)))


SOFTENING, DRAG = -3.0e8, 4.0  # 1/(m²·s²), 1/m: 2 % of the spring and a sixth of the damping at 1 mm
W2, D2 = 2.0 * np.pi * 63.0, 9.0
RING_RATE, RING_NOISE = 500.0, 2.5e-4  # Hz, m/s


def both_modes(start: float, second: tuple[float, float]) -> Array:
    """What a vibrometer sees, m/s: the first mode softens and drags, the second rings beside it, released at rest."""

    def slope(_: float, s: Array) -> list[float]:
        x, v, p, w = s
        return [v, -K * x - D * v - SOFTENING * x**3 - DRAG * abs(v) * v, w, -(W2**2) * p - D2 * w]

    t = np.arange(600) / RING_RATE
    solved = solve_ivp(slope, (0.0, t[-1]), (start, 0.0, *second), "DOP853", t, rtol=1e-10, atol=1e-14, max_step=2e-3)
    return np.asarray(solved.y[1] + solved.y[3])


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("draw", [10, 11])  # the spring is taken first in the other
def test_twelve_decays_seen_by_a_vibrometer_tell_the_laws_of_both_modes(draw: int) -> None:
    rng, members = np.random.default_rng((11, draw)), []
    for number, start in enumerate(1e-3 * np.linspace(0.5, 2.0, 12)):
        seen = both_modes(float(start), (float(start) * rng.uniform(0.05, 0.15), rng.normal(0.0, 0.02)))
        seen += rng.normal(0.0, RING_NOISE, len(seen))
        record = Record(seen[:, None], np.zeros((len(seen), 1, 1)), np.full(len(seen), 1.0 / RING_RATE))
        members.append(Member(f"ring {number}", record))
    gain = math.sqrt(1.005 * K)  # 1 V of 1 m/s, at the declared resonance
    beam = replace(device(), sample_rate=RING_RATE, stiffness=(gain**2,), sense_gain=(gain,), noise=(RING_NOISE,))
    spread = replace(SETTINGS.spread, position=2.0, velocity=2.0, offset=RING_NOISE, stiffness=0.05)
    with np.errstate(all="ignore"):  # as the command has it: of candidates that no record excites
        said = trace_pool(Pool(tuple(members), beam, replace(SETTINGS, spread=spread)), (2, 5, 8, 10))
    assert said.verdict is Verdict.EXPLAINED
    assert {effect.name for effect in said.effects} == {"cubic_stiffness", "drag", NAME}
    found = {symbol: one for effect in said.effects for symbol, one in effect.coefficients.items()}
    truth = {"k3x": SOFTENING, "dqx": DRAG, "wm": math.sqrt(W2**2 - 0.25 * D2**2), "dm": D2}
    for symbol, true in truth.items():
        assert abs(found[symbol].value - true) < 0.75 * (found[symbol].high - found[symbol].low), symbol
    assert said.held_out_after.ratio < 1.05
