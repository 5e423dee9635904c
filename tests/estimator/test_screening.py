"""A short part of the record speaks for few of many: by stub models whose innovations are given, sample by sample."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import ObserverSettings
from estimator.thresholds import THRESHOLDS
from estimator.trace import screening
from estimator.trace.criterion import TIE
from estimator.trace.fitting import Fitted
from estimator.trace.problem import Problem
from estimator.trace.screening import spoken_for
from tests.estimator.device import UNLIKE as DEVICE

N, SHORT, FIRST = 60_000, 20_000, 5_000
BEST, REST = {"known": {}, "best": {}}, {"known": {}}
GAIN = 60_000.0  # of the best, one a sample


def problem(**channels: Any) -> Problem:
    nothing = np.zeros((N, 2))
    record = Record(nothing, np.zeros((N, 2, 1)), np.full(N, 1 / 4000.0), channels)
    return Problem(record, DEVICE, ObserverSettings())


def lossy(name: str, at: int, until: int, losses: dict[str, Callable[[Any], Any]]) -> Any:
    """A model that loses so much in twice the log-likelihood at each sample from `at` until `until`."""
    loss = losses[name](np.arange(at, until))
    innovation = np.sqrt(1e6 + loss[:, None] * np.array([1.0, 0.0]))  # so that a gain fits below
    return SimpleNamespace(innovation=innovation, innovation_deviation=np.ones((until - at, 2)))


@pytest.fixture
def world(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What each loses on the best, sample by sample; and who was carried over how many samples."""
    losses: dict[str, Callable[[Any], Any]] = {
        "best": lambda k: 0.0 * k,
        "known": lambda k: np.full(len(k), GAIN / N),
    }
    carried: list[tuple[str, int, int]] = []

    def fit(asked: Problem, passes: int) -> Any:
        assert passes == 1
        (name,) = set(asked.effects) - {"known"} or {"known"}
        carried.append((name, 0, len(asked.record)))
        return Fitted(asked.settings, name, lossy(name, 0, len(asked.record), losses), 0.0)  # type: ignore[arg-type]

    def carried_on(model: Any, record: Record) -> Any:
        seen = len(model.estimates.innovation)
        carried.append((model.observer, seen, seen + len(record)))
        return Fitted(model.settings, model.observer, lossy(model.observer, 0, seen + len(record), losses), 0.0)

    monkeypatch.setattr(screening, "fit", fit)
    monkeypatch.setattr(screening, "carried_on", carried_on)
    return SimpleNamespace(losses=losses, carried=carried, told=[])


def ask(world: Any, spared: Any = (), of: Problem | None = None, gain: float = GAIN) -> list[str]:
    names = [name for name in world.losses if name not in ("best", "known")]
    others = {name: {"known": {}, name: {}} for name in names}
    return spoken_for(of or problem(), BEST, REST, others, spared, gain, lambda *what: world.told.append(what))


def steadily(whole: float) -> Callable[[Any], Any]:
    """A loss of so much over the short part."""
    return lambda k: np.full(len(k), whole / SHORT)


def test_those_that_do_as_well_as_the_best_stay_the_nearest_first(world: Any) -> None:
    """Behind by less than odds of 20 to 1, which is 6 in twice the log-likelihood."""
    world.losses.update(b=steadily(5.9), a=steadily(-3.0), c=steadily(6.5), d=steadily(5000.0))
    assert ask(world) == ["a", "b"]
    assert world.told[-1] == ("other kinds", 6, 6)


