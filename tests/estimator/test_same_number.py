"""A corner that is also a size: whether the two agree, and which of them is known better."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.effects.catalogue import effect_for
from estimator.settings import ObserverSettings
from estimator.trace import observer_model, parameters, same_number
from estimator.trace.parameters import refine_apart
from estimator.trace.problem import Problem
from estimator.trace.same_number import agree, effects_of, in_step, same_numbers, surer
from estimator.trace.searched import NOTHING, Searched
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


def fits(monkeypatch: pytest.MonkeyPatch, *following: Any) -> list[Any]:
    """What `in_step` fits is these, one after another; what was asked for is noted."""
    asked: list[Any] = []

    def fit(problem: Any, *, passes: int, about: Any) -> Any:
        asked.append((problem.effects[NAME], passes, about))
        return following[len(asked) - 1]

    monkeypatch.setattr(same_number, "fit", fit)
    return asked


def at(hpx: float, hpy: float, leaks: tuple[float, float], likelihood: float = 0.0, size: float = 1.0) -> Any:
    """A model with those coefficients and parameters; standard deviations 0.3, so near is within 0.06."""
    given = dict(zip(("leak_x", "leak_y"), leaks, strict=True))
    found = model(hpx, hpy, size=size)
    found.settings = found.observer.settings = replace(found.settings, effects={NAME: given})
    found.likelihood = likelihood
    return found


PROBLEM: Any = Problem(SimpleNamespace(), DEVICE, ObserverSettings())  # type: ignore[arg-type]


def test_a_corner_follows_its_size_until_that_moves_it_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = at(3.5, 2.05, (3.0, 2.0)), at(3.2, 2.2, (3.5, 2.0)), at(3.25, 2.15, (3.2, 2.2))
    asked = fits(monkeypatch, second, third)
    assert in_step(PROBLEM, first, NAME) == (third, True)
    kept = {"hpx": 3.5, "hpy": 2.05, "odx": 0.5, "ody": 0.6}
    assert asked[0] == ({**kept, "leak_x": 3.5, "leak_y": 2.0}, 1, first.observer)  # that of y is near its size
    assert asked[1] == ({**kept, "hpx": 3.2, "hpy": 2.2, "leak_x": 3.2, "leak_y": 2.2}, 1, second.observer)


def test_a_corner_may_be_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = at(0.5, 2.0, (3.0, 2.0)), at(0.5, 2.0, (0.5, 2.0))
    asked = fits(monkeypatch, second)
    assert in_step(PROBLEM, first, NAME) == (second, True)
    assert asked[0][0]["leak_x"] == 0.5


@pytest.mark.parametrize(
    ("hpx", "size", "as_it_is"),
    [
        (3.05, 1.0, True),
        (3.05, 1.02, True),  # its power is 1.04 of the predicted
        (3.05, 1.03, False),  # and 1.06
        (-3.0, 1.0, False),  # no corner could be there
        (0.0, 1.0, False),
    ],
)
def test_what_is_in_step_is_the_effect_as_it_is_where_nothing_is_left(
    monkeypatch: pytest.MonkeyPatch, hpx: float, size: float, as_it_is: bool
) -> None:
    assert not fits(monkeypatch)
    first = at(hpx, 2.0, (3.0, 2.0), size=size)
    assert in_step(PROBLEM, first, NAME) == (first, as_it_is)


def test_a_size_a_fifth_of_its_deviation_away_is_near(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not fits(monkeypatch)
    first = at(4.0, 2.0, (3.0, 2.0))
    first.observer.covariance = np.eye(4) * 25.0
    assert in_step(PROBLEM, first, NAME) == (first, True)


@pytest.mark.parametrize(("fell", "stays"), [(299.0, False), (300.0, True), (301.0, True)])
def test_where_the_likelihood_falls_the_corner_stays(monkeypatch: pytest.MonkeyPatch, fell: float, stays: bool) -> None:
    """By more than a start from a wide spread takes off."""
    first, second = at(3.5, 2.0, (3.0, 2.0), 1000.0), at(3.5, 2.0, (3.5, 2.0), 1000.0 - fell)
    fits(monkeypatch, second)
    assert in_step(PROBLEM, first, NAME) == ((first, False) if stays else (second, True))


def test_a_corner_that_never_rests_is_not_the_effect_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    models = [at(3.0 + 0.5 * number, 2.0, (2.5 + 0.5 * number, 2.0)) for number in range(20)]
    asked = fits(monkeypatch, *models[1:])
    found, as_it_is = in_step(PROBLEM, models[0], NAME)
    assert not as_it_is
    assert found is models[len(asked)]


def test_an_effect_without_such_a_corner_is_in_step_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not fits(monkeypatch)
    found = SimpleNamespace()
    assert in_step(PROBLEM, found, "drive_gain") == (found, True)  # type: ignore[arg-type]


def test_what_was_not_searched_for_follows_its_size() -> None:
    """The corner of x alone was: that of y is what the filter found of it anyhow."""
    told = Searched(("leak_x",), np.eye(1) * 0.01, np.zeros((4, 1)))
    found = effects_of(model(3.4, 2.5), {NAME: told})[NAME]
    assert (found["hpx"], found["leak_x"]) == (3.0, 3.0)
    assert (found["hpy"], found["leak_y"]) == (2.5, 2.0)


def test_a_number_is_as_sure_as_the_innovations_are_as_large_as_predicted() -> None:
    """Twice as large: all deviations double, and the likelier of the two stays the likelier."""
    pairs = same_number._pairs(DEVICE, model(3.4, 2.5, size=2.0), NAME, searched(0.1, 0.9))
    assert (pairs["hpx"].deviation, pairs["hpx"].own_deviation) == pytest.approx((0.6, 0.2))
    assert (pairs["hpy"].deviation, pairs["hpy"].own_deviation) == pytest.approx((0.6, 1.8))


def test_two_that_are_known_as_well_are_the_filters() -> None:
    """And so is one along which the likelihood had no top."""
    assert surer(DEVICE, model(3.4, 2.5), NAME, searched(0.3, 0.3)) == {}
    assert surer(DEVICE, model(3.4, 2.5), NAME, searched(0.0, 0.0)) == {}


@pytest.mark.parametrize(("hpx", "agreed"), [(5.0, True), (np.nextafter(5.0, 6.0), False)])
def test_four_deviations_apart_still_agree(hpx: float, agreed: bool) -> None:
    """Deviations of 0.3 and 0.4 make 0.5."""
    assert agree(PROBLEM, model(hpx, 2.0), NAME, searched(0.4, 0.4)) is agreed


def test_of_an_effect_without_parameters_nothing_was_searched_for() -> None:
    assert (NOTHING.names, NOTHING.covariance.shape, NOTHING.moves.shape) == ((), (0, 0), (0, 0))


def test_a_search_came_to_the_top_only_where_that_is_said_of_it() -> None:
    assert not Searched((), np.zeros((0, 0)), np.zeros((0, 0))).at_top


@pytest.mark.parametrize(
    ("reached", "hpx", "span", "taken", "told"),
    [
        (11.0, 3.1, 9.0, True, True),
        (11.0, -8.0, 9.0, True, False),  # its size has the phase of something else in it, and no account of the corner
        (10.0, 3.1, 9.0, False, False),  # no likelier than where it began
        (-np.inf, 3.1, 9.0, False, False),
        (11.0, 3.1, 0.51, True, True),
        (11.0, 3.1, 0.49, False, False),  # a leak of 2 per second turns by less than one in that time
    ],
)
def test_a_corner_goes_to_its_top_whatever_the_size_says(
    monkeypatch: pytest.MonkeyPatch, reached: float, hpx: float, span: float, taken: bool, told: bool
) -> None:
    begun, found, top = at(-5.0, 2.0, (30.0, 20.0), 10.0), at(hpx, 2.0, (3.0, 2.0), reached), searched(0.1, 0.1)

    def refined(problem: Any, model: Any, name: str, names: tuple[str, ...], before: None, to_beat: float) -> Any:
        assert (model, name, names, before, to_beat) == (begun, NAME, ("leak_x", "leak_y"), None, -np.inf)
        return found, top

    monkeypatch.setattr(parameters, "_refined", refined)
    asked: Any = Problem(SimpleNamespace(step=np.full(3, span / 3)), DEVICE, ObserverSettings())  # type: ignore[arg-type]
    assert refine_apart(asked, begun, NAME) == (found if taken else begun, top if told else NOTHING)


@pytest.mark.parametrize(("name", "likelihood"), [("drive_gain", 10.0), (NAME, -np.inf)])
def test_nothing_is_looked_for_without_a_corner_or_a_model(name: str, likelihood: float) -> None:
    begun = at(3.0, 2.0, (3.0, 2.0), likelihood)
    assert refine_apart(PROBLEM, begun, name) == (begun, NOTHING)
