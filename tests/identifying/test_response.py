"""The Bode plot's line against SciPy's discretisation of the same device."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete

from hil.identifying.page import response

_RATE = 4000.0


@pytest.mark.parametrize("delay", [0, 2])
def test_a_drive_of_a_row_acted_over_the_interval_before_it(delay: int) -> None:
    k, d, gain = (2.0 * np.pi * 200.0 / _RATE) ** 2, 0.003, np.array([-0.02, 0.03])
    theta = np.array([k, 1.02 * k, 0.0, d, d, 0.0, 0.0, *gain, 0.0, 0.0, float(delay), 0.0, 0.0])
    found: Any = SimpleNamespace(identity=SimpleNamespace(tick_rate_Hz=_RATE), fitted=SimpleNamespace(theta=theta))
    hertz = np.array([20.0, 150.0, 190.0, 210.0, 300.0])
    drawn, z = response(found, hertz), np.exp(2j * np.pi * hertz / _RATE)
    for axis, stiffness in enumerate(theta[:2]):
        a, b, *_ = cont2discrete(
            (np.array([[0.0, 1.0], [-stiffness, -d]]), np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1))), 1.0
        )
        position = np.array([np.linalg.solve(one * np.eye(2) - a, b)[0, 0] for one in z])
        expected = gain[axis] * z * position * z**-delay  # a row's drive went into the row, not out of it
        assert np.abs(drawn[:, axis, axis] / expected - 1.0).max() < 0.01
