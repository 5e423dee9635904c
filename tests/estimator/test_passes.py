"""Passes of a fit, how many and from where, with an observer that only counts; what is read from an observer."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import ControllerSettings, Device, Gain, ObserverSettings, ProcessNoise, Spread, Variant
from estimator.trace import fitting
from estimator.trace.fitting import (
    Fitted,
    constants_of,
    fit,
    log_likelihood,
)
from estimator.trace.problem import Problem
from tests.estimator.device import UNLIKE as DEVICE

N = 640
SETTINGS = ObserverSettings(
    gain=Gain.STATIONARY, initial={"kxx": 1.0, "vx": 0.5}, effects={"drag": {"dqx": 0.0, "dqy": 0.0}}
)


class Counter:
    """An observer whose two coefficients move by what it is told, pass by pass, from where it is begun."""

    made: list["Counter"]
    moves: list[float]
    spread: float = 1.0

    def __init__(self, device: Any, settings: ObserverSettings, controller: Any) -> None:
        self.device, self.settings, self.controller = device, settings, controller
        self.carries_both = False
        given = settings.effects.get("drag", {})
        self.x = np.array([9.0, 9.0, given.get("dqx", 0.0), given.get("dqy", 0.0)])
        self.names: tuple[str, ...] = ("x", "kxx", "dqx", "dqy")
        self.begun_about: Any = None
        self.begun_with: Any = None
        self.samples = 0
        Counter.made.append(self)

    def carry_both(self) -> None:
        self.carries_both = True

    @property
    def coefficient_deviations(self) -> Array:
        return np.full(2, Counter.spread)


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> type[Counter]:
    Counter.made, Counter.moves, Counter.spread = [], [], 1.0

    def run(observer: Counter, record: Record, every: int | None = None) -> Any:
        observer.samples = len(record)
        moved = Counter.moves[min(len(Counter.made), len(Counter.moves)) - 1]
        observer.x = observer.x + np.array([0.0, 0.0, 0.0, moved])
        return SimpleNamespace(innovation=np.ones((len(record), 2)), innovation_deviation=np.ones((len(record), 2)))

    monkeypatch.setattr(fitting, "Observer", Counter)
    monkeypatch.setattr(fitting, "run", run)
    monkeypatch.setattr(fitting, "is_lost", lambda innovation, device: False)
    monkeypatch.setattr(fitting, "begin_about", lambda one, other: setattr(one, "begun_about", other))
    monkeypatch.setattr(fitting, "begin_moving", lambda one, record: setattr(one, "begun_with", record))
    monkeypatch.setattr(fitting, "constants_of", lambda observer: {"kxx": float(len(Counter.made))})
    monkeypatch.setattr(
        fitting, "coefficients_of", lambda observer: {"drag": {"dqx": observer.x[2], "dqy": observer.x[3]}}
    )
    monkeypatch.setattr(fitting, "_steady_rate", lambda problem, observer: {"rate": 0.25})
    return Counter


def problem(samples: int = N, **settings: Any) -> Problem:
    record = Record(np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.full(samples, 1 / 4000.0))
    return Problem(record, DEVICE, replace(SETTINGS, **settings), ControllerSettings(1, 1e-9, 1.0, 1e-9))


@pytest.mark.parametrize(
    ("asked", "moves", "about", "made"),
    [
        (2, [5.0, 0.9], None, 2),  # the second stays within the spread that it began with
        (2, [5.0, 1.1, 0.9], None, 3),
        (2, [5.0, -1.1, 1.1, 9.0, 9.0], None, 4),  # twice again at most
        (1, [5.0], None, 1),  # one pass is one pass
        (1, [0.5], "about", 1),
        (1, [1.5, 0.5], "about", 2),  # about an earlier one it is as good as a second, and is followed as that is
        (1, [1.5, 1.5, 1.5, 1.5], "about", 3),
    ],
)
def test_a_fit_makes_as_many_passes_as_it_needs(
    passes: type[Counter], asked: int, moves: list[float], about: Any, made: int
) -> None:
    passes.moves = moves
    found = fit(problem(), asked, about=about)
    assert len(passes.made) == made
    assert [one.begun_about for one in passes.made] == [about, *passes.made[: made - 1]]
    assert found.observer is passes.made[-1]
    assert [one.samples for one in passes.made] == [N] * made
    assert [len(one.begun_with) for one in passes.made] == [N] * made
    # Each begins with what the one before found; the settings of the last are where it came to.
    assert [one.settings.initial["kxx"] for one in passes.made] == [1.0, *np.arange(1.0, made)]
    assert found.settings.initial == {"kxx": float(made), "vx": 0.5, "rate": 0.25}
    assert found.settings.effects["drag"]["dqy"] == pytest.approx(sum(moves[:made]))
    for before, after in zip(passes.made, passes.made[1:], strict=False):
        assert after.settings.effects["drag"]["dqy"] == before.x[3]
    assert {one.settings.gain for one in passes.made} == {Gain.EKF}
    assert passes.made[0].controller == problem().controller
    assert found.likelihood == -2.0 * N


@pytest.mark.parametrize(("moves", "made"), [([np.nan, 0.0], 1), ([5.0, np.inf, 0.0], 2)])
def test_a_pass_that_diverges_is_the_last_and_has_no_likelihood(
    passes: type[Counter], moves: list[float], made: int
) -> None:
    passes.moves = moves
    found = fit(problem())
    assert len(passes.made) == made
    assert found.likelihood == -np.inf
    assert found.settings.initial["kxx"] == float(made - 1) or made == 1


@pytest.mark.parametrize("deviation", [np.nan, np.inf])
def test_what_should_be_a_variance_and_is_none_is_no_likelihood_either(
    passes: type[Counter], monkeypatch: pytest.MonkeyPatch, deviation: float
) -> None:
    """Samples without a deviation count for nothing in a likelihood: who loses its covariance would be the best."""
    passes.moves = [0.5]
    ran = fitting.run

    def run(observer: Counter, record: Record, every: int | None = None) -> Any:
        estimates: Any = ran(observer, record, every)  # type: ignore[arg-type]
        estimates.innovation_deviation[7, 1] = deviation
        return estimates

    monkeypatch.setattr(fitting, "run", run)
    assert fit(problem()).likelihood == -np.inf
    assert fitting._catching(problem(), SETTINGS, problem().record) is None


def test_a_first_pass_over_a_part_that_diverges_is_made_over_all(
    passes: type[Counter], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fitting, "_SET", replace(fitting._SET, opening=100, opening_share=0.25))
    passes.moves = [np.nan, 0.5]
    found = fit(problem())
    assert [one.samples for one in passes.made] == [160, N]
    assert found.likelihood == -2.0 * N
    passes.made.clear()
    passes.moves = [0.5]
    fit(problem())
    assert [one.samples for one in passes.made] == [160, N]
    passes.made.clear()
    fit(problem(), 1)
    fit(problem(), 2, about="about")  # type: ignore[arg-type]
    assert [one.samples for one in passes.made] == [N, N, N]


@pytest.mark.parametrize(
    ("samples", "warm", "first"),
    [(20_000, False, 20_000), (20_001, False, 20_000), (90_000, False, 30_000), (90_000, True, 90_000)],
)
def test_a_first_pass_is_over_20_000_samples_or_a_third(samples: int, first: int, *, warm: bool) -> None:
    asked = problem(samples)
    if warm:
        asked = asked.on(replace(asked.record, channels={"temperature": np.zeros(samples)}))
    assert len(fitting._opening(asked).record) == first


@pytest.mark.parametrize(
    ("variant", "effects", "carries_both"), [(Variant.FULL, {}, 1), (Variant.FULL, SETTINGS.effects, 0)]
)
def test_one_covariance_is_carried_where_there_is_one(
    passes: type[Counter], variant: Variant, effects: Any, carries_both: int
) -> None:
    passes.moves = [0.0]
    fit(problem(variant=variant, effects=effects))
    assert {one.carries_both for one in passes.made} == {carries_both}


# -- what is read from an observer ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "random_walk", "spread", "steady"),
    [
        (("x", "rate"), 1.0, 0.5, True),  # by 0.4 over 0.16 s, and unknown by 0.5
        (("x", "rate"), 1.0, 0.4, False),
        (("x", "rate"), 1.0, 0.3, False),
        (("x", "vx"), 0.0, 0.5, False),
    ],
)
def test_a_rate_that_moves_by_less_than_it_is_unknown_by_is_taken_on(
    names: tuple[str, ...], random_walk: float, spread: float, *, steady: bool
) -> None:
    asked = problem(spread=Spread(rate=spread), process_noise=ProcessNoise(rate=random_walk))
    observer: Any = SimpleNamespace(names=names, state=np.array([1.0, 0.75]))
    assert fitting._steady_rate(asked, observer) == ({"rate": 0.75} if steady else {})


def test_constants_are_behind_the_motion_and_are_not_the_rate() -> None:
    names = "x", "vx", "kxx", "rate", "dxx"
    observer: Any = SimpleNamespace(
        states=2, model=SimpleNamespace(names=names), names=(*names, "hx"),
        state=np.arange(1.0, 7.0),
    )  # fmt: skip
    assert constants_of(observer) == {"kxx": 3.0, "dxx": 5.0}


# -- likelihoods ------------------------------------------------------------------------------------------------------


def model(innovation: Array, deviation: float = 1.0, likelihood: float = 1.0, x: float = 0.0) -> Any:
    estimates = SimpleNamespace(innovation=innovation, innovation_deviation=np.full_like(innovation, deviation))
    return Fitted(SETTINGS, SimpleNamespace(x=np.array([x])), estimates, likelihood)  # type: ignore[arg-type]


def test_what_is_lost_or_has_no_deviation_counts_for_nothing() -> None:
    innovation, deviation = np.array([[3.0], [np.nan], [2.0], [1.0]]), np.array([[2.0], [1.0], [0.0], [0.5]])
    with np.errstate(divide="ignore"):
        assert log_likelihood(innovation, deviation) == pytest.approx(
            -(2.25 + 2.0 * np.log(2.0) + 4.0 + 2.0 * np.log(0.5))
        )


class _Estimates:
    def __init__(self, innovation: Array, deviation: Array) -> None:
        self.innovation, self.innovation_deviation = innovation, deviation


@pytest.mark.parametrize(
    ("lost", "passes_asked", "about", "gains"),
    [
        ({Gain.EKF}, 2, None, [Gain.EKF, Gain.FADING, Gain.EKF]),
        ({Gain.EKF, Gain.FADING}, 2, None, [Gain.EKF, Gain.FADING, Gain.EKF]),
        (set(), 2, None, [Gain.EKF, Gain.EKF]),
        ({Gain.EKF}, 1, None, [Gain.EKF]),  # nothing follows
        ({Gain.EKF}, 1, "about", [Gain.EKF]),  # somebody else has found the place
    ],
)
def test_where_the_start_led_the_first_pass_away_the_second_begins_where_one_that_forgets_has_come_back(
    monkeypatch: pytest.MonkeyPatch,
    passes: type[Counter],
    lost: set[Gain],
    passes_asked: int,
    about: Any,
    gains: list[Gain],
) -> None:
    def is_lost(innovation: Array, device: Device) -> bool:
        return passes.made[-1].settings.gain in lost

    passes.moves = [0.5]
    monkeypatch.setattr(fitting, "is_lost", is_lost)
    fit(problem(), passes_asked, about=about)
    assert [one.settings.gain for one in passes.made] == gains
    assert all(len(one.begun_with) == N for one in passes.made)
    if len(gains) == 3:
        first, caught, second = passes.made
        assert caught.begun_about is None
        assert second.begun_about is (first if Gain.FADING in lost else caught)


def test_the_motion_is_followed_if_it_is_in_the_second_half_and_the_state_is_finite(
    monkeypatch: pytest.MonkeyPatch, passes: type[Counter]
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(fitting, "is_lost", lambda innovation, device: bool(asked.append(len(innovation))))
    passes.moves = [0.5]
    assert fitting._catching(problem(), SETTINGS, problem().record) is passes.made[0]
    passes.moves = [np.nan]
    assert fitting._catching(problem(), SETTINGS, problem().record) is None
    assert asked == [N // 2]


def test_an_observer_of_which_nothing_is_known_follows_nothing() -> None:
    assert fitting.is_lost(np.full((3, 2), np.nan), DEVICE)
    assert not fitting.is_lost(np.array([[np.nan, 0.0], [0.0, 0.0]]), DEVICE)
