"""Fits against closed forms and an optimiser of SciPy's; of made records, against what they were made with."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import chi2

from estimator.trace.filtered import Filtered
from estimator.trace.fit import FittedModel, at, fit, maximise, settle
from estimator.trace.likelihood import BLOCKS, Evaluation, Layout, Model
from estimator.trace.problem import Effects
from tests.trace.linear import Linear, fitted, made
from tests.trace.plain import BASE, Array, problem, records

COLUMNS = {"one": np.random.default_rng(4).standard_normal((600, 1)), "two": np.ones((600, 2)) * [1.0, 0.0]}


def test_a_fit_is_an_optimiser_s_largest_penalised_likelihood() -> None:
    """With a prior that pulls, and a noise that is not the one assumed."""
    of = made({"one": COLUMNS["one"]}, {"one": [0.8]}, n=600)
    of = replace(of, y=2.5 * of.y)
    layout = of.layout({"one": {}})
    layout.deviation[:] = [0.2, 5.0, 0.1]
    layout.mean[:] = [1.0, 0.0, 0.4]
    found = maximise(of, at(of, layout, Model({"one": {}}, layout.mean, of.declared_noise())))
    used = np.column_stack([of.base, of.columns["one"]])

    def penalised(theta: Array) -> float:
        pull = (theta - layout.mean) / layout.deviation
        return -300.0 * float(np.log(2 * np.pi * np.mean((of.y - used @ theta) ** 2)) + 1.0) - 0.5 * float(pull @ pull)

    best = minimize(lambda theta: -penalised(theta), layout.mean, tol=1e-12)
    assert found.objective == pytest.approx(-best.fun, abs=0.02)
    off = found.model.theta - best.x
    assert off @ found.posterior_information @ off < 0.04
    declared = ((found.model.theta - layout.mean) / layout.deviation)[:2]  # the last is an effect's plausible size
    likelihood = 2.0 * found.evaluation.log_likelihood - declared @ declared
    data = used.T @ used / np.mean((of.y - used @ found.model.theta) ** 2)
    told = float(np.trace(np.linalg.solve(data + np.diag(layout.deviation**-2.0), data)))  # 1 − posterior over prior
    assert 2.0 < told < 3.0
    assert found.criterion == pytest.approx(likelihood - told * np.log(600.0))


def test_a_parameter_that_the_record_says_nothing_of_costs_nothing() -> None:
    """As the start of a low-pass that has settled before the first sample."""
    of = made({"one": np.column_stack([COLUMNS["one"], np.zeros_like(COLUMNS["one"])])}, {"one": [0.4, 0.0]}, n=600)
    alone = made({"one": COLUMNS["one"]}, {"one": [0.4]}, n=600)
    found = fitted(of, "one")
    assert found.told[-1] == pytest.approx(0.0, abs=1e-12)
    assert found.criterion == pytest.approx(fitted(alone, "one").criterion)


def test_a_coefficient_goes_no_lower_than_its_least() -> None:
    of = made({"one": COLUMNS["one"]}, {"one": [-0.5]}, n=600)
    layout = of.layout({"one": {}})
    layout.least[2] = 0.25
    found = settle(of, at(of, layout, Model({"one": {}}, layout.mean + 1.0, of.declared_noise())))
    assert found.model.theta[2] == 0.25


def test_a_gain_over_another_model_costs_the_parameters() -> None:
    of = made({"one": COLUMNS["one"]}, {"one": [0.4]}, n=600)
    small, large = fitted(of), fitted(of, "one")
    assert large.scatter == 1.0  # a fit to noise: no more than its own
    assert large.gain_over(small) == pytest.approx(large.criterion - small.criterion)
    jumpy = replace(large, evaluation=replace(large.evaluation, score=30.0 * large.evaluation.score))
    scores = jumpy.evaluation.score / jumpy.evaluation.scale
    spread = np.cov(scores.T, bias=True) * BLOCKS
    assert jumpy.scatter == pytest.approx(np.trace(np.linalg.solve(jumpy.posterior_information, spread)) / 3.0)
    assert jumpy.scatter > 10.0
    gained = 2.0 * (large.objective - small.objective)
    assert jumpy.gain_over(small) == pytest.approx(gained / jumpy.scatter - np.log(600.0))


@dataclass(frozen=True)
class Decay(Linear):
    """y = exp(−θ0 t) + θ1: far from linear, a whole step from a far start goes too far."""

    def evaluate(
        self, layout: Layout, model: Model, *, derivatives: bool = True, tested: Effects | None = None
    ) -> Evaluation:
        t = np.linspace(0.0, 4.0, len(self.y))
        with np.errstate(over="ignore", invalid="ignore"):
            curve = np.exp(-model.theta[0] * t)
            e = (self.y - curve - model.theta[1]) * 100.0
            psi = np.column_stack([-t * curve, np.ones_like(t)]) * 100.0
        parts = np.array_split(np.arange(len(e)), BLOCKS)
        with np.errstate(over="ignore", invalid="ignore"):
            return Evaluation(
                layout.names, np.array([psi[rows].T @ e[rows] for rows in parts]),
                np.array([psi[rows].T @ psi[rows] for rows in parts]), np.array([e[rows] @ e[rows] for rows in parts]),
                np.zeros(BLOCKS), np.array([float(len(rows)) for rows in parts]), e[:, None], np.ones((len(e), 1)),
            )  # fmt: skip


@pytest.mark.parametrize("start", [-1.5, 0.1, 8.0])
def test_a_fit_from_afar_comes_to_the_same_top(start: float) -> None:
    t = np.linspace(0.0, 4.0, 480)
    y = np.exp(-1.2 * t) + 0.3 + 0.01 * np.random.default_rng(3).standard_normal(480)
    of = Decay(y, np.zeros((480, 2)), {}, {})
    layout = of.layout({})
    found = maximise(of, at(of, layout, Model({}, np.array([start, 0.0]), of.declared_noise())), 40)
    best = minimize(lambda p: float(np.sum((y - np.exp(-p[0] * t) - p[1]) ** 2)), [1.0, 0.0], tol=1e-14)
    assert np.all(np.abs(found.model.theta - best.x) < 0.3 * np.sqrt(np.diag(found.covariance)))


def test_a_pass_that_fails_is_worth_nothing_and_no_start() -> None:
    of = Decay(np.ones(480), np.zeros((480, 2)), {}, {})
    layout = of.layout({})
    lost = at(of, layout, Model({}, np.array([-1e4, 0.0]), of.declared_noise()))
    assert not lost.evaluation.sound
    assert lost.objective == -np.inf
    assert maximise(of, lost) is lost
    kept = at(of, layout, Model({}, np.array([0.0, 0.3]), of.declared_noise()))
    assert kept.gain_over(lost) == kept.surplus_over(lost) == np.inf
    assert lost.criterion == -np.inf


DRAWS = 40


def errors(found: FittedModel) -> tuple[Array, Array]:
    """Of the base constants, over their deviations and all together (NEES)."""
    off = found.model.theta - np.array(list(BASE.values())) / found.layout.factor
    spread = found.covariance
    return off / np.sqrt(np.diag(spread)), off @ np.linalg.solve(spread, off)


@pytest.mark.slow
def test_errors_of_many_fits_are_as_large_as_their_covariance_says() -> None:
    sense, drive = records(DRAWS)
    found = [errors(fit(Filtered(problem(z, u)), {})) for z, u in zip(sense, drive, strict=True)]
    low, high = chi2.ppf([0.0005, 0.9995], DRAWS * len(BASE)) / DRAWS
    assert low < np.mean([nees for _, nees in found]) < high
    assert np.max(np.abs([each for each, _ in found])) < 4.0


@pytest.mark.moderate
@pytest.mark.parametrize("off", [0.97, 1.03])
def test_a_fit_finds_a_stiffness_that_is_declared_wrong(off: float) -> None:
    sense, drive = records(1)
    found = fit(Filtered(problem(sense[0], drive[0], off)), {})
    assert np.max(np.abs(errors(found)[0])) < 4.0
    assert found.evaluation.scale == pytest.approx(1.0, abs=0.1)
