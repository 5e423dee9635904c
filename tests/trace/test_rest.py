"""Where a free response has come to rest: what follows tells no law from another."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device
from estimator.trace.traceable import moves_until

RATE, HZ, NOISE = 4000.0, 200.0, 1e-4  # twenty samples a cycle
TARGET = (2.0 * np.pi * HZ) ** 2
SINGLE = Device(
    sample_rate=RATE, stiffness=(TARGET,), damping=(1.0,), amplitude=1e-4, sense_gain=(-890.0,), noise=(NOISE,)
)
GYRO = replace(
    SINGLE, stiffness=(TARGET, TARGET, 0.0), damping=(1.0, 1.0, 0.0), sense_gain=(-890.0,) * 2, noise=(NOISE,) * 2
)


def swinging(samples: int, until: int, *, seed: int, offset: float = 0.3) -> Array:
    """A vibration that ends at a sample and stands at an offset, in the declared noise."""
    rows = np.arange(samples)
    moved = np.where(rows < until, 0.05 * np.sin(2.0 * np.pi * HZ * rows / RATE), 0.0)
    return offset + moved + np.random.default_rng(seed).normal(0.0, NOISE, samples)


def record(*channels: Array, drive: float = 0.0) -> Record:
    sense = np.stack(channels, axis=1)
    return Record(sense, np.full((*sense.shape, 1), drive), np.full(len(sense), 1.0 / RATE))


@pytest.mark.parametrize("seed", range(20))
def test_it_moves_up_to_the_two_cycles_in_which_it_stops(seed: int) -> None:
    """Stretches are forty samples long, and that it stops at sample 410 is seen in the one from 400."""
    assert moves_until(record(swinging(4000, 410, seed=seed)), SINGLE) == 400
    assert moves_until(record(swinging(4010, 410, seed=seed)), SINGLE) == 400


def test_of_two_axes_both_must_be_at_rest() -> None:
    still, longer = swinging(4000, 50, seed=1), swinging(4000, 1610, seed=2)
    assert moves_until(record(still, longer), GYRO) == moves_until(record(longer, still), GYRO) == 1600


def test_noise_alone_is_rest_throughout_and_a_motion_to_the_end_is_none() -> None:
    assert moves_until(record(swinging(4000, 0, seed=3)), SINGLE) == 0
    assert moves_until(record(swinging(4000, 4000, seed=4)), SINGLE) == 4000
    assert moves_until(record(swinging(4000, 3990, seed=5)), SINGLE) == 4000  # it stops in the last two cycles
    assert moves_until(record(swinging(4000, 3950, seed=5)), SINGLE) == 3920


@pytest.mark.moderate
def test_of_a_hundred_records_of_noise_none_moves() -> None:
    """By chance one in a thousand does, whatever the length."""
    assert sum(moves_until(record(swinging(8000, 0, seed=seed)), SINGLE) for seed in range(100)) == 0


def test_a_motion_below_the_noise_is_seen_only_where_a_stretch_shows_it() -> None:
    """Of 40 samples the variance is known to 22 %; χ² asks for 2.7 × at one in a hundred thousand."""
    rows = np.arange(4000)
    loud = np.sqrt(2.0 * 2.5) * NOISE * np.sin(2.0 * np.pi * HZ * rows / RATE)  # 3.5 × the variance
    faint = np.sqrt(2.0 * 0.2) * NOISE * np.sin(2.0 * np.pi * HZ * rows / RATE)  # 1.2 ×
    assert moves_until(record(swinging(4000, 0, seed=6) + loud), SINGLE) == 4000
    assert moves_until(record(swinging(4000, 0, seed=6) + faint), SINGLE) == 0


@pytest.mark.parametrize(("times", "until"), [(0.999, 0), (1.001, 40)])
def test_a_stretch_moves_where_its_sum_of_squares_is_beyond_chance(times: float, until: int) -> None:
    """χ² of as many degrees as samples less one, of which one of three stretches in a thousand records is."""
    sides = np.sqrt(times * chi2.isf(1e-3 / 3.0, 39) / 40.0) * NOISE * np.where(np.arange(40) % 2, 1.0, -1.0)
    assert moves_until(record(0.3 + np.concatenate([np.zeros(40), sides, np.zeros(40)])), SINGLE) == until


def test_a_driven_mass_is_never_said_to_rest_nor_one_of_unknown_resonance() -> None:
    seen = swinging(4000, 410, seed=7)
    assert moves_until(record(seen, drive=1e-3), SINGLE) == 4000
    assert moves_until(record(seen), replace(SINGLE, stiffness=(0.0,), target_stiffness=0.0)) == 4000
    pushed = record(seen)
    pushed.drive[17] = 1e-3  # once
    assert moves_until(pushed, SINGLE) == 4000


def test_a_slow_pendulum_comes_to_rest_as_a_fast_one_does() -> None:
    """The same samples, taken two thousand times as slowly: a tenth of a hertz."""
    slow = Record((seen := swinging(4000, 410, seed=7)[:, None]), np.zeros((*seen.shape, 1)), np.full(4000, 0.5))
    assert moves_until(slow, replace(SINGLE, sample_rate=2.0, stiffness=(TARGET / 2000.0**2,))) == 400


def test_of_less_than_two_cycles_nothing_is_said_and_two_may_be_rest() -> None:
    assert moves_until(record(swinging(39, 0, seed=3)), SINGLE) == 39
    assert moves_until(record(swinging(79, 0, seed=3)), SINGLE) == 0
    assert moves_until(record(swinging(79, 79, seed=3)), SINGLE) == 79


def test_two_cycles_may_be_three_samples() -> None:
    """Seen at a sample and a half a cycle, it stops with the thirty-first."""
    fast = replace(SINGLE, stiffness=((2.0 * np.pi * RATE / 1.5) ** 2,))
    moved = np.where(np.arange(300) < 31, 0.05 * (-1.0) ** np.arange(300), 0.0)
    assert moves_until(record(moved), fast) == 30


def test_lost_samples_are_no_motion() -> None:
    seen = swinging(4000, 410, seed=8)
    seen[1000:1090], seen[2000:2039] = np.nan, np.nan  # a stretch and more, and all of one but a sample
    assert moves_until(record(seen), SINGLE) == 400


def test_a_step_to_another_rest_is_a_motion() -> None:
    seen = swinging(4000, 410, seed=9)
    seen[2010:] += 0.01
    assert moves_until(record(seen), SINGLE) == 2000


def test_a_rest_noisier_than_declared_is_not_called_one() -> None:
    seen = swinging(4000, 410, seed=10)
    assert moves_until(record(seen), replace(SINGLE, noise=(NOISE / 2.0,))) == 4000
