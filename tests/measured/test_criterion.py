"""What a gain is held against, in closed form."""

import math

import pytest

from evaluation.measured.criterion import TIE, extended, schwarz


def test_a_tie_is_odds_of_twenty_to_one() -> None:
    assert pytest.approx(2.0 * math.log(20.0)) == TIE


def test_a_number_costs_the_logarithm_of_the_samples_and_a_choice_twice_that_of_the_candidates() -> None:
    assert schwarz(3, 1000.0) == pytest.approx(3.0 * math.log(1000.0))
    assert extended(3, 1000.0, 7) == pytest.approx(3.0 * math.log(1000.0) + 2.0 * math.log(7.0))
