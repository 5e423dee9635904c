"""Other ways to begin a choice, on stub models whose likelihoods are written down for each set of effects."""

import math
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from estimator.trace import ways
from estimator.trace.criterion import TIE
from estimator.trace.engine import Dissent, Estimate, Rules, Score, choose
from estimator.trace.ways import best_way

RULES = Rules(3, Dissent.ENDS, last=lambda name: name.startswith("line"))
PRICE = 10.0
RECORD = SimpleNamespace()
"""Of a device at 200 Hz."""


class Carried(tuple[str, ...]):
    """What is carried; its model has a likelihood, and leaves nothing from 1,000 on."""

    likelihoods: Mapping[frozenset[str], float]
    problem = SimpleNamespace(record=RECORD, device=SimpleNamespace(target=(2.0 * math.pi * 200.0) ** 2))

    @property
    def fitted(self) -> Any:
        return SimpleNamespace(likelihood=self.likelihoods.get(frozenset(self), 0.0))


class Family:
    """Every candidate is hopeful whose model is written down; a few are objected to, or of the wrong sign."""

    def __init__(self, likelihoods: Mapping[str, float], objected: str = "", wrong: str = "") -> None:
        """likelihoods: by the names, in words."""
        by_set = {frozenset(names.split()): value for names, value in likelihoods.items()}
        self.kind = type("Carried", (Carried,), {"likelihoods": {frozenset(): 0.0, **by_set}})
        self.objected, self.wrong = objected, wrong
        self.begun: list[str] = []
        self.asked: list[str] = []

    def promise(self, current: Any, barred: Any) -> list[str]:
        likelihoods = self.kind.likelihoods  # type: ignore[attr-defined]
        names = {name for one in likelihoods for name in one}
        return sorted(n for n in names - set(current) - set(barred) if frozenset((*current, n)) in likelihoods)

    def hopeful(self, look: Any, tried: Any, refused: Any, number: int) -> Any:
        return look

    def fit(self, current: Any, look: Any, names: Any, tried: Any) -> Any:
        return {name: self.kind((*current, name)) for name in names}

    def score(self, current: Any, look: Any, fits: Any) -> Any:
        return {
            name: Score(
                fit.fitted.likelihood, fit.fitted.likelihood - self.kind(current).fitted.likelihood, PRICE, PRICE
            )
            for name, fit in fits.items()
        }

    def coefficients(self, fit: Any) -> Any:
        return {n: {"c": Estimate(-1.0, -2.0, -0.5, n == self.wrong)} for n in fit}

    def objection(self, current: Any, name: str, trial: Any) -> str | None:
        self.asked.append(name)
        return "no" if name == self.objected else None

    def without(self, current: Any, name: str) -> Any:
        less = self.kind(one for one in current if one != name)
        return less, self.score(less, (), {name: current})[name]

    def settled(self, current: Any, names: Any, newest: str) -> Any:
        if not names:
            self.begun.append(newest)
        return current


@pytest.fixture(autouse=True)
def unexplained(monkeypatch: pytest.MonkeyPatch) -> None:
    def left(model: Any, record: Any, resonance_hz: float) -> tuple[str, ...]:
        assert record is RECORD
        assert resonance_hz == pytest.approx(200.0)
        return () if model.likelihood >= 1000.0 else ("something is left",)

    monkeypatch.setattr(ways, "unexplained", left)


def found(family: Family, rules: Rules = RULES) -> tuple[str, ...]:
    """The names that the best way takes, in order."""
    family.begun.clear()
    chosen = choose(family, family.kind(), rules, reducible=family)
    return tuple(step.name for step in best_way(family, chosen, rules).steps)  # type: ignore[arg-type]


LED_ASTRAY = {"delay": 500.0, "low_pass": 499.0, "delay dead_band": 600.0, "low_pass coupling": 1000.0}


def test_a_choice_that_leaves_something_begins_again_with_who_came_near_the_first() -> None:
    family = Family(LED_ASTRAY)
    assert found(family) == ("low_pass", "coupling")
    assert family.begun == ["delay", "low_pass"]


def test_one_that_leaves_nothing_or_takes_nobody_is_not_asked_again() -> None:
    family = Family({**LED_ASTRAY, "delay dead_band": 1000.0, "low_pass coupling": 2000.0})
    assert found(family) == ("delay", "dead_band")
    assert family.begun == ["delay"]
    assert family.asked == ["delay", "dead_band"]  # nobody else is asked how the rest is predicted
    assert found(Family({"delay": 5.0})) == ()


def test_the_first_way_that_leaves_nothing_is_the_last() -> None:
    family = Family({**LED_ASTRAY, "drive_delay": 498.0, "drive_delay drag": 3000.0})
    assert found(family) == ("low_pass", "coupling")
    family = Family({**LED_ASTRAY, "low_pass coupling": 990.0, "drive_delay": 498.0, "drive_delay drag": 3000.0})
    assert found(family) == ("drive_delay", "drag")


@pytest.mark.parametrize(("ahead", "taken"), [(0.9 * TIE, "delay"), (1.1 * TIE, "low_pass")])
def test_a_way_has_to_be_likelier_by_what_tells_two_apart(ahead: float, taken: str) -> None:
    family = Family({**LED_ASTRAY, "low_pass coupling": 600.0 + ahead})
    assert found(family)[0] == taken
    dearer = {**LED_ASTRAY, "low_pass coupling": 590.0, "low_pass coupling gain": 600.0 + ahead + PRICE}
    assert found(Family(dearer))[0] == taken


@pytest.mark.parametrize("share", [0.899, 0.901])
def test_near_is_nine_tenths_of_the_first_gain(share: float) -> None:
    assert found(Family({**LED_ASTRAY, "low_pass": share * 500.0}))[0] == ("low_pass" if share > 0.9 else "delay")


def test_who_is_objected_to_of_the_wrong_sign_a_line_or_of_the_same_kind_begins_no_way() -> None:
    assert found(Family(LED_ASTRAY, objected="low_pass"))[0] == "delay"
    line = {name.replace("low_pass", "line"): value for name, value in LED_ASTRAY.items()}
    assert found(Family(line))[0] == "delay"
    same = {name.replace("low_pass", "delay:2"): value for name, value in LED_ASTRAY.items()}
    assert found(Family(same))[0] == "delay"
    # a model of the wrong sign is no trial at all where signs are asked for
    assert found(Family(LED_ASTRAY, wrong="low_pass"), replace(RULES, signs=False))[0] == "delay"


def test_two_other_ways_at_most_are_tried() -> None:
    others = {f"other_{number}": 490.0 - number for number in range(3)}
    last = {"other_2 coupling": 1000.0}
    family = Family({"delay": 500.0, "delay dead_band": 600.0, **others, **last})
    assert found(family)[0] == "delay"
    assert family.begun == ["delay", "other_0", "other_1"]
    del others["other_0"]
    assert found(Family({"delay": 500.0, "delay dead_band": 600.0, **others, **last}))[0] == "other_2"


def test_the_round_says_who_was_taken_and_who_was_beaten() -> None:
    family = Family(LED_ASTRAY)
    way = best_way(family, choose(family, family.kind(), RULES, reducible=family), RULES)  # type: ignore[arg-type]
    first = way.rounds[0]
    assert (first.taken, {one.name: one.outcome.value for one in first.tried}) == (
        "low_pass", {"delay": "beaten", "low_pass": "taken"},
    )  # fmt: skip
    assert set(way.steps[0].beside) == {"delay"}
    assert way.first is not None
    assert way.first.name == "low_pass"
