"""A free run that diverges is told as one, be it by its derivatives or by its squares only."""

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.observer import Observer
from estimator.simulation import simulate
from evaluation.measured.refinement import refine
from tests.estimator.driven_axis import DEVICE, RATE, SETTINGS, state_of

OBSERVER = Observer(DEVICE, SETTINGS)


STILL = np.zeros((4000, 1))


def growing(growth: float) -> np.ndarray:
    """A start whose amplitude grows by e^growth over `STILL`."""
    return np.asarray(state_of(OBSERVER, kxx=1.9e5, dxx=-2.0 * growth * RATE / len(STILL), x=1e-3, drive_gain_x=1.0))


@pytest.mark.parametrize("growth", [300.0, 600.0, 900.0])
def test_refined_over_a_diverging_run(growth: float) -> None:
    """Its square, or the amplitude itself, is no number any more."""
    sense = 0.01 * np.sin(np.arange(len(STILL)) / 3.0)[:, None]
    with pytest.raises(ModelError, match=r"leaves? all bounds"):
        refine(OBSERVER, sense, STILL, start=growing(growth), free=("x", "vx", "kxx", "dxx"))


def test_derivatives_that_are_none_are_not_given() -> None:
    """Of the largest amplitude that is a number, the derivative by the damping is none: it is the amplitude's half of
    6.7 s.
    """
    low, high = 600.0, 900.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        try:
            simulate(OBSERVER, growing(middle), STILL)
            low = middle
        except ModelError:
            high = middle
    assert np.all(np.isfinite(simulate(OBSERVER, growing(low), STILL).sensed))
    with pytest.raises(ModelError, match="derivatives leave all bounds"):
        simulate(OBSERVER, growing(low), STILL, sensitive=True)
