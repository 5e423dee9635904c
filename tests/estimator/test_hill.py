"""The climb over an effect's parameters: to the top of likelihoods in closed form, in few models; what is asked and
what is told.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.trace import fitting, parameters, same_number
from estimator.trace.parameters import Hill, refine_parameters
from estimator.trace.problem import Problem
from estimator.trace.searched import NOTHING, Searched

DEVICE = Device(
    sample_rate=4000.0, stiffness=(1.6e6, 1.62e6, 0.0), damping=(1.0, 1.2, 0.0), amplitude=1e-4,
    sense_gain=(-890.0, 900.0), noise=(1e-4, 1e-4),
)  # fmt: skip
PROBLEM = Problem(
    Record(np.zeros((800, 2)), np.zeros((800, 2, 1)), np.full(800, 1 / 4000.0)), DEVICE, ObserverSettings()
)
Likelihood = Callable[[Array], float]

# Twice the log-likelihood of 10,000 samples with a sense channel that clips at 12.392 µm, over the level.
LEVELS = (10.0, 10.966, 11.819, 12.015, 12.184, 12.294, 12.36, 12.371, 12.392, 12.423, 12.478, 12.491)
GAINS = (3900, 4950, 7970, 9440, 11380, 13280, 14540, 14710, 14861, 14400, 8770, 10)


class Counted:
    """A hill of a likelihood in closed form, and how many models it took."""

    def __init__(self, likelihood: Likelihood, turned: Callable[[Array], bool] = lambda place: False) -> None:
        self.hill = Hill.__new__(Hill)
        self.hill.seen, self.hill.passed = {}, []
        self.models: list[Array] = []

        def at_each(places: Any) -> list[float]:
            for place in places:
                if place.tobytes() not in self.hill.seen:
                    self.models.append(place.copy())
                    self.hill.seen[place.tobytes()] = likelihood(place), np.zeros(1)
                    self.hill.passed.append((place.copy(), ObserverSettings()))
            return [self.hill.seen[place.tobytes()][0] for place in places]

        self.hill.at_each = at_each  # type: ignore[method-assign]
        self.hill.at = lambda place: at_each([place])[0]  # type: ignore[method-assign]
        self.hill.turned = turned  # type: ignore[method-assign]


def parabola(top: float, deviation: float) -> Likelihood:
    return lambda place: -(((place[0] - top) / deviation) ** 2)


def walled(likelihood: Likelihood, low: float, high: float) -> Likelihood:
    """Beyond these there is no model."""
    return lambda place: likelihood(place) if low < place[0] < high else -np.inf


# By name: the likelihood, its top, the deviation there, where it begins and with which step, models at most: what it
# takes, so that a change that makes every candidate dearer is seen.
HILLS: dict[str, tuple[Likelihood, float, float, float, float, int]] = {
    "at the top": (parabola(5.0, 0.01), 5.0, 0.01, 5.0, 0.01, 3),
    "near the top": (parabola(5.0, 0.01), 5.0, 0.01, 5.004, 0.01, 8),
    "wide steps": (parabola(5.0, 1e-4), 5.0, 1e-4, 5.02, 1.0, 6),
    "narrow steps": (parabola(5.0, 0.3), 5.0, 0.3, 5.1, 1e-3, 18),
    "far below": (parabola(500.0, 0.01), 500.0, 0.01, 5.0, 1.0, 18),
    "far above": (parabola(0.01, 1e-5), 0.01, 1e-5, 5.0, 1.0, 18),
    "a power law": (lambda place: -400.0 * np.log(place[0] / 3.0) ** 2, 3.0, 3.0 / 20.0, 9.0, 0.9, 21),
    "a step too long": (parabola(5.0, 0.01), 5.0, 0.01, 4.8, 40.0, 8),
    "a wall above": (walled(parabola(5.0, 0.01), 0.0, 5.1), 5.0, 0.01, 4.9, 0.4, 11),
    "a wall below": (walled(parabola(5.0, 0.01), 4.9, 9e9), 5.0, 0.01, 5.1, 0.4, 11),
    "a slope to one side": (
        lambda place: -(((place[0] - 5.0) / 0.05) ** 2) - 40.0 * (place[0] - 5.0) ** 3, 5.0, 0.05, 5.4, 0.3, 11,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HILLS)
def test_a_climb_ends_at_the_top_in_few_models(name: str) -> None:
    """To a fifth of a standard deviation, which is that of the parabola there."""
    likelihood, top, deviation, begin, width, most = HILLS[name]
    counted = Counted(likelihood)
    place, found = counted.hill.climb(np.array([begin]), 0, width)
    assert abs(place[0] - top) <= 0.2 * deviation
    assert found == pytest.approx(deviation, rel=0.05)
    assert np.all(np.array(counted.models) > 0.0)
    assert len(counted.models) <= most


def test_a_top_that_is_no_parabola_is_come_near() -> None:
    counted = Counted(lambda place: -(((place[0] - 5.0) / 0.1) ** 4))
    place, deviation = counted.hill.climb(np.array([5.3]), 0, 0.5)
    assert abs(place[0] - 5.0) < 0.05
    assert 0.05 < deviation < 0.2
    assert len(counted.models) <= 11


def test_where_the_likelihood_says_nothing_the_parameter_stays_and_nothing_is_known_of_it() -> None:
    """Steps three times as long each, up to half of the parameter."""
    counted = Counted(lambda place: 0.2 * np.cos(40.0 * place[0]))
    place, deviation = counted.hill.climb(np.array([5.0]), 0, 0.1)
    assert (place[0], deviation) == (5.0, 0.0)
    assert sorted({round(abs(one[0] - 5.0), 9) for one in counted.models}) == [0.0, 0.1, 0.3, 0.9, 2.5]


def test_a_slope_without_a_top_is_left_after_twelve_steps() -> None:
    """Each half of what is left of the parameter at most: it never becomes negative."""
    counted = Counted(lambda place: -10.0 * float(np.log(place[0])))
    place, deviation = counted.hill.climb(np.array([1.0]), 0, 0.1)
    assert deviation == 0.0
    assert 0.0 < place[0] < 1e-6
    assert len(counted.models) <= 16


@pytest.mark.parametrize("variance", [1.0, 400.0, 1e6])
def test_where_much_is_left_a_climb_is_as_short_and_a_top_as_wide_as_that_makes_it(variance: float) -> None:
    """A parabola so many times as steep as the parameter is sure, under a roughness below what says anything."""

    def rough(place: Array) -> float:
        return -variance * (((place[0] - 5.0) / 0.1) ** 2 + 0.02 * float(np.sin(1e5 * place[0])))

    counted = Counted(rough)
    counted.hill.variance = variance
    place, deviation = counted.hill.climb(np.array([5.4]), 0, 0.5)
    assert abs(place[0] - 5.0) <= 0.02
    assert deviation == pytest.approx(0.1, rel=0.05)
    assert len(counted.models) <= 8


def test_several_together_are_as_unsure_as_what_is_left_makes_them() -> None:
    counted = Counted(quadratic(np.array([2.0, 5.0, 1.0]), C))
    counted.hill.variance = 16.0
    place, covariance, _ = counted.hill.together(np.array([1.7, 5.5, 1.05]), np.array([0.2, 0.3, 0.1]))
    np.testing.assert_allclose(covariance, 16.0 * C, atol=1e-11)
    np.testing.assert_allclose(place, [2.0, 5.0, 1.0], rtol=1e-9)


def test_where_the_likelihood_jumps_a_climb_ends() -> None:
    """The first model found a start that no later one finds again: beside it all are lower, however near."""
    counted = Counted(lambda place: -1e3 * (place[0] - 5.0) ** 2 - 800.0 * float(place[0] != 5.2))
    place, _ = counted.hill.climb(np.array([5.2]), 0, 0.5)
    assert place[0] == 5.2
    assert len(counted.models) <= 6


@pytest.mark.parametrize("begin", [12.0, 12.1844, 12.3])
def test_a_cliff_beside_the_top_is_no_jump_of_it(begin: float) -> None:
    """A level that cuts the tops by less and less; above 12.491 it cuts none, and all that was gained is lost."""

    def clipped(place: Array) -> float:
        return float(PchipInterpolator(LEVELS, GAINS)(place[0])) if 10.0 < place[0] < 12.491 else 0.0

    counted = Counted(clipped)
    place, found = counted.hill.climb(np.array([begin]), 0, 0.1 * begin)
    assert abs(place[0] - 12.392) < 0.005
    assert 0.0 < found < 0.01
    assert len(counted.models) <= 30


def test_a_cliff_at_the_top_ends_a_climb() -> None:
    counted = Counted(lambda place: 1000.0 * float(place[0]) if place[0] <= 5.0 else -20000.0)
    place, _ = counted.hill.climb(np.array([5.0]), 0, 0.5)
    assert place[0] == 5.0
    assert len(counted.models) <= 14


def test_a_cusp_is_a_top() -> None:
    counted = Counted(lambda place: -1e3 * abs(float(place[0]) - 5.0))
    place, _ = counted.hill.climb(np.array([5.3]), 0, 0.5)
    assert abs(place[0] - 5.0) < 0.01


def test_several_climb_along_their_own_axis_only() -> None:
    counted = Counted(lambda place: -float((place[0] - 2.0) ** 2 / 0.01 + (place[1] - 7.0) ** 2 / 0.04))
    place, deviation = counted.hill.climb(np.array([3.0, 9.0]), 1, 0.5)
    assert (place[0], place[1], deviation) == (3.0, pytest.approx(7.0, abs=0.04), pytest.approx(0.2, rel=0.05))
    assert all(one[0] == 3.0 for one in counted.models)


def test_a_climb_ends_where_the_effect_is_a_simpler_one() -> None:
    counted = Counted(parabola(0.01, 1e-3), turned=lambda place: bool(place[0] < 1.0))
    place, deviation = counted.hill.climb(np.array([5.0]), 0, 1.0)
    assert place[0] < 1.0
    assert deviation == 0.0
    standing = Counted(parabola(5.0, 0.01), turned=lambda place: True)
    assert standing.hill.climb(np.array([5.0]), 0, 0.01) == (np.array([5.0]), 0.0)
    assert standing.models == []


def test_a_climb_that_is_hopeless_ends_short_of_the_top_and_knows_how_wide_it_is() -> None:
    counted = Counted(parabola(5.0, 0.01))
    place, deviation = counted.hill.climb(np.array([5.02]), 0, 0.01, lambda promised: len(counted.models) >= 3)
    assert place[0] != pytest.approx(5.0, abs=1e-3)
    assert deviation == pytest.approx(0.01)


def test_whether_a_climb_is_hopeless_is_asked_with_what_its_parabola_promises() -> None:
    """Two deviations beside the top: four in twice the log-likelihood, before a model of it was made."""
    told: list[float] = []
    counted = Counted(parabola(5.0, 0.01))
    counted.hill.climb(np.array([5.02]), 0, 0.01, lambda promised: told.append(promised) or False)
    assert told == [pytest.approx(4.0)]


@pytest.mark.parametrize(
    ("side", "width", "moves", "first", "second"),
    [
        (1.0, 0.5, 1, 0.5, 1.0),  # as it is asked, then twice as long
        (-1.0, 0.5, 1, -0.5, -1.0),
        (1.0, 9.0, 1, 2.0, 4.0),  # half of the parameter at most, then twice that
        (-1.0, 9.0, 2, -3.0, -0.875),
    ],
)
def test_a_step_uphill_and_the_one_after_it_are_tried_side_by_side(
    side: float, width: float, moves: int, first: float, second: float
) -> None:
    """Of a parameter of 4."""
    for slope, taken in ((side, first), (-side, 0.0)):
        counted = Counted(lambda place, slope=slope: slope * 10.0 * place[0])
        assert counted.hill._rises(np.array([4.0]), side, width, 0, moves) == pytest.approx(taken)
        assert [one[0] for one in counted.models] == pytest.approx([4.0, 4.0 + first, 4.0 + first + second])
        counted.hill._rises(np.array([4.0]), side, width, 0, moves)
        assert len(counted.models) == 3  # what is known is not asked again
    level = Counted(lambda place: 0.4 * float(place[0] > 4.0))  # less than says anything
    assert level.hill._rises(np.array([4.0]), 1.0, 0.5, 0, 1) == 0.0
    lost = Counted(lambda place: np.inf if place[0] > 4.0 else 0.0)
    assert lost.hill._rises(np.array([4.0]), 1.0, 0.5, 0, 1) == 0.0


# -- several at once --------------------------------------------------------------------------------------------------


def quadratic(top: Array, covariance: Array) -> Likelihood:
    inverse = np.linalg.inv(covariance)
    return lambda place: -float((place - top) @ inverse @ (place - top))


C = np.array([[0.04, 0.01, 0.0], [0.01, 0.09, -0.02], [0.0, -0.02, 0.01]])


def test_three_together_go_to_the_top_in_one_step_and_see_that_it_is_one() -> None:
    top = np.array([2.0, 5.0, 1.0])
    counted = Counted(quadratic(top, C))
    place, covariance, at_top = counted.hill.together(np.array([1.7, 5.5, 1.05]), np.array([0.2, 0.3, 0.1]))
    assert at_top
    np.testing.assert_allclose(place, top, rtol=1e-9)
    np.testing.assert_allclose(covariance, C, atol=1e-12)
    assert len(counted.models) <= 21  # twice the ten of a quadratic in three numbers, and one that gains nothing


def test_from_a_saddle_none_is_moved_and_each_stays_as_sure_as_it_was() -> None:
    counted = Counted(lambda place: float(place[0] ** 2 - place[1] ** 2))
    place, covariance, at_top = counted.hill.together(np.array([3.0, 4.0]), np.array([0.2, 0.3]))
    assert not at_top
    np.testing.assert_array_equal(place, [3.0, 4.0])
    np.testing.assert_allclose(covariance, np.diag([0.04, 0.09]))
    lost = Counted(lambda place: np.nan)
    np.testing.assert_array_equal(lost.hill.together(np.array([3.0, 4.0]), np.array([0.2, 0.3]))[0], [3.0, 4.0])


def test_no_step_makes_a_parameter_negative() -> None:
    counted = Counted(quadratic(np.array([-3.0, 4.0]), np.diag([1.0, 1.0])))
    place, _, _ = counted.hill.together(np.array([1.0, 4.0]), np.array([0.1, 0.1]))
    assert np.all(np.array(counted.models) > -0.1 * (1.0 + 1e-9))  # but for the differences
    assert 0.0 < place[0] < 0.1


def test_a_step_that_gains_nothing_is_not_taken() -> None:
    """A parabola at its foot, and no more than that: the likelihood falls where its top should be."""
    counted = Counted(lambda place: -float(np.sum((place - 1.0) ** 2)) if place[0] > 1.9 else -99.0)
    place, _, at_top = counted.hill.together(np.array([2.0, 2.0]), np.array([0.05, 0.05]))
    np.testing.assert_array_equal(place, [2.0, 2.0])
    assert not at_top


# -- the hill itself --------------------------------------------------------------------------------------------------


class Models:
    """In the place of fits: a likelihood of the parameters that are asked, each from where it began."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, turned: Callable[[dict[str, float]], bool]) -> None:
        self.asked: list[tuple[float, float, int, float]] = []
        self.about: list[Any] = []

        def fit(problem: Problem, passes: int = 2, about: Any = None) -> Any:
            given = problem.effects["parasitic_mode"]
            self.asked.append((given["omega"], given["zeta"], passes, problem.settings.initial["kxx"]))
            self.about.append(about)
            settings = problem.settings
            likelihood = -((given["omega"] - 700.0) ** 2)
            found = ObserverSettings(initial={"kxx": given["omega"]}, effects=settings.effects)
            estimates = innovations(3.0 if given["omega"] == 690.0 else 5.0)
            return SimpleNamespace(settings=found, likelihood=likelihood, observer=given, estimates=estimates)

        monkeypatch.setattr(parameters, "fit", fit)
        monkeypatch.setattr(
            parameters, "coefficients_of", lambda given: {"parasitic_mode": dict.fromkeys(SYMBOLS, given["omega"])}
        )
        monkeypatch.setattr(
            parameters, "turned_into", lambda problem, name, given: "a simpler one" if turned(given) else None
        )


