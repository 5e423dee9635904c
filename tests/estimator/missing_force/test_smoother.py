"""The estimated force beside the force that SciPy's integrator was given: its error, and whether its band holds it."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.missing_force.beside import Beside, beside
from estimator.missing_force.smoother import Smoothed, chosen, smooth
from estimator.trace.likelihood import Noise, observer_of
from estimator.trace.observed import run
from estimator.trace.problem import Problem
from estimator.trace.start import begin_moving
from tests.estimator.missing_force.simulated import (
    A_FORCE,
    DAMPING,
    LENGTH,
    OFFSET,
    OMEGA,
    RATE,
    STIFFNESS,
    Floats,
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


def known(problem: Problem, swing: Floats | float = 0.0) -> Beside:
    """With the constants that the integrator had, and a rate that is told to swing (n,) about that: what is left is the
    missing force alone.
    """
    axes, n = problem.device.axes, len(problem.record)
    initial = dict(zip(("kxx", "kyy", "kxy"), STIFFNESS, strict=True)) | dict(
        zip(("dxx", "dyy", "dxy"), DAMPING, strict=True)
    )
    settings = replace(problem.settings, initial={k: initial[k] for k in (initial if axes == 2 else ("kxx", "dxx"))})
    problem = problem.under(settings)
    follows = Noise((1.0,) * axes, 5e-3 * LENGTH * OMEGA**1.5, 0.01)
    observer = observer_of(problem, {}, follows)
    begin_moving(observer, problem.record)
    start = dict(zip(observer.names, observer.state.tolist(), strict=True))
    told = run(observer, problem.record, every=1)
    fixed = {"phi_x": OFFSET[0], "phi_y": OFFSET[1], "rate": RATE}
    start |= fixed
    motion = {name: told.of(name) for name in told.names}
    motion |= {name: np.full(n, value) for name, value in fixed.items()}
    motion["rate"] = motion["rate"] + swing
    return beside(problem, {}, motion, start)


def found_in(record: Beside) -> Smoothed:
    return smooth(record, chosen(record))


def judged(record: Simulated) -> tuple[float, float]:
    """Relative error of the force, rms, and the share of samples within the 95 % band, away from the ends."""
    found = found_in(known(record.problem))
    rows = slice(1000, -1000)
    true = record.force[rows] / A_FORCE
    off = found.force[rows] - true
    covered = np.mean(np.abs(off) < 1.96 * found.force_deviation)
    return float(np.sqrt(np.mean(off**2) / np.mean(true**2))), float(covered)


@pytest.mark.long
@pytest.mark.parametrize("name", PLANE)
def test_the_force_in_a_plane_is_found_within_its_band(name: str) -> None:
    error, covered = judged(simulated(PLANE[name], axes=2, samples=SAMPLES, noise=NOISE))
    assert error < 0.3
    assert 0.8 < covered <= 1.0


@pytest.mark.parametrize("name", LINE)
@pytest.mark.long
def test_the_force_along_a_line_is_found_within_its_band(name: str) -> None:
    error, covered = judged(simulated(LINE[name], axes=1, samples=SAMPLES, noise=NOISE))
    assert error < 0.3
    assert 0.8 < covered <= 1.0


@pytest.mark.long
def test_where_nothing_is_missing_no_force_is_found() -> None:
    """As large as what the force of friction in the other test is wrong by, at most."""
    found = found_in(known(simulated(lambda q, v: 0.0 * q, axes=2, samples=SAMPLES, noise=NOISE).problem))
    assert np.sqrt(np.mean(found.force[1000:-1000] ** 2)) < 3e-4


@pytest.mark.long
def test_lost_samples_do_no_harm() -> None:
    record = simulated(PLANE["cubic"], axes=2, samples=SAMPLES, noise=NOISE)
    record.problem.record.sense[5000:5003] = np.nan
    record.problem.record.sense[7000] = np.nan
    error, covered = judged(record)
    assert error < 0.3
    assert 0.8 < covered <= 1.0


@pytest.mark.long
def test_a_rate_that_is_told_otherwise_is_a_coriolis_force() -> None:
    """A rate that is told as constant, or with a swing that a force undoes, is the same record."""
    problem = simulated(PLANE["cubic"], axes=2, samples=SAMPLES, noise=NOISE).problem
    plain = found_in(known(problem))
    swing = 2e-3 * OMEGA * np.sin(2.0 * np.pi * np.arange(SAMPLES) / 4000.0)
    found = found_in(known(problem, swing))
    rows = slice(1000, -1000)
    extra = 2.0 * swing[rows, None] / OMEGA * np.stack([plain.motion[rows, 3], -plain.motion[rows, 1]], axis=1)
    error = found.force[rows] + extra - plain.force[rows]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(extra**2))
