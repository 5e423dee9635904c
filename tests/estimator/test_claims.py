"""The residual of two models in multiples of one noise floor."""

import numpy as np
import pytest

from estimator.trace import claims


def test_the_residual_is_in_multiples_of_the_lower_floor():
    before = claims.Fit((6.0, 2.0), (2.0, 1.0), np.sqrt((9.0 + 4.0) / 2.0), 0.25, simulation_rmse=7.0)
    after = claims.Fit((3.0, 2.0), (1.0, 2.0), np.sqrt((9.0 + 1.0) / 2.0), 0.5)
    errors = claims.residual_of(before, after, 10.0)
    assert errors.before == pytest.approx(np.sqrt((36.0 + 4.0) / 2.0))
    assert errors.after == pytest.approx(np.sqrt((9.0 + 4.0) / 2.0))
    assert errors.floor == 1.0
    was, left = claims.on_one_floor(before, after)
    assert (was.ratio, left.ratio) == (errors.before, errors.after)
    assert was.noise_floor == left.noise_floor == (1.0, 1.0)
    assert (was.innovation_rms, was.whiteness_p, was.simulation_rmse) == ((6.0, 2.0), 0.25, 7.0)
    assert (left.innovation_rms, left.whiteness_p) == ((3.0, 2.0), 0.5)


def test_an_innovation_that_fell_is_told_so_where_the_floor_fell_with_it():
    """A feedthrough of a noisy drive is most of the floor that is seen without it: a stranger's record, in µV."""
    before = claims.Fit((50.0, 37.24), (50.8, 36.77), 0.9994, 0.5)
    after = claims.Fit((45.3, 37.23), (45.4, 36.75), 1.0064, 0.5)
    was, left = claims.on_one_floor(before, after)
    assert was.ratio > 1.05 > left.ratio > 1.0
