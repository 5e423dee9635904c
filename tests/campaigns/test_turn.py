"""The bias over a turn of the pattern: what was put in comes out, and noise makes as little of it as it may."""

import numpy as np
import pytest

from hil.sweeping.turn import bias_over_a_turn


def course(seconds: float, turning: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and pattern angles, the rotation itself uneven."""
    t = np.linspace(0.0, seconds, 4001)
    return t, 0.4 + turning * t + 0.3 * np.sin(1.7 * t)


def grown(t: np.ndarray, bias: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (bias[1:] + bias[:-1]) * np.diff(t))])


def test_a_bias_of_two_harmonics_comes_out() -> None:
    t, theta = course(9.0, -1.5)
    turn = bias_over_a_turn(t, theta, 0.7 + grown(t, 2e-3 + 3e-3 * np.cos(2 * theta - 0.4) + 1e-3 * np.sin(4 * theta)))
    around = np.linspace(0.0, np.pi, 2001)
    span = np.ptp(3e-3 * np.cos(2 * around - 0.4) + 1e-3 * np.sin(4 * around))
    assert turn is not None
    assert turn.mean == pytest.approx(2e-3, rel=1e-3)
    assert turn.span == pytest.approx(span, rel=2e-3)


@pytest.mark.moderate
def test_of_a_random_walk_little_is_taken_for_a_bias() -> None:
    t, theta = course(9.0, 1.5)
    random_walk = 1e-3 * np.sqrt(t[1])
    spans = []
    for seed in range(40):
        error = np.cumsum(random_walk * np.random.default_rng(seed).standard_normal(t.size))
        turn = bias_over_a_turn(t, theta, error)
        assert turn is not None
        spans.append(turn.span)
    alone = 1e-3 * np.sqrt(2.0 / 9.0)  # deviation of one coefficient of one harmonic
    assert alone < np.median(spans) < 6.0 * alone


def test_without_a_full_turn_there_is_none() -> None:
    t, theta = course(4.0, 1.2)
    assert np.ptp(theta) < 2.0 * np.pi
    assert bias_over_a_turn(t, theta, np.zeros(t.size)) is None
    assert bias_over_a_turn(t[:20], 10.0 * theta[:20], np.zeros(20)) is None
