"""Two levels of one axis' readings, beside what made them."""

import numpy as np
import pytest

from estimator.missing_force import switching

CYCLE = 20.0


@pytest.mark.slow
def test_levels_and_changes_are_those_that_were_made() -> None:
    rng = np.random.default_rng(2)
    made = np.repeat([1.0, -1.0, 1.0, 1.0, -1.0], 400)
    path, half, changes = switching._two_levels(3.0 + 0.5 * made + 0.1 * rng.standard_normal(2000), CYCLE)
    assert half == pytest.approx(0.5, rel=0.02)
    assert changes == 3
    assert np.mean(path == made) > 0.995


def test_an_axis_that_could_not_be_followed_has_no_levels_and_no_complaint() -> None:
    path, half, changes = switching._two_levels(np.full(2000, np.nan), CYCLE)
    assert not np.any(path)
    assert (half, changes) == (0.0, 0)
