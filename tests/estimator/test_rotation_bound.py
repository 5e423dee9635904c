"""The bound of the rotation: beside the bound of the 13 states, and beside what is known in closed form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.bound import posterior_bound
from estimator.rotation import rotation_bound
from estimator.settings import ObserverSettings, ProcessNoise, Spread
from tests.estimator.gyro_loop import Truth, ideal_states

TRUTH = Truth(stiffness=(1.0, 1.0, 0.0), damping=(0.0, 0.0, 0.0))
SETTINGS = ObserverSettings(process_noise=ProcessNoise(force=1e-4, rate=1.0, offset=1e-4, stiffness=1e-4))


@pytest.mark.slow
def test_of_the_states_it_is_the_bound_of_the_states():
    n = 1200
    truth = ideal_states(TRUTH, 1.3, n)
    # Every channel loses samples now and then.
    lost = np.zeros((n, 2), bool)
    lost[::7, 0] = lost[3::11, 1] = True
    device = replace(TRUTH.device(), damping=(1.0, 1.0, 0.0))
    _, found = rotation_bound(device, SETTINGS, truth, every=100, lost=lost)
    beside = posterior_bound(device, SETTINGS, truth, np.zeros((n, 2)), every=100, lost=lost).deviation
    assert np.allclose(found[1:], beside[1:], rtol=0.02)


@pytest.mark.moderate
def test_an_unseen_rotation_is_the_integral_of_the_rate_s_random_walk():
    n, h = 400, 1.0 / TRUTH.sample_rate
    settings = replace(SETTINGS, spread=Spread(rate=0.3), reference=0.02, process_noise=ProcessNoise(rate=2.0))
    found, _ = rotation_bound(TRUTH.device(), settings, ideal_states(TRUTH, 1.3, n), lost=np.ones((n, 2), bool))
    since = (np.arange(n) + 1) * h - settings.reference
    started = 0.3**2 + 2.0**2 * 0.02
    expected = np.sqrt(started * since**2 + 2.0**2 * since**3 / 3.0)
    assert np.allclose(found[80:], expected[80:], rtol=1e-3)
    assert found[79] == 0.0


@pytest.mark.moderate
def test_what_is_seen_makes_it_less():
    n = 2000
    settings = replace(SETTINGS, reference=0.1)
    seen, _ = rotation_bound(TRUTH.device(), settings, ideal_states(TRUTH, 1.3, n))
    blind, _ = rotation_bound(TRUTH.device(), settings, ideal_states(TRUTH, 1.3, n), lost=np.ones((n, 2), bool))
    assert 0.0 < seen[-1] < 0.1 * blind[-1]
    assert math.isfinite(float(seen[-1]))
