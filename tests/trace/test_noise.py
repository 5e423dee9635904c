"""The level of a noise is the top of a known curve."""

import numpy as np
import pytest

from estimator.trace.noise import level


@pytest.mark.parametrize("top", [-7.3, -2.0, 0.0, 0.6, 3.1])
@pytest.mark.parametrize("close", [0.25, 1.0])
def test_the_level_is_the_top_of_a_curve(top: float, close: float) -> None:
    found = level(lambda decade: -((decade - top) ** 2), 0.0, (-10.0, 10.0), close)
    assert abs(found - top) <= close


def test_the_level_of_a_lopsided_curve_is_its_top_and_not_its_middle() -> None:
    """A gamma distribution's logarithm by the logarithm of its argument: k v − eᵛ, the top at ln k."""
    found = level(lambda v: 40.0 * v - float(np.exp(v)), 0.0, (-5.0, 8.0), 0.03)
    assert found == pytest.approx(np.log(40.0), abs=0.03)


@pytest.mark.parametrize(("between", "edge"), [((-1.5, 1.0), 1.0), ((-1.0, 9.0), -1.0)])
def test_the_level_stays_between_its_bounds(between: tuple[float, float], edge: float) -> None:
    tried: list[float] = []

    def rising(decade: float) -> float:
        tried.append(decade)
        return decade * edge

    assert level(rising, 0.0, between, 0.5) == edge
    assert min(tried) >= between[0]
    assert max(tried) <= between[1]


def test_a_likelihood_that_failed_is_no_top() -> None:
    found = level(lambda v: -np.inf if v > 1.0 else -((v - 3.0) ** 2), 0.0, (-8.0, 8.0), 0.1)
    assert 0.8 < found <= 1.0


def test_no_level_is_tried_twice() -> None:
    """A pass over the record costs most of all."""
    tried: list[float] = []

    def curve(decade: float) -> float:
        tried.append(decade)
        return -((decade - 5.0) ** 2)

    assert level(curve, 0.0, (-10.0, 10.0), 0.25) == 5.0
    assert len(tried) == len(set(tried))
    assert len(tried) <= 14
