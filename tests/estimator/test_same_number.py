"""A corner that is also a size: whether the two agree, and which of them is known better."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.effects.catalogue import effect_for
from estimator.settings import ObserverSettings
from estimator.trace import observer_model
from estimator.trace.problem import Problem
from estimator.trace.same_number import agree, effects_of, same_numbers, surer
from estimator.trace.searched import Searched
from tests.estimator.device import NOMINAL as DEVICE

NAME = "sense_high_pass"
_, EFFECT = effect_for(NAME, 2)
SYMBOLS = [c.name for c in EFFECT.coefficients]


def model(hpx: float, hpy: float, deviation: float = 0.3, size: float = 1.0) -> Any:
    """With leaks of 3 and 2, innovations so many times as large as predicted."""
    given = {"leak_x": 3.0, "leak_y": 2.0}
    settings = ObserverSettings(effects={NAME: given})
    observer = SimpleNamespace(
        device=DEVICE, names=tuple(SYMBOLS), estimated=tuple(SYMBOLS), covariance=np.eye(4) * deviation**2,
        state=np.array([hpx, hpy, 0.5, 0.6]), effects=[effect_for(NAME, 2)], settings=settings,
    )  # fmt: skip
    estimates = SimpleNamespace(innovation=np.full((8, 2), size), innovation_deviation=np.ones((8, 2)))
    return SimpleNamespace(observer=observer, settings=settings, estimates=estimates)


def searched(*deviations: float, moved: float = 0.0) -> Searched:
    moves = np.zeros((4, 2))
    moves[SYMBOLS.index("hpx"), 0] = moved
    return Searched(("leak_x", "leak_y"), np.diag(np.square(deviations)), moves)


def test_the_corners_of_a_high_pass_are_its_sizes() -> None:
    assert same_numbers(EFFECT) == {"leak_x": "hpx", "leak_y": "hpy"}
    assert same_numbers(effect_for("drive_gain", 2)[1]) == {}


@pytest.mark.parametrize(
    ("hpx", "deviations", "moved", "size", "agreed"),
    [
        # four standard deviations: of 0.3 and 0.4 together 0.5, so 2
        (4.99, (0.4, 0.4), 0.0, 1.0, True),
        (5.01, (0.4, 0.4), 0.0, 1.0, False),
        (0.99, (0.4, 0.4), 0.0, 1.0, False),
        # innovations half as large again make both less sure
        (5.99, (0.4, 0.4), 0.0, 1.5, True),
        (6.01, (0.4, 0.4), 0.0, 1.5, False),
        # and what the leak's own deviation moves the size by: 0.3, 0.4 · 3 and 0.4 make 1.3
        (8.19, (0.4, 0.4), 3.0, 1.0, True),
        (8.21, (0.4, 0.4), 3.0, 1.0, False),
        # a leak along which the likelihood had no top is not known
        (3.0, (0.4, 0.0), 0.0, 1.0, False),
    ],
)
def test_a_size_agrees_with_its_corner_as_far_as_both_are_known(
    hpx: float, deviations: tuple[float, float], moved: float, size: float, agreed: bool
) -> None:
    problem: Problem = SimpleNamespace(device=DEVICE)  # type: ignore[assignment]
    assert agree(problem, model(hpx, 2.0, size=size), NAME, searched(*deviations, moved=moved)) is agreed


def test_of_one_number_the_one_that_is_known_better_counts() -> None:
    """The leak of x to 0.1, its size to 0.3; of y the other way round."""
    found = model(3.4, 2.5)
    told = searched(0.1, 0.9)
    assert surer(DEVICE, found, NAME, told) == {"hpx": "leak_x"}
    assert effects_of(found, {NAME: told})[NAME] == {
        "hpx": 3.0, "leak_x": 3.0, "hpy": 2.5, "leak_y": 2.5, "odx": 0.5, "ody": 0.6,
    }  # fmt: skip
    assert effects_of(found, {})[NAME]["hpx"] == 3.4
    sizes = observer_model.estimates_of(found, {NAME: told})[NAME]
    assert (sizes["hpx"].value, sizes["hpx"].low, sizes["hpx"].high) == pytest.approx((3.0, 2.804, 3.196), abs=1e-3)
    assert (sizes["hpy"].value, sizes["hpy"].low, sizes["hpy"].high) == pytest.approx((2.5, 1.912, 3.088), abs=1e-3)
    assert sizes["hpx"].positive
