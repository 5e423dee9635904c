"""Which experiment is advised for two effects that a record cannot tell apart (docs/reference/trace.md)."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import norm

from estimator.settings import ControllerSettings
from estimator.trace import separations as room
from estimator.trace.ambiguity import Member
from estimator.trace.filtered import Filtered
from estimator.trace.fit import FittedModel, at
from estimator.trace.likelihood import TIE, Model
from estimator.trace.separations import Advice, Shown, separations
from tests.trace.plain import problem, records

CONTROLLER = ControllerSettings(latency=3, force_quantum=1e-3, force_limit=10.0, sense_quantum=1e-5)


def needed() -> float:
    """Twice the log-likelihood, normal about d² with 2 d, that exceeds a tie in 95 of 100 cases: by SciPy."""
    return float(brentq(lambda square: norm.sf(TIE, square, 2.0 * np.sqrt(square)) - 0.95, 8.0, 80.0))


def test_how_long_it_takes_is_by_what_the_two_differ_in_it() -> None:
    shown = Shown(1.0, needed() / 4.0, np.zeros((2, 2)))
    assert room._takes(shown, np.eye(2), 3.0, 100.0) == pytest.approx(12.0, rel=1e-3)


@pytest.mark.parametrize(("unsure", "times"), [(1.5, 2.0), (2.7, 10.0), (3.1, 100.0), (6.0, 100.0)])
def test_what_a_coefficient_s_scatter_explains_counts_for_nothing(unsure: float, times: float) -> None:
    """Of 3, so much; where it may be all, it takes as long as any."""
    shown = Shown(9.0, 3.0, np.array([[1.0, 0.5], [0.5, 2.0]]))
    covariance = unsure / 4.0 * np.array([[1.0, 0.5], [0.5, 1.25]])
    assert np.trace(shown.form @ covariance) == pytest.approx(unsure)
    assert room._takes(shown, covariance, 3.0 / needed(), 100.0) == pytest.approx(times, rel=1e-3)


def fitted_with(of: Filtered, name: str, size: float) -> FittedModel:
    """A model with one effect whose coefficients are all of a size, in its plausible ones."""
    layout = of.layout({name: {}})
    theta = layout.mean.copy()
    theta[layout.of(name)] = [size * c.plausible for c in of.effect(name).coefficients]
    return at(of, layout, Model({name: {}}, theta, of.declared_noise()))


def group(of: Filtered, name: str, *others: str) -> tuple[FittedModel, dict[str, list[Member]]]:
    one = fitted_with(of, name, 1.0)
    return one, {name: [Member(other, 0.99, fitted_with(of, other, 1.0), 1.0) for other in others]}


def advice(name: str, *others: str) -> tuple[dict[tuple[str, str], Advice], list[Any]]:
    sense, drive = records(1, 1200)
    whole = replace(problem(sense[0], drive[0]), controller=CONTROLLER)
    model, groups = group(Filtered(whole), name, *others)
    told: list[Any] = []
    return separations(whole, model, groups, {}, lambda *what: told.append(what)), told


@pytest.mark.slow
def test_effects_that_a_modulation_separates_get_an_experiment() -> None:
    """A cubic spring moves the resonance by the square of the amplitude; a sense gain, which is linear, never does."""
    found, told = advice("cubic_stiffness", "sense_cubic")
    one = found["cubic_stiffness", "sense_cubic"]
    assert one.experiment is not None
    assert one.takes is not None
    assert one.takes > 0.0
    assert one.expected is not None
    assert 0.0 <= one.expected < 1.0
    assert one.words
    assert told[-1] == ("experiments", len(told), len(told))


@pytest.mark.slow
def test_what_has_the_same_equations_no_experiment_separates() -> None:
    """A spring that stiffens along both axes alike with the square of the radius, beside itself."""
    sense, drive = records(1, 1200)
    of = Filtered(replace(problem(sense[0], drive[0]), controller=CONTROLLER))
    model = fitted_with(of, "cubic_isotropic", 1.0)
    same = {"cubic_isotropic": [Member("cubic_isotropic:1", 1.0, fitted_with(of, "cubic_isotropic:1", 1.0), 0.0)]}
    found = separations(of.problem, model, same, {}, lambda *what: None)
    assert found == {("cubic_isotropic", "cubic_isotropic:1"): Advice()}


def test_no_group_has_no_experiment() -> None:
    sense, drive = records(1, 60)
    of = Filtered(problem(sense[0], drive[0]))
    assert separations(of.problem, fitted_with(of, "drag", 1.0), {"drag": []}, {}, print) == {}
