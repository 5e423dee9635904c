"""Chi-square and F beside SciPy's."""

import pytest
from scipy.stats import chi2, f

from estimator.chance import chi2_isf, chi2_sf, f_isf


@pytest.mark.parametrize("freedom", [0.7, 1.0, 3.0, 40.0, 1e4])
@pytest.mark.parametrize("probability", [1e-12, 1e-4, 0.05, 0.5, 0.99])
def test_chi_square(probability: float, freedom: float) -> None:
    limit = chi2_isf(probability, freedom)
    assert limit == pytest.approx(chi2.isf(probability, freedom), rel=1e-9)
    assert chi2_sf(limit, freedom) == pytest.approx(probability, rel=1e-9)
    assert chi2_sf(limit, freedom) == pytest.approx(chi2.sf(limit, freedom), rel=1e-9)


@pytest.mark.parametrize("under", [2.0, 30.0, 1e5])
@pytest.mark.parametrize("over", [1.0, 8.0, 1e4])
@pytest.mark.parametrize("probability", [1e-4, 0.05, 0.5])
def test_ratio_of_mean_squares(probability: float, over: float, under: float) -> None:
    assert f_isf(probability, over, under) == pytest.approx(f.isf(probability, over, under), rel=1e-6)
