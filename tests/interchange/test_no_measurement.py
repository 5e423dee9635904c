"""Codes for no measurement are found, and measurements are not taken for them."""

import numpy as np
import pytest

from hil.importing.suspicious import first_code

RANDOM = np.random.default_rng(11)


@pytest.mark.parametrize("code", [9.9e37, 9.91e37, -9.9e37, 1e37, 3.4028235e38, 1e38, -1e30])
def test_what_no_quantity_reaches(code: float) -> None:
    values = np.concatenate([RANDOM.normal(size=20), [code], RANDOM.normal(size=20)])
    assert first_code(values) == (20, code)


@pytest.mark.parametrize("code", [-999.0, 9999.0, -9999.0, 99999.0, -999.25, -999.9, 999.99])
def test_codes_of_nines_that_lie_apart(code: float) -> None:
    values = np.concatenate([RANDOM.normal(20.0, 3.0, 30), [code, code], RANDOM.normal(20.0, 3.0, 30)])
    assert first_code(values) == (30, code)
    assert first_code(np.where(values == code, code, 20.0)) == (30, code)


def test_the_same_numbers_among_their_like_are_measurements() -> None:
    assert first_code(np.arange(-2000.0, 2000.0)) is None
    assert first_code(np.array([-999.0, -500.0, 0.0, 800.0])) is None
    assert first_code(np.tile([0.0, 999.0], 50)) is None  # a square wave
    assert first_code(np.full(9, 999.0)) is None
    assert first_code(np.array([1.0, np.nan, 998.0])) is None
    assert first_code(np.array([7.0])) is None


@pytest.mark.moderate
def test_false_alarms() -> None:
    """Of 20,000 columns of measurements in many shapes, sizes and roundings none; of single blows beside a floor those
    that hit a code: of whole numbers below 10,000 two, 999 and 9999."""
    alarms = 0
    for _ in range(20_000):
        scale, size = 10.0 ** RANDOM.uniform(-6.0, 6.0), int(RANDOM.integers(5, 200))
        shape = RANDOM.integers(5)
        values = [
            RANDOM.normal(size=size),
            RANDOM.standard_cauchy(size),
            np.sin(np.arange(size) * RANDOM.uniform(0.01, 3.0)),
            np.cumsum(RANDOM.normal(size=size)),
            np.sign(RANDOM.normal(size=size)),
        ][shape]
        alarms += first_code(np.round(scale * values, int(RANDOM.integers(0, 6)))) is not None
    assert alarms == 0
    floor = RANDOM.integers(-1, 2, 50).astype(float)
    blows = [first_code(np.concatenate([floor, [float(blow)]])) is not None for blow in range(100, 10_000)]
    assert sum(blows) == 2
