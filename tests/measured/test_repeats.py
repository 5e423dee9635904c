"""Whether repeats agree: counted by hand, and of draws whose intervals are right."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from evaluation.measured.repeats import Repeated, share


def test_beside_the_others_both_intervals_count():
    """Three of one size: the mean of two others has a half width of 1/√2."""
    one = Repeated("c", [0.0, 1.0, 2.0], [1.0, 1.0, 1.0])
    assert one.off == pytest.approx([-1.5 / math.sqrt(1.5), 0.0, 1.5 / math.sqrt(1.5)])
    assert one.agree == 1
    uneven = Repeated("c", [0.0, 1.0, 4.0], [1.0, 1.0, 2.0])
    mean = (1.0 + 0.25 * 4.0) / 1.25
    assert uneven.off[0] == pytest.approx(-mean / math.sqrt(1.0 + 1.0 / 1.25))


@pytest.mark.moderate
def test_of_right_intervals_nineteen_of_twenty_agree():
    rng = np.random.default_rng(4)
    deviations = rng.uniform(0.5, 2.0, (400, 7))
    values = 5.0 + deviations * rng.standard_normal((400, 7))
    halves = norm.isf(0.025) * deviations
    every = [Repeated("c", v, h) for v, h in zip(values, halves, strict=True)]
    agree, number, low, high = share(every)
    assert number == 2800
    assert 0.93 < agree / number < 0.97
    assert low < agree / number < high < low + 0.03
    assert np.mean([one.spread**2 for one in every]) == pytest.approx(1.0, abs=0.05)


def test_none_and_all_have_bounds_that_are_shares():
    nothing, everything = (Repeated("c", values, [1.0] * 2) for values in ([-9.0, 9.0], [0.0, 0.0]))
    assert share([nothing])[:3] == (0, 2, 0.0)
    assert share([everything])[::3] == (2, 1.0)
