"""Probabilities are numbers that add up to one, whatever an account's likelihood came to."""

import math

import pytest

from estimator.trace.probabilities import _classes


@pytest.mark.parametrize(
    ("gains", "certain"),
    [
        ({"nothing": -40.0, "drag": 0.0, "something else": math.inf}, "something else"),
        ({"nothing": -math.inf, "drag": 0.0, "something else": math.nan}, "drag"),
    ],
)
def test_an_account_that_loses_the_motion_has_no_share(gains: dict[str, float], certain: str) -> None:
    shares = _classes("drag", gains).probabilities
    assert shares[certain] == pytest.approx(1.0, abs=1e-6)
    assert sum(shares.values()) == pytest.approx(1.0)
