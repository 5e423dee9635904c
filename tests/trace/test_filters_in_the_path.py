"""Filters in the sense path, each at a corner that no start has: the score test tells its size, the fit its corner."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.effects.labels import kind
from estimator.scaling import Array
from estimator.trace.filtered import Filtered
from estimator.trace.fit import FittedModel, fit
from estimator.trace.likelihood import ObserverLayout
from estimator.trace.score_test import Score, score_test
from estimator.trace.search import shortlisted, with_effect
from tests.trace.plain import NOISE, OMEGA0, RATE, problem, records

N, CUT = 7000, 500


def behind(response: dict[int, NDArray[np.complex128]]) -> Filtered:
    """A record whose axes went through filters of these responses (N // 2 + 1,), without their start and end."""
    sense, drive = records(1, N)
    seen = sense[0].copy()
    for axis, gain in response.items():
        seen[:, axis] = np.fft.irfft(np.fft.rfft(seen[:, axis] - seen[:, axis].mean()) * gain, N)
    seen += NOISE * np.random.default_rng(3).standard_normal(seen.shape)
    inner = slice(CUT, N - CUT)
    return Filtered(problem(seen[inner], drive[0][inner]))


JOMEGA = np.asarray(2j * np.pi * np.fft.rfftfreq(N, 1.0 / RATE), dtype=np.complex128)


def first_of(of: Filtered) -> tuple[Score, FittedModel]:
    """Of the shortlist that which is most probable once it is fitted, and the model with it."""
    base = fit(of, {})
    table = score_test(of, base, of.candidates(base.model, base.evaluation))
    found = [(score, with_effect(of, base, score)) for score in shortlisted(table, 0.0)]
    return max(found, key=lambda pair: pair[1].criterion)


def sizes(found: FittedModel, name: str) -> tuple[Array, Array]:
    """The two coefficients of a filter, scaled, and their deviations."""
    own = found.layout.of(name)[:2]
    return found.model.theta[own], np.sqrt(np.diagonal(np.linalg.inv(found.posterior_information)))[own]


@pytest.mark.moderate
@pytest.mark.parametrize("lag", [0.25, 0.6, 0.9])
def test_a_low_pass_of_one_axis_is_first_and_as_large_as_it_is(lag: float) -> None:
    """At zero, its derivative is a delay's, and tells another sign on the axis that has none."""
    of = behind({1: np.asarray(1.0 / (1.0 + lag / OMEGA0 * JOMEGA), dtype=np.complex128)})
    score, found = first_of(of)
    assert kind(score.name) == "sense_low_pass"
    assert sizes(found, score.name)[0] == pytest.approx([0.0, lag], abs=0.02)
    assert found.layout.mean[found.layout.of(score.name)[:2]] == pytest.approx([0.0, 0.0])


@pytest.mark.moderate
@pytest.mark.parametrize("corner", [0.02, 0.05, 0.15])
def test_the_corner_of_a_high_pass_is_its_coefficient(corner: float) -> None:
    of = behind(dict.fromkeys((0, 1), JOMEGA / (JOMEGA + corner * OMEGA0)))
    score, found = first_of(of)
    assert kind(score.name) == "sense_high_pass"
    assert np.all(np.abs(sizes(found, score.name)[0] - corner) < 4.0 * sizes(found, score.name)[1])
    given = found.layout.effects_of(found.model)[score.name]
    layout, k = found.layout, found.layout.of(score.name)[0]
    assert given["leak_x"] == pytest.approx(found.model.theta[k] * layout.factor[k])


@pytest.mark.moderate
def test_a_derivative_by_a_tied_coefficient_moves_the_corner_too() -> None:
    of = behind(dict.fromkeys((0, 1), JOMEGA / (JOMEGA + 0.1 * OMEGA0)))
    base = fit(of, {})
    given = {"leak_x": 0.1 * OMEGA0, "leak_y": 0.1 * OMEGA0}
    (score,) = score_test(of, base, {"sense_high_pass": given})
    found = with_effect(of, base, score)
    layout, model = found.layout, found.model
    assert isinstance(layout, ObserverLayout)
    moved, step = layout.shifted(model)[0]
    ends = [of.evaluate(layout, one, derivatives=False) for one in (moved, model)]
    white = [np.nan_to_num(end.innovation / end.deviation)[100:] for end in ends]
    slope = (white[1] - white[0]) / step
    information = of.evaluate(layout, model).information.sum(axis=0)
    k = layout.of("sense_high_pass")[0]
    assert information[k, k] == pytest.approx(np.sum(slope**2), rel=2e-2)
