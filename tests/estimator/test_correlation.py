"""How a series hangs on its own past, and how many independent samples it is then worth."""

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator.correlation import autocorrelation, effective_samples

N = 40_000


def test_an_autocorrelation_is_about_the_mean_and_does_not_turn_round() -> None:
    """Its products written out."""
    series = np.array([6.0, 6.0, 4.0])
    centred = series - 16.0 / 3.0
    products = [centred @ centred, centred[:-1] @ centred[1:], centred[0] * centred[2]]
    np.testing.assert_allclose(autocorrelation(series), np.array(products) / products[0], atol=1e-12)
    np.testing.assert_array_equal(autocorrelation(np.full(4, 3.0)), np.zeros(4))


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_a_series_with_memory_is_worth_fewer_samples(rho):
    """(1 − ρ)/(1 + ρ) of them."""
    series = lfilter([1.0], [1.0, -rho], np.random.default_rng(1).standard_normal(N))
    assert effective_samples(series + 7.0) == pytest.approx(N * (1.0 - rho) / (1.0 + rho), rel=0.1)


def test_a_series_is_worth_four_samples_at_least_and_all_of_them_at_most():
    assert effective_samples(np.sin(np.linspace(0.0, 3.0, 500))) == pytest.approx(4.0, abs=1.0)
    assert effective_samples(np.where(np.arange(500) % 2, 1.0, -1.0)) == 500.0
    assert effective_samples(np.ones(500)) == 500.0