def test_a_deficit_of_odds_of_twenty_to_one_is_not_as_good(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    world.losses.update(a=steadily(0.0), b=steadily(0.0))
    behind = {"a": TIE, "b": np.nextafter(TIE, 0.0)}
    monkeypatch.setattr(screening, "deficit", lambda best, other, start=1: behind.get(other.observer, 0.0))
    assert ask(world) == ["b"]


def test_half_of_the_gain_of_the_best_is_no_good_share(world: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """At first a quarter of the short part is seen, of which the best gains 5000."""
    world.losses.update(a=steadily(0.0), b=steadily(0.0))
    bar = THRESHOLDS.width.as_good * 5000.0
    behind = {"a": bar, "b": np.nextafter(bar, 0.0)}
    monkeypatch.setattr(screening, "deficit", lambda best, other, start=1: behind.get(other.observer, 0.0))
    ask(world)
    assert {name for name, _, until in world.carried if until == SHORT} == {"best", "known", "b"}


def test_a_part_that_is_seen_at_once_is_not_gone_over_again(world: Any) -> None:
    world.losses.update(a=steadily(1.0))
    asked = problem()
    assert ask(world, of=asked.part(slice(0, FIRST)), gain=float(FIRST)) == ["a"]
    assert {(first, until) for _, first, until in world.carried} == {(0, FIRST)}


def test_no_more_than_eight_stay(world: Any) -> None:
    world.losses.update({f"n{n}": steadily(n / 2.0) for n in range(9, 0, -1)})
    assert ask(world) == [f"n{n}" for n in range(1, 9)]


def test_what_gains_less_than_half_of_the_best_at_first_is_carried_no_further(world: Any) -> None:
    def late(k: Any) -> Any:  # far behind at first, and as good in the end
        return np.where(k < FIRST, 0.6, -0.2)

    world.losses.update(half=steadily(0.4 * SHORT), less=steadily(0.6 * SHORT), late=late)
    assert ask(world) == []
    over_all = {name for name, _, until in world.carried if until == SHORT}
    assert over_all == {"best", "known", "half"}
    assert {until for name, _, until in world.carried if name == "less"} == {FIRST}


def test_the_same_samples_are_the_start_at_first_and_in_the_end(world: Any) -> None:
    """What the start alone tells hangs on how it was linearised: a 32nd of the short part does not count."""
    world.losses.update(
        start=lambda k: np.where(k < SHORT / 32, 100.0, 0.0),
        behind=lambda k: np.where((k > SHORT / 32) & (k < SHORT / 16), 100.0, 0.0),
    )
    assert ask(world) == ["start"]


def test_those_spared_stay_with_half_of_the_gain_in_their_order(world: Any) -> None:
    world.losses.update(
        half=steadily(0.45 * SHORT), less=steadily(0.55 * SHORT), near=steadily(1.0), most=steadily(5.0)
    )
    assert ask(world, spared=("half", "less", "most")) == ["half", "most", "near"]


def test_those_spared_see_all_of_the_short_part_however_far_behind_they_are_at_first(world: Any) -> None:
    def late(k: Any) -> Any:  # nine tenths of the gain are lost at first, three in the end
        return np.where(k < FIRST, 0.9, 0.1)

    world.losses.update(spared=late, other=late)
    assert ask(world, spared=("spared",)) == ["spared"]
    assert {name for name, _, until in world.carried if until == SHORT} == {"best", "known", "spared"}


def test_a_short_part_that_shows_less_than_its_share_of_the_gain_sends_none_of_those_spared_away(world: Any) -> None:
    world.losses.update(known=steadily(0.1 * SHORT), a=steadily(0.1 * SHORT), b=steadily(0.1 * SHORT))
    assert ask(world, spared=("a",)) == ["a"]
    assert ask(world, spared=("a",), gain=0.1 * N) == []


def test_what_a_start_from_a_wide_spread_may_take_off_sends_nobody_away_at_first(world: Any) -> None:
    world.losses.update(
        known=steadily(50.0), a=lambda k: np.where((k > 700) & (k < 900), 1.4, np.where(k < 900, 0, -0.1))
    )
    assert ask(world, gain=150.0) == ["a"]


def test_what_goes_with_a_temperature_shows_late(world: Any) -> None:
    world.losses.update(a=steadily(0.9 * SHORT), late=lambda k: np.where(k < FIRST, 0.9, -0.4))
    warm = problem(temperature=np.linspace(20.0, 30.0, N))
    assert ask(world, spared=("a",), of=warm) == ["a", "late"]
    assert not [name for name, *_ in world.carried if name == "a"]


def test_what_the_start_alone_tells_of_the_best_is_no_gain_of_it(world: Any) -> None:
    """Three times what it gains: half of the gain is what those spared are held to."""
    world.losses.update(known=lambda k: np.where(k < SHORT / 32, 100.0, 0.0), a=steadily(0.55 * SHORT))
    assert ask(world, spared=("a",), gain=float(N)) == []
    assert ask(world, spared=("a",), gain=1.2 * N) == ["a"]
