"""A carriage made here by an independent integrator: the force domain must give back its mass and its friction."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from estimator.errors import ModelError
from estimator.scaling import Scaling
from evaluation.measured.inverse_dynamics import (
    BASE,
    Filters,
    candidates,
    columns,
    fit_forces,
    motion_of,
    price,
    resampled,
    trace_forces,
)

RATE = 1000.0
FILTERS = Filters(60.0, 20.0, 25)
SCALING = Scaling(1.0, 0.05, (1.0,), 1.0 / 95.0)
MASS, VISCOUS, DRY, ONE_WAY, OFFSET = 95.0, 200.0, 20.0, -30.0, -1.5


def carriage(seed, *, dry=DRY, one_way=ONE_WAY, noise=0.5):
    """Position and force [N] of a carriage that is led along a smooth path by a position controller."""
    t = np.arange(12_000) / RATE
    rng = np.random.default_rng(seed)
    knots = np.arange(0.0, 14.0, 0.8)
    path = CubicSpline(knots, np.where(knots < 0.5, 0.0, rng.uniform(0.0, 0.25, len(knots))))

    def force(time, position, speed):
        return 4e4 * (path(time) - position) + 3e3 * (path(time, 1) - speed)

    def field(time, state):
        position, speed = state
        friction = VISCOUS * speed + dry * np.tanh(speed / 5e-4) + one_way * np.abs(speed) + OFFSET
        return [speed, (force(time, position, speed) - friction) / MASS]

    solution = solve_ivp(field, (0.0, t[-1]), [0.0, 0.0], t_eval=t, method="LSODA", rtol=1e-8, atol=1e-10)
    position, speed = solution.y
    return position, force(t, position, speed) + noise * rng.standard_normal(len(t))


@pytest.fixture(scope="module")
def motions():
    return [motion_of(*carriage(seed), RATE, FILTERS) for seed in (1, 2)]


@pytest.mark.slow
def test_friction_is_named_and_measured(motions):
    found = trace_forces(*motions, SCALING)
    assert set(found.after.effects) == {"dry_friction", "damping_asymmetric"}
    values = dict(zip(found.after.names, zip(found.after.values, found.after.half_widths, strict=True), strict=True))
    for name, truth in (("inertia", MASS), ("damping", VISCOUS), ("fx", DRY), ("dax", ONE_WAY), ("offset", OFFSET)):
        value, half = values[name]
        assert abs(value - truth) < 2.0 * half + 0.01 * abs(truth), name
    before, after = (np.std(fit.residual_on(motions[1], SCALING)) for fit in (found.before, found.after))
    assert after < 0.1 * before


@pytest.mark.moderate
def test_a_carriage_without_friction_gets_none():
    motions = [motion_of(*carriage(seed, dry=0.0, one_way=0.0), RATE, FILTERS) for seed in (3, 4)]
    found = trace_forces(*motions, SCALING)
    assert found.after.effects == ()
    assert set(found.rejected) == set(candidates())


@pytest.mark.moderate
def test_the_regressors_of_the_base_model_are_motion_itself(motions):
    names, matrix = columns(motions[0], (), SCALING)
    assert names == BASE
    np.testing.assert_array_equal(matrix[:, 2], resampled(motions[0], motions[0].position))
    np.testing.assert_allclose(matrix[:, 3], 1.0, atol=1e-9)


@pytest.mark.moderate
def test_only_forces_of_the_motion_are_candidates():
    assert {"dry_friction", "cubic_stiffness", "damping_asymmetric"} <= set(candidates())
    assert not {"drive_gain", "sense_quadratic", "drive_feedthrough", "sense_gain"} & set(candidates())


def test_bad_requests_are_refused(motions):
    position = motions[0].position
    with pytest.raises(ModelError, match="cut-offs 20 and 600 Hz do not fit a rate of 1000 Hz"):
        motion_of(position, position, RATE, Filters(600.0, 20.0, 25))
    with pytest.raises(ModelError, match="100 positions and 100 drives make no record"):
        motion_of(position[:100], position[:100], RATE, FILTERS)
    with pytest.raises(ModelError, match="'drive_gain' is no force linear in hx"):
        fit_forces(motions[0], ("drive_gain",), SCALING)


def test_a_number_costs_log_samples_and_a_choice_twice_log_candidates():
    assert price(3, 1000.0, 7) == pytest.approx(3.0 * np.log(1000.0) + 2.0 * np.log(7.0))


@pytest.mark.moderate
def test_friction_that_drives_is_not_taken():
    """Dry friction of the wrong sign fits as well, and is none."""
    motions = [motion_of(*carriage(seed, dry=-5.0), RATE, FILTERS) for seed in (5, 6)]
    found = trace_forces(*motions, SCALING)
    assert "dry_friction" not in found.after.effects
    assert found.rejected["dry_friction"] == "fits only with a negative fx"
