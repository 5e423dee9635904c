"""Averaged densities beside SciPy's."""

import numpy as np
import pytest
from scipy.signal import correlate, csd, welch

from estimator.correlation import autocorrelation
from estimator.residual.averaged import cross_density, power_density

RANDOM = np.random.default_rng(4)


@pytest.mark.parametrize(("n", "segment"), [(1000, 256), (1000, 255), (999, 64), (100, 4096), (256, 256)])
def test_densities_are_scipys(n: int, segment: int) -> None:
    one, other = RANDOM.standard_normal((2, n, 2)) + 3.0
    expected = welch(one, 4000.0, nperseg=min(segment, n), axis=0)
    for mine, its in zip(power_density(one, 4000.0, segment), expected, strict=True):
        np.testing.assert_allclose(mine, its, rtol=1e-10, atol=1e-16)
    expected = csd(one[:, 0], other[:, 1], 4000.0, nperseg=min(segment, n))
    for mine, its in zip(cross_density(one[:, 0], other[:, 1], 4000.0, segment), expected, strict=True):
        np.testing.assert_allclose(mine, its, rtol=1e-9, atol=1e-16)


@pytest.mark.parametrize("n", [7, 500])
def test_an_autocorrelation_is_scipys(n: int) -> None:
    series = np.cumsum(RANDOM.standard_normal(n))
    centred = series - series.mean()
    expected = correlate(centred, centred)[n - 1 :]
    np.testing.assert_allclose(autocorrelation(series), expected / expected[0], rtol=1e-9, atol=1e-12)
