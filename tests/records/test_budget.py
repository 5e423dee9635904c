"""The budget's share of what a record leaves: against covariances worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.completeness.information import Information, ScannedCoefficient
from hil.verdict.budget import _left, with_clock

U = {"drive_gain": 0.01, "clock": 0.02}


def information(normal: np.ndarray, sensitivity: list[float]) -> Information:
    """hx and hy with a plausible size of 0.05, a record that suggests nothing."""
    coefficients = tuple(ScannedCoefficient("drive_gain", symbol, "1", 0.05) for symbol in ("hx", "hy"))
    return Information(
        coefficients, normal * 0.05**2, np.zeros(2), np.array([0.0, 1.0]), np.array([[0, 0], sensitivity])
    )


def test_a_record_that_says_nothing_leaves_what_was_declared() -> None:
    left = _left(information(np.zeros((2, 2)), [3.0, 5.0]), U)
    assert left["drive_gain"] == pytest.approx(0.01 * np.hypot(3.0, 5.0))
    assert left["clock"] == pytest.approx(0.02 * 2.0 * (3.0 + 5.0))


def test_a_known_sum_excludes_gain_and_clock_together() -> None:
    """The clock does to both gains what it does; the record has their sum, and so the angle."""
    precise = 1e12 * np.ones((2, 2))
    left = _left(information(precise, [4.0, 4.0]), U)
    assert np.hypot(left["drive_gain"], left["clock"]) < 1e-4


def test_two_that_are_told_together_share_what_is_left() -> None:
    """By the covariance (N + P0⁻¹)⁻¹ of hx, hy with the clock in P0: diag(u²) + (2 u_clock)² of both together."""
    normal, g = np.array([[2e4, 1e4], [1e4, 3e4]]), np.array([2.0, 5.0])
    prior = 0.01**2 * np.eye(2) + (2.0 * 0.02) ** 2 * np.ones((2, 2))
    expected = g @ np.linalg.inv(normal + np.linalg.inv(prior)) @ g
    left = _left(information(normal, g.tolist()), U)
    assert left["drive_gain"] ** 2 + left["clock"] ** 2 == pytest.approx(expected)


def test_a_clock_that_is_fast_acts_as_smaller_gains() -> None:
    joint = with_clock(information(np.diag([1.0, 2.0]), [3.0, 5.0]))
    np.testing.assert_allclose(joint.sensitivity[-1], [3.0, 5.0, -16.0])


def test_what_was_not_watched_is_left_to_the_closed_form() -> None:
    assert set(_left(information(np.zeros((2, 2)), [1.0, 1.0]), U | {"sense_gain_ratio": 0.005})) == {
        "drive_gain",
        "clock",
    }


def test_the_shift_that_the_record_suggests_is_part_of_it() -> None:
    """docs/explanation.md, What the record leaves: beside gᵀ C g the shift gᵀ C b of constants that seem to be off."""
    normal, b, g = np.array([[2e4, 1e4], [1e4, 3e4]]), np.array([600.0, 900.0]), np.array([2.0, 5.0])
    prior = 0.01**2 * np.eye(2) + (2.0 * 0.02) ** 2 * np.ones((2, 2))
    covariance = np.linalg.inv(normal + np.linalg.inv(prior))
    shift = g @ covariance @ b
    seen = replace(information(normal, g.tolist()), score=0.05 * b)
    left = _left(seen, U)
    assert left["drive_gain"] ** 2 + left["clock"] ** 2 == pytest.approx(g @ covariance @ g + shift**2)
    assert shift**2 > 0.1 * (g @ covariance @ g)  # or nothing is tested


def test_one_axis_alone_says_nothing_of_gain_and_clock() -> None:
    both = information(np.diag([1.0, 2.0]), [3.0, 5.0])
    for place, symbol in enumerate(("hx", "hy")):
        one = replace(
            both,
            coefficients=(ScannedCoefficient("drive_gain", symbol, "1", 0.05),),
            normal=both.normal[place : place + 1, place : place + 1],
            score=both.score[:1],
            sensitivity=both.sensitivity[:, place : place + 1],
        )
        assert _left(one, U) == {}


def test_a_record_that_is_not_finite_leaves_what_was_declared() -> None:
    assert _left(information(np.zeros((2, 2)), [np.nan, 1.0]), U) == {}
