"""How sure a difference of two likelihoods is: the sum of the squares of parts, in closed form."""

import numpy as np
import pytest

from estimator.completeness.scan import PARTS
from estimator.trace.dispersion import dispersed


def test_a_part_counts_with_the_square_of_its_sum_over_what_white_noise_would_make() -> None:
    """Two rows of two axes to a part: e = (0.1, 0.2), z = (1, k) in part k, so that each part sums 2 (0.1 + 0.2 k)."""
    k = np.arange(PARTS)
    one = np.repeat(np.stack([np.ones(PARTS), k], axis=1), 2, axis=0)
    other = one + np.array([0.1, 0.2])
    expected = np.sum((2.0 * (0.1 + 0.2 * k)) ** 2) / (2 * PARTS * (0.01 + 0.04))
    assert dispersed(one, other) == pytest.approx(expected)


def test_a_difference_that_is_small_is_one_all_the_same() -> None:
    """However small: of both together 1e-4 as large, what the parts sum is 1e-8 as large, as its square 1e-16, and what
    white noise would make is 1e-8."""
    random = np.random.default_rng(1)
    one = np.cumsum(random.standard_normal((40 * PARTS, 2)), axis=0)
    other = one + random.standard_normal(one.shape)
    usual = dispersed(one, other)
    assert usual > 3.0
    assert dispersed(1e-4 * one, 1e-4 * other) == pytest.approx(1e-8 * usual)


def test_lost_samples_differ_by_nothing() -> None:
    random = np.random.default_rng(2)
    one, other = random.standard_normal((2, 4 * PARTS, 2))
    lost, less = one.copy(), other.copy()
    lost[5], less[5] = np.nan, np.nan
    one[5], other[5] = 0.0, 0.0
    assert dispersed(lost, less) == dispersed(one, other)


def test_where_nothing_can_be_told_of_a_difference_it_is_as_sure_as_white_noise() -> None:
    one = np.ones((640, 2))
    assert dispersed(one, one) == 1.0
    with np.errstate(all="ignore"):
        assert dispersed(one, np.full_like(one, np.inf)) == 1.0
