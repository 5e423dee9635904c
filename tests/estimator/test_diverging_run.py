"""A free run that diverges is told as one, be it by its derivatives or by its squares only."""

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.refinement import refine
from estimator.simulation import simulate
from tests.estimator.test_free_run import DEVICE, DRIVE, RATE, SETTINGS, state_of

OBSERVER = Observer(DEVICE, SETTINGS)
N = len(DRIVE)


@pytest.mark.parametrize("growth", [300.0, 704.5, 900.0])
def test_refined_over_a_diverging_run(growth: float) -> None:
    """The amplitude grows by e^growth: its square, its derivative, or it itself is no number any more."""
    start = state_of(OBSERVER, kxx=1.9e5, dxx=-2.0 * growth * RATE / N, x=1e-3, drive_gain_x=1.0)
    sense = 0.01 * np.sin(np.arange(N) / 3.0)[:, None]
    with pytest.raises(ModelError, match=r"leaves? all bounds"):
        refine(OBSERVER, sense, DRIVE, start=start, free=("x", "vx", "kxx", "dxx"))


def test_derivatives_that_are_none_are_not_given() -> None:
    start = state_of(OBSERVER, kxx=1.9e5, dxx=-2.0 * 704.5 * RATE / N, x=1e-3, drive_gain_x=1.0)
    made = simulate(OBSERVER, start, 0.0 * DRIVE)
    assert np.all(np.isfinite(made.sensed))
    with pytest.raises(ModelError, match="derivatives leave all bounds"):
        simulate(OBSERVER, start, 0.0 * DRIVE, sensitive=True)
