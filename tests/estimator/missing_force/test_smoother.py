"""The estimated force beside the force that SciPy's integrator was given: its error, and whether its band holds it."""

import numpy as np
import pytest

from estimator.missing_force.linear import Linear, turned
from estimator.missing_force.smoother import chosen, smooth
from tests.estimator.missing_force.simulated import (
    A_FORCE,
    DAMPING,
    GAIN,
    LENGTH,
    OMEGA,
    RATE,
    STIFFNESS,
    Force,
    Simulated,
    simulated,
)

pytestmark = pytest.mark.slow

NOISE, SAMPLES = 1e-3, 8_000

PLANE: dict[str, Force] = {
    "cubic": lambda q, v: -np.array([0.03, 0.02]) * q**3,
    "friction": lambda q, v: -0.01 * np.tanh(v / 0.05),
    "of the plane": lambda q, v: -0.02 * np.hypot(*v) * v,
    "coupled": lambda q, v: np.array([-0.02 * q[1] ** 2 * v[0], 0.0]),
}
LINE: dict[str, Force] = {
    "cubic": lambda q, v: -0.03 * q**3,
    "quadratic": lambda q, v: 0.02 * q**2,
}


def known(record: Simulated) -> Linear:
    """With the constants that the integrator had: what is left is the missing force alone."""
    problem = record.problem
    axes = problem.device.axes
    names = ("kxx", "kyy", "kxy") if axes == 2 else ("kxx",)
    constants = {name: value / OMEGA**2 for name, value in zip(names, STIFFNESS, strict=False)}
    names = ("dxx", "dyy", "dxy") if axes == 2 else ("dxx",)
    constants |= {name: value / OMEGA for name, value in zip(names, DAMPING, strict=False)}
    if axes == 1:
        constants["drive_gain_x"] = 1.0
    return Linear(
        sense=problem.record.sense / (GAIN * LENGTH),
        drive=problem.record.drive / A_FORCE,
        step=OMEGA * float(problem.record.step[0]),
        noise=np.full(axes, NOISE),
        constants=constants,
        offset=np.array([3e-3, -2e-3])[:axes] / (GAIN * LENGTH),
        rate=np.full(len(problem.record), RATE / OMEGA if axes == 2 else 0.0),
    )


def judged(record: Simulated) -> tuple[float, float]:
    """Relative error of the force, rms, and the share of samples within the 95 % band, away from the ends."""
    linear = known(record)
    latent = chosen(linear, 1e-16)
    found = smooth(linear, latent, None, 1e-16)
    rows = slice(1000, -1000)
    true = record.force[rows] / A_FORCE
    off = found.force[rows] - true
    covered = np.mean(np.abs(off) < 1.96 * found.force_deviation)
    return float(np.sqrt(np.mean(off**2) / np.mean(true**2))), float(covered)


@pytest.mark.long
@pytest.mark.parametrize("name", PLANE)
def test_the_force_in_a_plane_is_found_within_its_band(name: str) -> None:
    error, covered = judged(simulated(PLANE[name], axes=2, samples=SAMPLES, noise=NOISE))
    assert error < 0.5
    assert 0.8 < covered <= 1.0


@pytest.mark.parametrize("name", LINE)
@pytest.mark.long
def test_the_force_along_a_line_is_found_within_its_band(name: str) -> None:
    error, covered = judged(simulated(LINE[name], axes=1, samples=SAMPLES, noise=NOISE))
    assert error < 0.5
    assert 0.8 < covered <= 1.0


@pytest.mark.long
def test_where_nothing_is_missing_no_force_is_found() -> None:
    """As large as what the force of friction in the other test is wrong by, at most."""
    record = simulated(lambda q, v: 0.0 * q, axes=2, samples=SAMPLES, noise=NOISE)
    linear = known(record)
    found = smooth(linear, chosen(linear, 1e-16), None, 1e-16)
    assert np.sqrt(np.mean(found.force[1000:-1000] ** 2)) < 3e-4


@pytest.mark.long
def test_lost_samples_and_a_rate_that_moves_do_no_harm() -> None:
    record = simulated(PLANE["cubic"], axes=2, samples=SAMPLES, noise=NOISE)
    linear = known(record)
    plain = smooth(linear, chosen(linear, 1e-16), None, 1e-16)
    holes = linear.sense.copy()
    holes[5000:5003] = np.nan
    holes[7000] = np.nan
    with_holes = Linear(holes, linear.drive, linear.step, linear.noise, linear.constants, linear.offset, linear.rate)
    assert np.all(np.isfinite(smooth(with_holes, plain.latent, None, 1e-16).force))
    # A rate that is told as constant, or as constant plus a swing that the Coriolis force undoes, is the same record.
    swing = 2e-3 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / 4000.0)
    swinging = Linear(linear.sense, linear.drive, linear.step, linear.noise, linear.constants, linear.offset,
                    linear.rate + swing)  # fmt: skip
    found = smooth(swinging, plain.latent, turned(swinging, plain.motion), 1e-16)
    rows = slice(1000, -1000)
    extra = 2.0 * swing[rows, None] * np.stack([plain.motion[rows, 3], -plain.motion[rows, 1]], axis=1)
    error = found.force[rows] + extra - plain.force[rows]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(extra**2))
