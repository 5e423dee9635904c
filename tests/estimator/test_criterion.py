"""What a gain is held against, in closed form."""

import math

import pytest

from estimator.trace.criterion import TIE, chance_gain, extended, schwarz, threshold


def test_a_tie_is_odds_of_twenty_to_one() -> None:
    assert pytest.approx(2.0 * math.log(20.0)) == TIE


@pytest.mark.parametrize("candidates", [1, 2, 50])
def test_none_of_so_many_is_taken_for_chance_but_on_one_record_in_ten_thousand(candidates: int) -> None:
    """χ² of two degrees is an exponential: beyond g with exp(−g/2)."""
    assert threshold(candidates) == pytest.approx(4.0 + math.log10(candidates))
    assert chance_gain(2, candidates) == pytest.approx(-2.0 * math.log(1e-4 / candidates))


def test_a_number_costs_the_logarithm_of_the_samples_and_a_choice_twice_that_of_the_candidates() -> None:
    assert schwarz(3, 1000.0) == pytest.approx(3.0 * math.log(1000.0))
    assert extended(3, 1000.0, 7) == pytest.approx(3.0 * math.log(1000.0) + 2.0 * math.log(7.0))


def test_of_no_candidates_it_is_as_of_one() -> None:
    assert threshold(0) == threshold(1)
    assert chance_gain(2, 0) == chance_gain(2, 1)
    assert extended(1, 100.0, 0) == extended(1, 100.0, 1) == schwarz(1, 100.0)
