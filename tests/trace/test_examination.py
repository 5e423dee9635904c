"""What is kept of an examination for the figures."""

from dataclasses import fields

import numpy as np
import pytest

from estimator.diagnosis import Fit
from estimator.observer import Estimates
from estimator.record import Record
from estimator.trace.examination import scored

N, SPLIT = 1003, 600
RATE = 4000.0


def test_of_a_gyro_its_own_bias_scale_and_delay_are_no_error() -> None:
    """A bias of 10 mrad/s, a scale 1 % off and 5 ms late make 11 mrad; what is left is of the estimates."""
    t_s = np.arange(20_000) / RATE
    turning, turned = np.sin(3.0 * t_s), (1.0 - np.cos(3.0 * t_s)) / 3.0
    wrong = 2e-3 * np.sin(50.0 * t_s)
    late = 0.01 + 1.01 * np.sin(3.0 * (t_s - 5e-3))
    found = {one.name: t_s for one in fields(Estimates)}
    found |= {"names": ("rate",), "index": np.arange(len(t_s)), "angle": turned + wrong, "state": turning[:, None]}
    errors = {
        name: scored(
            Fit((1.0,), (1.0,), 1.0, 0.5),
            Record(np.zeros((len(t_s), 2)), np.zeros((len(t_s), 2, 1)), np.full(len(t_s), 1.0 / RATE), {name: late}),
            Estimates(**found), slice(4000, len(t_s)), 1,
        ).angle_error_rms for name in ("rate", "gyro")
    }  # fmt: skip
    assert errors["gyro"] == pytest.approx(2e-3 / np.sqrt(2.0), rel=0.01)
    assert errors["rate"] > 5.0 * errors["gyro"]
