"""What an effect does to an amplitude: closed forms, and the averaged equation beside SciPy's solution of it."""

import math

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from estimator.effects.declaration import Coefficient, Compensation, Effect
from estimator.envelope.course import Power, level_at
from estimator.envelope.laws import laws
from estimator.errors import ModelError
from estimator.model.gyro import vx, x

CLOSED = {
    "nonlinear_damping": (1 / 8, 3.0),
    "dry_friction": (2 / math.pi, 0.0),
    "drag": (4 / (3 * math.pi), 2.0),
    "cubic_damping": (3 / 8, 3.0),
}
POWERS = [Power(0.5, 1.0), Power(2 / math.pi, 0.0), Power(4 / (3 * math.pi), 2.0), Power(0.375, 3.0)]
COEFFICIENTS = np.array([4e-3, 1e-4, 2e-3, 2e-2])
TIME = np.linspace(0.0, 1200.0, 300)
START, LOWEST = 0.2, -12.0


@pytest.mark.moderate
def test_the_catalogue_has_the_laws_of_the_textbook_and_no_other():
    """Nayfeh & Mook 1979, ch. 3; what is even in the velocity or a spring takes no energy from a cycle."""
    found = laws()
    assert {name: (law.size, law.degree) for name, law in found.items()} == {
        name: (pytest.approx(size, rel=1e-12), degree) for name, (size, degree) in CLOSED.items()
    }


def own(force: sp.Expr, *coefficients: str) -> Effect:
    given = tuple(Coefficient(sp.Symbol(name), name, 0.01, -4, 3) for name in coefficients)
    return Effect("own", None, given, "here", "", Compensation.CANCEL, force=(force, sp.Integer(0)))


@pytest.mark.moderate
def test_a_law_of_ones_own_is_one_where_it_is_a_power():
    c, k = sp.symbols("c k")
    assert laws([own(-c * vx**5, "c")])["own"].size == pytest.approx(5 / 16, rel=1e-12)
    assert "own" not in laws([own(-c * vx * sp.exp(-(x**2)), "c")])
    assert "own" not in laws([own(-c * vx**3 - k * vx, "c", "k")])
    assert "own" not in laws([own(-c * x**3, "c")])
    assert "own" not in laws([own(-(c**2) * vx**3, "c")])


@pytest.mark.moderate
def test_the_equation_is_that_of_si():
    assert laws()["drag"].equation == "ȧ += -0.4244*dqx*omega0*a**2"
    assert laws()["dry_friction"].equation == "ȧ += -0.6366*fx/omega0"


def solved(coefficients, start):
    def slope(_t, a):
        size = max(a[0], 1e-12)
        return [-sum(c * one.size * size**one.degree for c, one in zip(coefficients, POWERS, strict=True))]

    return solve_ivp(slope, (0.0, TIME[-1]), [math.exp(start)], "DOP853", TIME, rtol=1e-11, atol=1e-14).y[0]


@pytest.mark.moderate
def test_the_course_is_that_of_the_equation_solved_by_steps():
    found = level_at(TIME, START, COEFFICIENTS, POWERS, LOWEST)
    amplitude = solved(COEFFICIENTS, START)
    moving = amplitude > 1e-4
    assert moving.sum() > 200
    np.testing.assert_allclose(np.exp(found)[moving], amplitude[moving], rtol=1e-6)


def test_friction_brings_a_motion_to_rest_where_it_stays():
    found = level_at(TIME, 0.0, np.array([0.0, 2e-3]), POWERS[:2], LOWEST)
    ends = math.pi / 2 / 2e-3  # a = 1 − (2/π) f t
    np.testing.assert_allclose(np.exp(found[0.99 * ends > TIME]), 1.0 - TIME[0.99 * ends > TIME] / ends, rtol=1e-9)
    assert np.all(found[ends < TIME] == LOWEST)


@pytest.mark.parametrize("damping", [-1e-3, 0.0])
def test_what_does_not_fall_is_no_ring_down(damping):
    with pytest.raises(ModelError, match="ring-down"):
        level_at(TIME, 0.0, np.array([damping]), POWERS[:1], LOWEST)


def test_what_falls_to_a_level_and_stays_there_is_none_either():
    """A cycle that sustains itself: negative damping, and more of it at large amplitude."""
    with pytest.raises(ModelError, match="to the end of the record"):
        level_at(TIME, 0.0, np.array([-2e-2, 0.2]), [POWERS[0], POWERS[3]], LOWEST)