SYMBOLS = ("rxx", "rxy", "ryx", "ryy", "px", "py", "rx", "ry", "gx", "gy", "ax", "ay")


def innovations(size: float) -> Any:
    """So many times as large as was predicted."""
    return SimpleNamespace(innovation=size * np.array([[1e-4, -1e-4]]), innovation_deviation=np.full((1, 2), 1e-4))


def model(size: float = 7.0) -> Any:
    settings = ObserverSettings(initial={"kxx": 1.0}, effects={"parasitic_mode": {"omega": 600.0, "zeta": 0.01}})
    return SimpleNamespace(settings=settings, likelihood=-10_000.0, estimates=innovations(size))


def hill(monkeypatch: pytest.MonkeyPatch, turned: Callable[[dict[str, float]], bool]) -> tuple[Hill, Models]:
    models = Models(monkeypatch, turned)
    made = Hill(PROBLEM, model(), "parasitic_mode", ("omega", "zeta"))
    monkeypatch.setattr(made, "_coefficients", lambda tried: np.array([tried.observer["omega"]]))
    return made, models


def test_each_place_is_fitted_once_in_one_pass_from_where_those_before_lead(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stub finds kxx = ω: moved on along the line of two models, it is begun with right."""
    made, models = hill(monkeypatch, lambda given: False)
    a, b, c = (np.array([omega, 0.02]) for omega in (650.0, 690.0, 640.0))
    assert made.at_each([a, b, a]) == [-2500.0, -100.0, -2500.0]
    assert models.asked == [(650.0, 0.02, 1, 1.0), (690.0, 0.02, 1, 1.0)]
    assert made.at(c) == -3600.0
    assert made.at(a) == -2500.0
    assert models.asked[2:] == [(640.0, 0.02, 1, 640.0)]
    assert made.highest == -100.0
    assert models.about == [None] * 3
    assert made.fitted(a).settings.initial["kxx"] == 650.0
    assert models.asked[3:] == [(650.0, 0.02, 1, 650.0)]  # a pass about the best, which is its second
    assert models.about[3] is made.model.observer
    made.model.likelihood = -np.inf  # unless that diverged
    made.fitted(a)
    assert (models.asked[4], models.about[4]) == ((650.0, 0.02, 2, 650.0), None)


def test_a_place_on_no_line_with_two_that_were_passed_begins_with_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    made, models = hill(monkeypatch, lambda given: False)
    made.at(np.array([650.0, 0.02]))
    assert models.asked[-1][3] == 1.0  # with the model that was given
    made.at(np.array([690.0, 0.02]))
    assert models.asked[-1][3] == 650.0
    made.at(np.array([680.0, 0.03]))  # both have moved
    assert models.asked[-1][3] == 690.0
    made.at(np.array([690.0, 0.03]))  # ζ alone has, of which nothing was tried
    assert models.asked[-1][3] == 690.0
    made.at(np.array([690.0, 0.05]))  # there, with what is known of ζ: kxx goes with ω alone
    assert models.asked[-1][3] == 690.0
    made.at(np.array([710.0, 0.02]))
    assert models.asked[-1][3] == pytest.approx(710.0)


@pytest.mark.parametrize(("omega", "begun"), [(800.0, 694.0), (600.0, 686.0)])
def test_two_places_that_lie_close_say_nothing_of_what_is_far(
    monkeypatch: pytest.MonkeyPatch, omega: float, begun: float
) -> None:
    """No further than twice as far as they lie apart, on either side of the best."""
    made, models = hill(monkeypatch, lambda given: False)
    made.at(np.array([688.0, 0.02]))
    made.at(np.array([690.0, 0.02]))
    made.at(np.array([omega, 0.02]))
    assert models.asked[-1][3] == pytest.approx(begun)


def test_settings_between_two_have_the_share_of_what_moves_and_keep_the_rest() -> None:
    one = ObserverSettings(initial={"kxx": 1.0, "dxx": 5.0}, effects={"parasitic_mode": {"omega": 2.0, "rx": 4.0}})
    other = ObserverSettings(initial={"kxx": 3.0}, effects={"parasitic_mode": {"omega": 2.0, "rx": 0.0}})
    found = parameters.between(one, other, 1.5)
    assert found.initial == {"kxx": 4.0, "dxx": 5.0}
    assert found.effects == {"parasitic_mode": {"omega": 2.0, "rx": -2.0}}


def test_where_the_effect_is_a_simpler_one_a_model_of_one_pass_will_do(monkeypatch: pytest.MonkeyPatch) -> None:
    made, models = hill(monkeypatch, lambda given: given["omega"] > 680.0)
    best, other = np.array([690.0, 0.02]), np.array([720.0, 0.02])
    made.at_each([best, other])
    assert made.turned(best)
    assert not made.turned(np.array([600.0, 0.01]))
    assert made.fitted(best) is made.model
    assert len(models.asked) == 2
    made.fitted(other)
    assert models.asked[2:] == [(720.0, 0.02, 1, 720.0)]


def test_coefficients_are_those_of_the_effect_in_the_order_of_its_declaration(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Hill(PROBLEM, model(), "interference:3", ("omega",))
    found = {"lcx": 1.0, "lsx": 2.0, "lcy": 3.0, "lsy": 4.0, "omega": 9.0}
    monkeypatch.setattr(parameters, "coefficients_of", lambda observer: {"interference:3": found})
    assert sorted(made._coefficients(SimpleNamespace(observer=None)).tolist()) == [1.0, 2.0, 3.0, 4.0]  # type: ignore[arg-type]


def test_what_a_difference_says_is_counted_in_the_variance_of_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    made, _ = hill(monkeypatch, lambda given: False)
    assert made.variance == pytest.approx(49.0)
    made.at(np.array([650.0, 0.02]))
    assert made.variance == pytest.approx(25.0)
    made.at(np.array([690.0, 0.02]))
    assert made.variance == pytest.approx(9.0)
    made.at(np.array([600.0, 0.02]))  # worse
    assert made.variance == pytest.approx(9.0)
    assert Hill(PROBLEM, model(0.5), "parasitic_mode", ("omega", "zeta")).variance == 1.0  # never surer than predicted
    lost = model()
    lost.likelihood = -np.inf
    assert Hill(PROBLEM, lost, "parasitic_mode", ("omega", "zeta")).variance == 1.0


def test_a_parameter_of_which_nothing_is_known_moves_nothing() -> None:
    counted = Counted(lambda place: 0.0)
    hill = counted.hill
    at_each = hill.at_each

    def noting(places: Any) -> list[float]:
        found = at_each(places)
        for place in places:
            hill.seen[place.tobytes()] = 0.0, np.array([2.0 * place[0], place[0] + 5.0 * place[1]])
        return found

    hill.at_each = noting  # type: ignore[method-assign]
    np.testing.assert_allclose(hill.moves(np.array([3.0, 4.0]), np.array([0.1, 0.0])), [[2.0, 0.0], [1.0, 0.0]])


@pytest.mark.parametrize(
    ("tried", "sides"),
    [
        ([], (4.75, 5.25)),  # a deviation away
        ([5.0], (4.75, 5.25)),  # the place itself is on neither side
        ([4.25, 5.125, 5.75], (4.25, 5.75)),  # the farthest that is near
        ([5.75, 5.7578125], (4.75, 5.75)),
        ([3.0, 4.9375, 9.0], (4.9375, 5.25)),
    ],
)
def test_what_a_parameter_moves_is_seen_a_deviation_away_or_where_it_was_tried_as_near_as_three(
    tried: list[float], sides: tuple[float, float]
) -> None:
    """Along its own line: where another parameter is other, it says nothing of this one."""
    hill = Counted(lambda place: 0.0).hill
    hill.at_each([*(np.array([one, 7.0]) for one in tried), np.array([5.375, 7.5]), np.array([4.5, 6.0])])
    low, high = hill._beside(np.array([5.0, 7.0]), 0, 0.25)
    assert (low.tolist(), high.tolist()) == ([sides[0], 7.0], [sides[1], 7.0])


def test_what_stays_where_nothing_is_known_of_it_has_not_moved() -> None:
    unsure = Searched(("v0",), np.zeros((1, 1)), np.zeros((1, 1)))
    assert parameters._stand({"v0": 0.5}, {"v0": 0.5}, unsure)
    assert not parameters._stand({"v0": 0.5}, {"v0": 0.25}, unsure)


# -- what is refined --------------------------------------------------------------------------------------------------


class Climbs:
    """In the place of a hill: what was climbed, and from where with which steps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked: list[tuple[tuple[float, ...], int, float]] = []
        self.deviations, self.is_turned, self.highest, self.variance = [0.5, 0.25], False, -np.inf, 1.0
        self.promised = 0.0
        self.at_top = True
        monkeypatch.setattr(parameters, "Hill", self)

    def __call__(self, problem: Problem, model: Any, name: str, names: tuple[str, ...]) -> "Climbs":
        self.names = names
        return self

    def at(self, place: Array) -> float:
        return -100.0

    def climb(self, place: Array, index: int, width: float, hopeless: Callable[[float], bool]) -> tuple[Array, float]:
        self.asked.append((tuple(place.tolist()), index, width))
        self.hopeless = hopeless(self.promised)
        return place + 1.0, self.deviations[index]

    def turned(self, place: Array) -> bool:
        return self.is_turned

    def together(self, place: Array, deviation: Array) -> tuple[Array, Array, bool]:
        assert deviation.tolist() == self.deviations
        return place * 10.0, np.array([[9.0, 1.0], [1.0, 4.0]]), self.at_top

    def moves(self, place: Array, deviation: Array) -> Array:
        return np.full((12, len(place)), 7.0)

    def fitted(self, place: Array) -> Any:
        return Place(place.tolist())


class Place(tuple[float, ...]):
    """Where a climb ended, as good a model as any."""

    __slots__ = ()
    likelihood = np.inf


MODE, LINE = {"omega": 600.0, "zeta": 0.01}, {"omega": 600.0}


def carrying(name: str, given: dict[str, float], likelihood: float = 0.0) -> Any:
    return SimpleNamespace(settings=ObserverSettings(effects={name: given}), likelihood=likelihood)


def test_each_parameter_climbs_by_itself_then_all_together(monkeypatch: pytest.MonkeyPatch) -> None:
    climbs = Climbs(monkeypatch)
    found, searched = refine_parameters(PROBLEM, carrying("parasitic_mode:12", MODE), "parasitic_mode:12")
    assert climbs.asked == [((600.0, 0.01), 0, 6.0), ((601.0, 1.01), 1, 0.001)]  # half its width, and a tenth
    assert found == pytest.approx((6020.0, 20.1))
    assert searched.names == ("omega", "zeta")
    assert (searched.deviation("omega"), searched.deviation("zeta")) == (3.0, 2.0)
    assert searched.moves.shape == (12, 2)
    climbs.variance = 4.0  # which the interval of a parameter counts in
    _, searched = refine_parameters(PROBLEM, carrying("parasitic_mode", MODE), "parasitic_mode")
    assert (searched.deviation("omega"), searched.deviation("zeta")) == (1.5, 1.0)
    climbs.variance = 1.0
    climbs.deviations = [0.5, 0.0]  # one of which nothing is known
    found, searched = refine_parameters(PROBLEM, carrying("parasitic_mode", MODE), "parasitic_mode")
    assert found == pytest.approx((602.0, 2.01))
    np.testing.assert_array_equal(searched.covariance, np.diag([0.25, 0.0]))


@pytest.mark.parametrize(("zeta", "width"), [(1e-4, 0.06), (0.05, 30.0), (0.3, 60.0)])
def test_a_mode_s_first_step_is_half_its_width_and_a_tenth_at_most(
    monkeypatch: pytest.MonkeyPatch, zeta: float, width: float
) -> None:
    """Of a mode of ζ = 0.004 that began 0.14 % beside its top, steps of a tenth saw the top between them."""
    climbs = Climbs(monkeypatch)
    refine_parameters(PROBLEM, carrying("parasitic_mode", {**MODE, "zeta": zeta}), "parasitic_mode")
    assert [one[2] for one in climbs.asked] == pytest.approx([width, 0.1 * zeta])


def test_a_frequency_by_itself_begins_with_half_a_radian_over_the_record(monkeypatch: pytest.MonkeyPatch) -> None:
    climbs = Climbs(monkeypatch)
    found, searched = refine_parameters(PROBLEM, carrying("interference", LINE), "interference")
    assert climbs.asked == [((600.0,), 0, pytest.approx(0.5 / 0.2))]
    assert found == (601.0,)
    np.testing.assert_array_equal(searched.covariance, [[0.25]])
    assert searched.moves.shape == (12, 1)


@pytest.mark.parametrize(("known", "width"), [(0.1, 0.3), (40.0, 6.0), (0.0, 6.0)])
def test_what_was_found_before_makes_the_steps_smaller(
    monkeypatch: pytest.MonkeyPatch, known: float, width: float
) -> None:
    """Three of its standard deviations, where it had any."""
    climbs = Climbs(monkeypatch)
    before = Searched(("omega", "zeta"), np.diag([known**2, 1e-10]), np.zeros((1, 2)))
    refine_parameters(PROBLEM, carrying("parasitic_mode", MODE), "parasitic_mode", before=before)
    assert [one[2] for one in climbs.asked] == pytest.approx([width, 3e-5])
    climbs.asked.clear()
    refine_parameters(PROBLEM, carrying("parasitic_mode", MODE), "parasitic_mode", before=NOTHING)
    assert [one[2] for one in climbs.asked] == pytest.approx([6.0, 0.001])


@pytest.mark.parametrize(
    ("to_beat", "promised", "is_hopeless", "ends"),
    [
        (-np.inf, 0.0, False, False),
        (539.0, 0.0, False, False),
        (541.0, 0.0, True, True),
        (559.0, 5.0, False, True),  # it climbs on, and is asked again where it has come to no more
        (561.0, 5.0, True, True),
    ],
)
def test_a_climb_is_hopeless_where_four_times_its_gain_and_what_a_start_may_take_off_do_not_reach(
    monkeypatch: pytest.MonkeyPatch, to_beat: float, promised: float, *, is_hopeless: bool, ends: bool
) -> None:
    """From 200, with 10 gained so far and, while it climbs, what is promised: 200 + 4 · 10 + 300."""
    climbs = Climbs(monkeypatch)
    climbs.highest, climbs.promised = -90.0, promised
    model = carrying("parasitic_mode", MODE, 200.0)
    found, searched = refine_parameters(PROBLEM, model, "parasitic_mode", to_beat=to_beat)
    assert climbs.hopeless is is_hopeless
    assert len(climbs.asked) == (1 if ends else 2)
    if ends:
        assert found == (601.0, 1.01)
        np.testing.assert_array_equal(searched.covariance, np.diag([0.25, 0.0]))
        np.testing.assert_array_equal(searched.moves, np.zeros((len(SYMBOLS_OF_MODE), 2)))


SYMBOLS_OF_MODE = tuple(c for c in parameters.effect_for("parasitic_mode", 2, ())[1].coefficients)


def test_a_climb_that_turns_into_a_simpler_effect_ends_there(monkeypatch: pytest.MonkeyPatch) -> None:
    climbs = Climbs(monkeypatch)
    climbs.is_turned = True
    found, _ = refine_parameters(PROBLEM, carrying("parasitic_mode", MODE), "parasitic_mode")
    assert (len(climbs.asked), found) == (1, (601.0, 1.01))


@pytest.mark.parametrize(("reached", "kept"), [(-100.1, True), (-99.9, False)])
def test_what_a_search_made_worse_by_more_than_a_start_takes_off_stays_as_it_was(
    monkeypatch: pytest.MonkeyPatch, reached: float, *, kept: bool
) -> None:
    """From 200, and a start may take 300 off."""
    Climbs(monkeypatch)
    monkeypatch.setattr(Place, "likelihood", reached)
    monkeypatch.setattr(parameters, "parameters_of", lambda found, name: {"omega": found[0]})
    turned: dict[float, str] = {}
    monkeypatch.setattr(parameters, "turned_into", lambda problem, name, given: turned.get(given["omega"]))
    model = carrying("parasitic_mode", MODE, 200.0)
    found, searched = refine_parameters(PROBLEM, model, "parasitic_mode")
    assert (found is model) == kept
    assert np.any(searched.covariance) != kept  # of what was left nothing is known
    assert (searched.names, searched.covariance.shape) == (("omega", "zeta"), (2, 2))
    turned[6020.0] = "a constant force"  # that is said, however much worse it is
    found, _ = refine_parameters(PROBLEM, model, "parasitic_mode")
    assert found == pytest.approx((6020.0, 20.1))


@pytest.mark.parametrize(("at_top", "sweeps"), [(True, 1), (False, 3)])
def test_what_came_to_the_top_together_is_searched_for_once(
    monkeypatch: pytest.MonkeyPatch, *, at_top: bool, sweeps: int
) -> None:
    monkeypatch.setattr(parameters, "in_step", lambda problem, model, name: (model, False))
    monkeypatch.setattr(parameters, "agree", lambda problem, model, name, searched: False)
    searches: list[float] = []

    def refined(problem: Problem, model: Any, name: str, names: tuple[str, ...], *rest: Any) -> Any:
        searches.append(model.likelihood)
        given = {which: 2.0 * value for which, value in model.settings.effects[name].items()}
        unsure = Searched(names, np.eye(len(names)), np.zeros((4, len(names))), at_top)
        return carrying(name, given, model.likelihood + 10.0), unsure

    monkeypatch.setattr(parameters, "_refined", refined)
    model = carrying("sense_high_pass", {"leak_x": 100.0, "leak_y": 100.0})
    assert refine_parameters(PROBLEM, model, "sense_high_pass") == (model, NOTHING)
    assert len(searches) == sweeps


def test_without_parameters_there_is_nothing_to_search(monkeypatch: pytest.MonkeyPatch) -> None:
    model = carrying("drive_gain", {"hx": 0.1})
    assert refine_parameters(PROBLEM, model, "drive_gain") == (model, NOTHING)


# -- a long record ----------------------------------------------------------------------------------------------------


class Fits:
    """In the place of fits: a model of what is asked for, its likelihood by length of the record and ω."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, likelihood: Callable[[int, float], float]) -> None:
        self.asked: list[tuple[int, float]] = []
        self.about: list[Any] = []
        self.likelihood = likelihood
        monkeypatch.setattr(parameters, "fit", self)

    def __call__(self, problem: Problem, passes: int, about: Any = None) -> Any:
        ((name, given),) = problem.settings.effects.items()
        samples, first = len(problem.record), next(iter(given.values()))
        self.asked.append((samples, first))
        self.about.append(about)
        settings = ObserverSettings(effects={name: dict(given)})
        likelihood = self.likelihood(samples, first)
        return SimpleNamespace(settings=settings, likelihood=likelihood, observer="observer")


class Places(Climbs):
    """Climbs that end in models."""

    def __call__(self, problem: Problem, model: Any, name: str, names: tuple[str, ...]) -> "Places":
        self.samples, self.name, self.names = len(problem.record), name, names
        return self

    def fitted(self, place: Array) -> Any:
        given = dict(zip(self.names, place.tolist(), strict=True))
        self.last = self.samples, given
        settings = ObserverSettings(effects={self.name: given})
        return SimpleNamespace(settings=settings, likelihood=40.0, observer="of the beginning")


def long_record(samples: int) -> Problem:
    record = Record(np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.full(samples, 1 / 4000.0))
    return Problem(record, DEVICE, ObserverSettings())


def mode(likelihood: float) -> Any:
    return SimpleNamespace(**vars(carrying("parasitic_mode", MODE, likelihood)), observer="before")


def test_a_search_on_a_long_record_begins_on_a_quarter_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """On 10,000 samples of 40,000; on all of them from there, with steps of three of the deviations it has there."""
    climbs = Places(monkeypatch)
    fits = Fits(monkeypatch, lambda samples, omega: 30.0 if samples == 10_000 else 110.0)
    monkeypatch.setattr(parameters, "turned_into", lambda *_: None)
    found, searched = refine_parameters(long_record(40_000), mode(100.0), "parasitic_mode")
    assert fits.asked == [(10_000, 600.0), (40_000, 6020.0)]
    assert fits.about == [None, "of the beginning"]
    starts = [one[0] for one in climbs.asked]
    assert starts[0] == (600.0, 0.01)
    assert starts[2] == pytest.approx((6020.0, 20.1))
    assert climbs.asked[2][2] == pytest.approx(3.0 * 0.5 * 3.0)  # of a deviation of 3 on the quarter
    assert climbs.samples == 40_000
    assert found.settings.effects["parasitic_mode"]["omega"] == pytest.approx(60220.0)
    assert searched.names == ("omega", "zeta")


def test_where_the_whole_record_is_no_better_there_it_is_searched_from_where_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    climbs = Places(monkeypatch)
    Fits(monkeypatch, lambda samples, omega: 30.0 if samples == 10_000 else 90.0)
    monkeypatch.setattr(parameters, "turned_into", lambda *_: None)
    refine_parameters(long_record(40_000), mode(100.0), "parasitic_mode")
    assert climbs.asked[2] == ((600.0, 0.01), 0, 6.0)


@pytest.mark.parametrize(("samples", "omega"), [(19_000, 600.0), (40_000, 25.0)])
def test_a_short_record_and_a_slow_line_are_searched_whole(
    monkeypatch: pytest.MonkeyPatch, samples: int, omega: float
) -> None:
    """Half of a record saves nothing; ten periods are asked of a line."""
    climbs = Places(monkeypatch)
    fits = Fits(monkeypatch, lambda samples, omega: 0.0)
    model = carrying("parasitic_mode", {"omega": omega, "zeta": 0.01})
    refine_parameters(long_record(samples), model, "parasitic_mode")
    assert (fits.asked, climbs.samples) == ([], samples)


@pytest.mark.parametrize(
    ("name", "given", "part"),
    # The phase of a frequency that is off grows with the time, and what that costs with its cube.
    [("parasitic_mode", MODE, 4.0**-3), ("drive_saturation", {"limit": 3.0}, 1.0 / 4.0)],
    ids=["a frequency", "a limit"],
)
def test_what_is_hopeless_on_the_beginning_is_left_there(
    monkeypatch: pytest.MonkeyPatch, name: str, given: dict[str, float], part: float
) -> None:
    """What another model leads by on a quarter of the record is out of reach there: 30 + 4 · 10 + 300."""
    climbs = Places(monkeypatch)
    climbs.highest, climbs.deviations = -90.0, [0.5, 0.25][: len(given)]
    Fits(monkeypatch, lambda samples, first: 30.0 if samples == 10_000 else 110.0)
    monkeypatch.setattr(parameters, "turned_into", lambda *_: None)
    model = SimpleNamespace(**vars(carrying(name, given, 100.0)), observer="before")
    for lead, left in ((339.9 / part, False), (340.1 / part, True)):
        climbs.asked.clear()
        _, searched = refine_parameters(long_record(40_000), model, name, to_beat=100.0 + lead)
        assert len(climbs.asked) == (1 if left else len(given) + 1)  # of the whole record, one more
        if left:
            np.testing.assert_array_equal(searched.covariance, np.zeros((len(given), len(given))))


# -- a parameter that is a coefficient --------------------------------------------------------------------------------


@pytest.mark.parametrize(("corner", "asked"), [(25.0, [25.0]), (10.05, [])])
def test_a_parameter_that_is_a_coefficient_follows_it(
    monkeypatch: pytest.MonkeyPatch, corner: float, asked: list[float]
) -> None:
    """Until it moves by less than a fifth of a deviation, here of 0.5."""
    seen = leaking(monkeypatch, lambda leak: corner)
    found, searched = refine_parameters(PROBLEM, leaky(10.0), "sense_high_pass")
    assert seen == asked
    assert found.settings.effects["sense_high_pass"]["leak_x"] == (asked[-1] if asked else 10.0)
    assert searched is NOTHING


@pytest.mark.parametrize("agreeing", [1, 2, 3, 4])
@pytest.mark.parametrize(
    ("corner", "likelihood", "size", "asked"),
    [
        (-3.0, 0.0, 1.0, []),  # no corner
        (25.0, -301.0, 1.0, [25.0]),  # the likelihood falls, by more than a rough start takes off
        (10.05, 0.0, 1.05, []),  # more is left than was predicted
    ],
)
def test_a_parameter_that_its_coefficient_does_not_tell_is_searched_for(
    monkeypatch: pytest.MonkeyPatch, corner: float, likelihood: float, size: float, asked: list[float], agreeing: int
) -> None:
    """Again, from where it came to, until the two agree; what does not in three searches stays as it was."""
    seen = leaking(monkeypatch, lambda leak: corner, lambda leak: likelihood, size)
    searches: list[Any] = []

    def refined(problem: Any, model: Any, name: str, names: Any, before: Any, to_beat: float) -> Any:
        searches.append((names, before))
        return leaky(40.0 + len(searches), 1.0), known[len(searches)]

    known = [half_known() for _ in range(4)]
    monkeypatch.setattr(parameters, "_refined", refined)
    monkeypatch.setattr(parameters, "agree", lambda *_: len(searches) >= agreeing)
    found, searched = refine_parameters(PROBLEM, leaky(10.0), "sense_high_pass")
    assert seen == asked
    befores = [None, known[1], known[2]]
    assert searches == [(("leak_x", "leak_y"), before) for before in befores[: min(agreeing, 3)]]
    if agreeing < 4:
        assert (searched, found.observer.leak) == (known[agreeing], 40.0 + agreeing)
    else:
        assert (searched, found.observer.leak) == (NOTHING, 10.0)


@pytest.mark.parametrize(
    ("moves", "searches"), [([1.0, 0.11, 0.0], 3), ([1.0, 0.09], 2), ([-0.09], 1), ([-0.11, 0.0], 2)]
)
def test_a_search_that_moves_no_parameter_is_not_made_again(
    monkeypatch: pytest.MonkeyPatch, moves: list[float], searches: int
) -> None:
    """None by more than a fifth of a deviation, here of 0.5."""
    leaking(monkeypatch, lambda leak: -3.0)
    leaks: list[float] = []

    def refined(problem: Any, model: Any, name: str, names: Any, before: Any, to_beat: float) -> Any:
        leaks.append(model.observer.leak + moves[len(leaks)])
        return leaky(leaks[-1], 1.0), half_known()

    monkeypatch.setattr(parameters, "_refined", refined)
    monkeypatch.setattr(parameters, "agree", lambda *_: False)
    found, searched = refine_parameters(PROBLEM, leaky(10.0), "sense_high_pass")
    assert len(leaks) == searches
    assert (searched, found.observer.leak) == (NOTHING, 10.0)


def half_known() -> Searched:
    """Both corners within a standard deviation of 0.5."""
    return Searched(("leak_x", "leak_y"), 0.25 * np.eye(2), np.zeros((2, 2)))


def leaky(leak: float, likelihood: float = 0.0, size: float = 1.0) -> Any:
    """A model with a high-pass of that leak on x, innovations so many times as large as predicted."""
    observer = SimpleNamespace(
        estimated=("x", "hpx", "hpy"), covariance=np.diag([1.0, 0.25, 0.25]), leak=leak,
    )  # fmt: skip
    settings = ObserverSettings(effects={"sense_high_pass": {"leak_x": leak, "leak_y": 7.0}})
    estimates = SimpleNamespace(innovation=np.full((4, 2), size), innovation_deviation=np.ones((4, 2)))
    return SimpleNamespace(observer=observer, settings=settings, likelihood=likelihood, estimates=estimates)


def leaking(
    monkeypatch: pytest.MonkeyPatch,
    corner: Any,
    likelihood: Any = lambda leak: 0.0,
    size: float = 1.0,
) -> list[float]:
    """Fits find these on x, by the leak that they have; the leaks that were asked for."""
    seen: list[float] = []

    def fitted(problem: Problem, passes: int, about: Any) -> Any:
        seen.append(problem.settings.effects["sense_high_pass"]["leak_x"])
        return leaky(seen[-1], likelihood(seen[-1]), size)

    def found(observer: Any) -> Any:
        given = {"hpx": corner(observer.leak), "hpy": 7.0, "leak_x": observer.leak, "leak_y": 7.0}
        return {"sense_high_pass": given}

    monkeypatch.setattr(same_number, "fit", fitted)
    monkeypatch.setattr(same_number, "coefficients_of", found)
    monkeypatch.setattr(fitting, "widening", lambda model: size)
    return seen
