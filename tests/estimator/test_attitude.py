"""Attitude from three angles beside an integrator of its own, SciPy's, of the same body's rate."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from estimator.attitude import apart, attitude, matrix

W, A, C = 2.0 * np.pi * 0.5, 0.4, 0.2
SKEWED = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.0, 0.6, 0.8]])


def rate(t: np.ndarray) -> np.ndarray:
    """Of the body (3, n): coning about z while it turns."""
    return np.array([A * np.cos(W * t), A * np.sin(W * t), C + 0.0 * t])


def angles(t: np.ndarray, mount: np.ndarray) -> np.ndarray:
    """∫ a·ω dt (n, 3), by hand."""
    return np.column_stack([A / W * np.sin(W * t), A / W * (1.0 - np.cos(W * t)), C * t]) @ mount.T


def truth(t: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4), scalar first, by a Runge-Kutta method of order 8."""

    def slope(at: float, q: np.ndarray) -> np.ndarray:
        x, y, z = rate(np.array(at))
        omega = np.array([[0, -x, -y, -z], [x, 0, z, -y], [y, -z, 0, x], [z, y, -x, 0]])
        return 0.5 * omega @ q

    found = solve_ivp(slope, (0.0, float(t[-1])), [1.0, 0, 0, 0], "DOP853", t, rtol=1e-11, atol=1e-12)
    return np.asarray(found.y.T)


@pytest.mark.parametrize("mount", [np.eye(3), SKEWED], ids=["orthogonal", "skewed"])
def test_coning_is_followed_and_the_sum_of_the_rates_is_not_enough(mount: np.ndarray) -> None:
    t = np.arange(0.0, 60.0, 0.01)
    found = attitude(t, angles(t, mount), np.zeros((len(t), 3)), mount, np.zeros(3))
    true = truth(found.time_s)
    assert max(map(apart, found.quaternion, true)) < 2e-6
    plain = np.roll(Rotation.from_rotvec(angles(t, np.eye(3))[-1]).as_quat(), 1)
    assert apart(plain, true[-1]) > 0.1
    # Of a cone with half angle β = A/W the drift is W (1 - cos β) about its axis: ½ A²/W, the integral of the rate's
    # cross product, of which the two-sample term sees the part within an interval, (W h)²/… of it.
    assert np.linalg.norm(found.coning[-1]) == pytest.approx(60.0 * A**2 * W * 0.01**2 * 2.0 / 3.0 / 2.0, rel=0.01)
    np.testing.assert_allclose(matrix(true[7]), Rotation.from_quat(np.roll(true[7], -1)).as_matrix(), atol=1e-9)


@pytest.mark.parametrize("mount", [np.eye(3), SKEWED], ids=["orthogonal", "skewed"])
def test_the_covariance_is_that_of_a_thousand_draws(mount: np.ndarray) -> None:
    t, random = np.arange(0.0, 8.0, 0.05), np.random.default_rng(1)
    u = np.outer(t / t[-1], [1e-3, 2e-3, 3e-3])
    mount_u = np.array([2e-3, 1e-3, 0.0])
    clean = attitude(t, angles(t, mount), u, mount, mount_u)
    offs = []
    for _ in range(1000):
        tilted = mount + random.standard_normal((3, 3)) * mount_u[:, None]
        tilted /= np.linalg.norm(tilted, axis=1, keepdims=True)
        read = angles(t, tilted) + u * random.standard_normal(3)
        off = attitude(t, read, u, mount, mount_u).quaternion[-1]
        frames = [Rotation.from_quat(np.roll(q, -1)) for q in (off, clean.quaternion[-1])]
        offs.append((frames[0] * frames[1].inv()).as_rotvec())
    found = np.cov(np.array(offs).T)
    np.testing.assert_allclose(clean.covariance[-1], found, atol=0.12 * np.abs(found).max())


def test_one_turn_about_one_axis_is_its_angle() -> None:
    t = np.linspace(0.0, 1.0, 101)
    u = np.outer(t, [0.0, 0.0, 1e-3])
    found = attitude(t, np.outer(t, [0.0, 0.0, 1.2]), u, np.eye(3), np.zeros(3))
    np.testing.assert_allclose(found.quaternion[-1], [np.cos(0.6), 0.0, 0.0, np.sin(0.6)], atol=1e-12)
    assert found.deviation[-1] == pytest.approx(1e-3)
    assert not found.coning.any()
    with pytest.raises(ValueError, match="three instants"):
        attitude(t[:2], np.zeros((2, 3)), np.zeros((2, 3)), np.eye(3), np.zeros(3))
