"""Quantiles in parts against NumPy's of the whole."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import hil.records.quantiles as module
from hil.records.quantiles import quantiles

FRACTIONS = (0.0, 0.1, 0.5, 0.99, 0.999, 1.0)


def parts(values, size):
    return lambda: (values[at : at + size] for at in range(0, len(values), size))


@pytest.mark.slow
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False, width=64).filter(lambda x: abs(x) < 1e300), min_size=1),
    st.integers(1, 7),
)
def test_any_numbers(values, size):
    values = np.array(values)
    for got, want in zip(quantiles(parts(values, size), FRACTIONS), np.quantile(values, FRACTIONS), strict=True):
        assert got == pytest.approx(want, rel=1e-12, abs=1e-300)


@pytest.mark.moderate
@pytest.mark.parametrize("few", [1, 100, 1 << 20])
def test_however_many_passes_it_takes(monkeypatch, few):
    monkeypatch.setattr(module, "_FEW", few)
    rng = np.random.default_rng(3)
    for values in (
        rng.standard_normal(10_001),
        np.round(rng.standard_normal(10_000), 1),
        np.full(5000, -0.25),
        1e-12 * rng.standard_normal(3000).astype(np.float32).astype(float),
    ):
        np.testing.assert_allclose(quantiles(parts(values, 777), FRACTIONS), np.quantile(values, FRACTIONS), rtol=1e-14)


def test_nothing_and_no_number():
    assert quantiles(list, (0.5,)) is None
    assert quantiles(lambda: [np.array([1.0, np.nan])], (0.5,)) is None
