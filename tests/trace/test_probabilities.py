"""How probable each account of a record is."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.trace.fit import FittedModel
from estimator.trace.probabilities import probabilities


def of_one(gain: float, deficit: float) -> dict[str, float]:
    """The probabilities where one effect is named, with a member of its group."""
    passed = SimpleNamespace(count=np.array([1000.0]), log_likelihood=-5.0)
    evidence: Any = SimpleNamespace(
        quiet=passed, disturbed=passed, without={"drive_gain": None}, model=SimpleNamespace(gain_over=lambda *_: gain)
    )
    member: Any = SimpleNamespace(name="sense_gain", deficit=deficit)
    (told,) = probabilities(evidence, [], {"drive_gain": [member]}, None)  # type: ignore[arg-type]
    return dict(told.probabilities)


def test_they_are_the_likelihoods_in_proportion() -> None:
    """By hand: nothing 1, the effect e³, its member e³ e⁻¹, something else e³ / 1000."""
    found = of_one(6.0, 2.0)
    weights = {"nothing": 1.0, "drive_gain": math.e**3, "sense_gain": math.e**2, "something else": math.e**3 / 1000.0}
    total = sum(weights.values())
    assert found == pytest.approx({name: weight / total for name, weight in weights.items()})


def test_a_model_that_loses_the_motion_without_the_effect_is_impossible() -> None:
    found = of_one(math.inf, 2.0)
    assert found["nothing"] == 0.0
    assert found["sense_gain"] == pytest.approx(found["drive_gain"] * math.exp(-1.0))
    assert sum(found.values()) == pytest.approx(1.0)


def test_what_scatters_of_one_effect_is_no_doubt_of_another() -> None:
    """Two coefficients; the scores of the first are far from constant from part to part, those of the second are."""
    layout: Any = SimpleNamespace(of=lambda name: {"first": [0], "second": [1]}[name])
    score = np.column_stack([np.tile([100.0, -100.0], 50), np.tile([1.0, 1.0, -1.0, -1.0], 25)])
    evaluation = SimpleNamespace(score=score, scale=1.0, count=np.array([1000.0]), share=1.0)
    model: Any = SimpleNamespace(
        evaluation=evaluation, layout=layout, posterior_information=100.0 * np.eye(2), scatter=5000.5,
        rise_over=lambda _: 1000.0, _price_beside=lambda _: 7.0,
    )  # fmt: skip
    model.widening = FittedModel.widening.func(model)
    assert model.widening == pytest.approx([10000.0 * 100.0 / 99.0, 100.0 / 99.0])
    gains = [FittedModel.gain_over(model, model, name) for name in ("first", "second", None)]
    assert gains == pytest.approx([1000.0 / model.widening[0] - 7.0, 990.0 - 7.0, 1000.0 / 5000.5 - 7.0])
