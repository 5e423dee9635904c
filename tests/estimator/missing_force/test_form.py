"""The form of a missing force beside the law that SciPy's integrator was given; constants are not known beforehand."""

from typing import NamedTuple

import numpy as np
import pytest

from estimator.errors import ModelError
from estimator.missing_force.estimate import missing_force
from tests.estimator.missing_force.simulated import A_FORCE, LENGTH, OMEGA, Force, simulated

NOISE, SAMPLES = 3e-4, 10_000
FITTED = round(0.6 * SAMPLES)


class Case(NamedTuple):
    """A law, and the form that is expected with its first coefficient in units of A ω0², and the number inside, SI."""

    law: Force
    axes: int
    form: str
    size: float
    inside: float | None = None


CASES = {
    "a cubic spring on each axis": Case(
        lambda q, v: -np.array([0.03, 0.015]) * q**3, 2, "cubic stiffness", 0.03 / LENGTH**3
    ),
    "a law of the plane": Case(
        lambda q, v: -0.02 * (q @ q) * v, 2, "nonlinear damping radial", 0.02 / (LENGTH**3 * OMEGA)
    ),
    "a law that crosses the axes": Case(
        lambda q, v: np.array([-0.03 * q[1] ** 2 * v[0], 0.0]), 2, "p² v", -0.03 / (LENGTH**3 * OMEGA)
    ),
    "friction": Case(lambda q, v: -0.002 * np.tanh(v / 0.03), 1, "dry friction", 0.002),
    "a gap": Case(
        lambda q, v: -0.03 * (q - np.clip(q, -0.55, 0.55)), 1, "q beyond ±g", -0.03 / LENGTH, 0.55 * LENGTH
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_a_law_is_its_own_form_and_little_is_left(name: str) -> None:
    case = CASES[name]
    record = simulated(case.law, axes=case.axes, samples=SAMPLES, noise=NOISE)
    found = missing_force(record.problem, FITTED)
    (term,) = found.form.terms
    assert term.form == case.form
    one = next(iter(term.coefficients.values()))
    assert one.value == pytest.approx(case.size * A_FORCE, rel=0.03)
    assert one.low < one.value < one.high
    if case.inside is not None:
        assert next(iter(term.threshold.values())).value == pytest.approx(case.inside, rel=0.01)
    assert found.form.left < 0.1
    # Along the record the form is known where the force is: what is left is no more than the force's own uncertainty.
    left = np.sqrt(np.mean(found.left[FITTED:-500] ** 2, axis=0))
    assert np.all(left < 1.5 * found.left_deviation)


@pytest.mark.slow
@pytest.mark.long
def test_where_nothing_is_missing_no_form_is_proposed() -> None:
    found = missing_force(simulated(lambda q, v: 0.0 * q, axes=2, samples=SAMPLES, noise=NOISE).problem, FITTED)
    assert found.form.terms == ()
    assert found.form.left == 1.0


@pytest.mark.slow
def test_uneven_samples_are_refused_in_words() -> None:
    problem = simulated(lambda q, v: 0.0 * q, axes=1, samples=2000, noise=NOISE).problem
    problem.record.step[500:] *= 1.01
    with pytest.raises(ModelError, match="not evenly spaced"):
        missing_force(problem, 1200)
