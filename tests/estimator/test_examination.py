"""What is kept of an examination for the figures."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from estimator.diagnosis import Residual
from estimator.trace.examination import analyse_spectrum


def test_the_spectrum_of_the_whole_record_is_that_of_the_part_that_was_fitted() -> None:
    whole: Any = SimpleNamespace(innovation=np.arange(5.0))
    fitted = Residual(np.zeros(3), np.array([1.0, 2.0]), np.array([[3.0], [4.0]]))
    held_out = Residual(np.ones(2), np.array([9.0]), np.array([[9.0]]))
    parts: Any = [("fit", (), fitted), ("held out", (), held_out)]
    told = analyse_spectrum(whole, parts)
    assert told.innovation is whole.innovation
    assert told.frequency is fitted.frequency
    assert told.density is fitted.density
