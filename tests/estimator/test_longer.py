"""A choice made on the beginning of a record, held to more of it, on stub models whose likelihoods are written here."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import ObserverSettings
from estimator.trace import fitting, longer, parameters
from estimator.trace.engine import Chosen, Dissent, Estimate, Outcome, Round, Rules, Score, Step, Trial, Tried
from estimator.trace.fitting import fit
from estimator.trace.longer import gone_on, shows_later
from estimator.trace.observer_model import Carrying
from estimator.trace.problem import Problem
from estimator.trace.searched import NOTHING
from tests.estimator.device import NOMINAL as DEVICE
from tests.estimator.test_conflict import DEVICE as FREE
from tests.estimator.test_conflict import SETTINGS
from tests.estimator.test_conflict import record as free_record

BEGINNING, LONGER = 100, 400
RULES = Rules(3, Dissent.ENDS, anew=True, near=0.9)


def problem(samples: int) -> Problem:
    record = Record(np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.full(samples, 1 / 4000.0))
    return Problem(record, DEVICE, ObserverSettings())


def carrying(effects: tuple[str, ...], samples: int, likelihood: float, searched: Any = None) -> Any:
    fitted = SimpleNamespace(
        likelihood=likelihood,
        settings=ObserverSettings(initial={"kxx": 7.0}, effects={name: {} for name in effects}),
        observer=effects,
    )
    return SimpleNamespace(problem=problem(samples), fitted=fitted, searched=searched or {})


def tried(name: str, outcome: Outcome, gain: float, bar: float) -> Tried:
    return Tried(name, outcome, "", Score(0.0, gain, 1.0, bar), {})


class Bench:
    """By effect, what it gains over the longer record; what was asked of it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, gains: dict[str, float]) -> None:
        self.gains = gains
        self.problem = problem(LONGER)
        self.near: dict[str, tuple[str, ...]] = {}
        self.negative: set[str] = set()
        self.objected: set[str] = set()
        self.turned: set[str] = set()
        self.fits: list[tuple[int, tuple[str, ...], int, Any]] = []
        self.refined: list[tuple[str, int, Any]] = []
        self.chosen: list[tuple[Any, Rules]] = []
        self.further = ()
        monkeypatch.setattr(longer, "fit", self.fit)
        monkeypatch.setattr(longer, "refine_parameters", self.refine)
        monkeypatch.setattr(parameters, "refine_parameters", self.refine)
        monkeypatch.setattr(longer, "choose", self.choose)
        monkeypatch.setattr(longer, "rivals", lambda step: dict.fromkeys(self.near.get(step.name, ())))
        monkeypatch.setattr(longer, "coefficients_of", lambda effects: {name: {} for name in effects})
        monkeypatch.setattr(longer, "parameters_of", lambda model, name: {})
        monkeypatch.setattr(longer, "turned_into", lambda asked, name, given: "less" if name in self.turned else None)
        monkeypatch.setattr(longer, "Carrying", lambda asked, fitted, searched: SimpleNamespace(
            problem=asked, fitted=fitted, searched=searched))  # fmt: skip

    def likelihood(self, effects: tuple[str, ...]) -> float:
        return sum(self.gains[name] for name in effects)

    def fit(self, asked: Problem, passes: int = 2, *, about: Any = None) -> Any:
        effects = tuple(asked.effects)
        self.fits.append((len(asked.record), effects, passes, about))
        return carrying(effects, len(asked.record), self.likelihood(effects)).fitted

    def refine(self, asked: Problem, fitted: Any, name: str, *, before: Any) -> Any:
        self.refined.append((name, len(asked.record), before))
        return fitted, f"again {name}"

    def choose(self, family: Any, start: Any, rules: Rules, progress: Any, reducible: Any) -> Any:
        assert family is reducible is self
        self.chosen.append((start, rules))
        taken = tuple(name for name in self.further if isinstance(name, str))
        rounds = tuple(Round(f"look at {name}", (tried(name, Outcome.TAKEN, 9.0, 1.0),), name) for name in taken)
        last = Round("last look", (tried("sense_gain", Outcome.TOO_DEAR, 2.0, 4.0),), None)
        steps = tuple(Step(name, Trial(None, None), None, {}) for name in taken)
        fit = carrying((*start.fitted.observer, *taken), LONGER, 0.0)
        return Chosen(steps, (*rounds, last), {"x": "y"}, False, dict.fromkeys(taken, 9.0), fit)

    # -- the family

    def without(self, current: Any, name: str) -> tuple[Any, Score]:
        left = tuple(other for other in current.fitted.observer if other != name)
        less = carrying(left, LONGER, self.likelihood(left), {n: s for n, s in current.searched.items() if n != name})
        return less, Score(current.fitted.likelihood, self.gains[name], 1.0, 5.0)

    def score(self, current: Any, look: Any, fits: Any) -> dict[str, Score]:
        assert look.startswith("look at")
        return {
            name: Score(fit.fitted.likelihood, fit.fitted.likelihood - current.fitted.likelihood, 1.0, 5.0)
            for name, fit in fits.items()
        }

    def coefficients(self, fit: Any) -> Any:
        return {
            name: {"c": Estimate(-2.0, -3.0, -1.0, True) if name in self.negative else Estimate(2.0, 1.0, 3.0, True)}
            for name in fit.fitted.observer
        }

    def objection(self, current: Any, name: str, trial: Any) -> str | None:
        return "it does not predict the rest" if name in self.objected else None


def on_the_beginning(taken: tuple[str, ...], beside: tuple[str, ...] = (), last: tuple[Tried, ...] = ()) -> Any:
    steps, carried = [], ()
    for name in taken:
        before = carrying(carried, BEGINNING, 0.0)
        others = {
            other: Trial(carrying((*carried, other), BEGINNING, 0.0, {other: f"searched {other}"}), None)
            for other in beside
        }
        carried = (*carried, name)
        trial = Trial(carrying(carried, BEGINNING, 0.0, {one: f"searched {one}" for one in carried}), None)
        steps.append(Step(name, trial, before, others))
    rounds = [
        Round(
            f"look at {name}",
            (tried(name, Outcome.TAKEN, 50.0, 5.0), *(tried(other, Outcome.BEATEN, 49.0, 5.0) for other in beside)),
            name,
        )
        for name in taken
    ]
    fit = steps[-1].trial.fit if steps else carrying((), BEGINNING, 0.0)
    return Chosen(tuple(steps), (*rounds, Round("behind", last, None)), {}, False, dict.fromkeys(taken, 50.0), fit)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Bench]:
    return lambda **gains: Bench(monkeypatch, gains)


def test_the_model_goes_over_the_longer_record_from_what_it_was_and_is_searched_from_there(bench: Any) -> None:
    made = bench(drag=200.0, delay=90.0)
    found = gone_on(made, on_the_beginning(("drag", "delay")), RULES)
    assert made.fits == [(LONGER, ("drag", "delay"), 2, None)]
    assert made.refined == [("drag", LONGER, "searched drag"), ("delay", LONGER, "searched delay")]
    ((start, rules),) = made.chosen
    assert (start.fitted.observer, start.searched) == (
        ("drag", "delay"), {"drag": "again drag", "delay": "again delay"})  # fmt: skip
    assert rules == replace(RULES, most=1)
    assert [step.name for step in found.steps] == ["drag", "delay"]
    assert found.gains == {"drag": 50.0, "delay": 50.0}


def test_what_shows_on_the_longer_record_only_is_taken_behind_the_rest(bench: Any) -> None:
    made = bench(drag=200.0, delay=90.0)
    made.further = ("delay",)
    small = tried("delay", Outcome.TOO_DEAR, 4.0, 5.0), tried("sense_cubic", Outcome.TOO_DEAR, 3.0, 5.0)
    found = gone_on(made, on_the_beginning(("drag",), last=small), RULES)
    assert [step.name for step in found.steps] == ["drag", "delay"]
    assert found.gains == {"drag": 50.0, "delay": 9.0}
    assert [one.look for one in found.rounds] == ["look at drag", "look at delay", "last look"]
    # Who was asked on the beginning and not again keeps its answer.
    assert [(one.name, one.score.gain) for one in found.rounds[1].tried] == [("delay", 9.0), ("sense_cubic", 3.0)]
    assert found.fit.fitted.observer == ("drag", "delay")
    assert found.barred == {"x": "y"}


def test_nothing_on_the_beginning_is_looked_for_on_the_longer_record(bench: Any) -> None:
    made = bench()
    found = gone_on(made, on_the_beginning(()), RULES)
    assert made.fits == [(LONGER, (), 2, None)]
    assert made.chosen[0][1].most == 3
    assert [one.look for one in found.rounds] == ["last look"]


def test_of_two_that_the_beginning_does_not_tell_apart_the_longer_record_takes_the_better(bench: Any) -> None:
    made = bench(drag=200.0, friction=230.0, other=150.0)
    made.near = {"drag": ("friction",)}
    found = gone_on(made, on_the_beginning(("drag",), beside=("friction", "other")), RULES)
    (step,) = found.steps
    assert (step.name, step.trial.score.gain, list(step.beside)) == ("friction", 230.0, ["drag"])
    assert step.beside["drag"].score.gain == 200.0
    assert step.trial.fit.searched == {"friction": "again friction"}
    assert ("friction", LONGER, "searched friction") in made.refined
    assert found.gains == {"friction": 50.0}
    assert found.rounds[0].taken == "friction"
    outcomes = {one.name: one.outcome for one in found.rounds[0].tried}
    assert outcomes == {"drag": Outcome.BEATEN, "friction": Outcome.TAKEN, "other": Outcome.BEATEN}
    assert made.chosen[0][0].fitted.observer == ("friction",)


@pytest.mark.parametrize("against", ["negative", "objected", "turned", "worse"])
def test_who_came_near_stays_beside_where_something_speaks_against_it(bench: Any, against: str) -> None:
    made = bench(drag=200.0, friction=190.0 if against == "worse" else 230.0)
    made.near = {"drag": ("friction",)}
    if against != "worse":
        getattr(made, against).add("friction")
    (step,) = gone_on(made, on_the_beginning(("drag",), beside=("friction",)), RULES).steps
    assert step.name == "drag"
    assert list(step.beside) == (["friction"] if against in ("objected", "worse") else [])
    assert step.before.fitted.observer == ()


def test_where_the_longer_record_does_not_tell_them_apart_the_simpler_one_is_taken(bench: Any) -> None:
    made = bench(low_pass=200.0, delay=199.0)
    made.near = {"low_pass": ("delay",)}
    simpler = replace(RULES, simpler=lambda best, trials: "delay" if best == "low_pass" and "delay" in trials else None)
    for rules, name in ((simpler, "delay"), (RULES, "low_pass")):
        (step,) = gone_on(made, on_the_beginning(("low_pass",), beside=("delay",)), rules).steps
        assert step.name == name
    made.objected.add("delay")
    (step,) = gone_on(made, on_the_beginning(("low_pass",), beside=("delay",)), simpler).steps
    assert step.name == "low_pass"


def test_the_second_of_two_is_told_apart_beside_what_the_first_became(bench: Any) -> None:
    made = bench(drag=200.0, friction=230.0, delay=90.0, corner=95.0)
    made.near = {"drag": ("friction",), "delay": ("corner",)}
    first = on_the_beginning(("drag", "delay"), beside=("friction", "corner"))
    found = gone_on(made, first, RULES)
    assert [step.name for step in found.steps] == ["friction", "corner"]
    assert made.chosen[0][0].fitted.observer == ("friction", "corner")
    assert list(found.gains) == ["friction", "corner"]


def test_what_was_pruned_is_not_asked_again(bench: Any) -> None:
    made = bench(drag=200.0, delay=90.0, friction=1e3)
    made.near = {"drag": ("friction",)}
    first = on_the_beginning(("drag", "delay"), beside=("friction",))
    pruned = replace(first, gains={"delay": 50.0}, fit=carrying(("delay",), BEGINNING, 0.0, {"delay": NOTHING}))
    found = gone_on(made, pruned, RULES)
    assert [step.name for step in found.steps] == ["drag", "delay"]
    assert made.chosen[0][0].fitted.observer == ("delay",)
    assert made.chosen[0][1].most == 2


def test_what_more_than_chance_did_not_explain_on_the_beginning_is_not_asked_of_more_of_it(bench: Any) -> None:
    made = bench(drag=200.0)
    objected = (tried("delay", Outcome.OBJECTED, 40.0, 5.0),)
    found = gone_on(made, on_the_beginning(("drag",), last=objected), RULES)
    assert made.chosen == []
    assert found.rounds[-1].tried == objected
    full = replace(on_the_beginning(("drag",)), more=True)
    assert gone_on(made, full, RULES).more
    assert made.chosen == []
    just_chance = (tried("delay", Outcome.OBJECTED, 5.0, 5.0),)  # which is no more than chance
    gone_on(made, on_the_beginning(("drag",), last=just_chance), RULES)
    assert made.chosen != []


def test_a_model_that_the_observer_loses_stays_as_it_was_chosen(bench: Any) -> None:
    made = bench(drag=-np.inf)
    chosen = on_the_beginning(("drag",))
    assert gone_on(made, chosen, RULES) is chosen
    assert made.refined == []


@pytest.mark.parametrize(
    ("on_the_beginning", "over_more", "promising", "expected"),
    [
        (1.0, 1.0, [], False),
        (1.0, 1.0, ["dry_friction"], True),  # too small to leave much, and more than chance
        (1.02, 1.03, [], True),
        (1.03, 1.03, ["dry_friction"], False),
        (1.0, float("nan"), [], True),
    ],
)
def test_a_model_at_the_floor_on_the_beginning_may_leave_something_later(
    monkeypatch: pytest.MonkeyPatch, on_the_beginning: float, over_more: float, promising: Any, *, expected: bool
) -> None:
    """Within 5 % of the predicted power, as one that explains a record is; what the observer loses is not."""
    widened = {BEGINNING: on_the_beginning, LONGER: over_more}
    asked = []

    def over(of: Problem, passes: int = 2, *, about: Any = None) -> Any:
        asked.append((tuple(of.effects), passes, about))
        return SimpleNamespace(samples=len(of.record))

    monkeypatch.setattr(longer, "fit", over)
    monkeypatch.setattr(fitting, "widening", lambda model: widened[model.samples])
    monkeypatch.setattr(longer, "look_at", lambda of, model: (len(of.record), model.samples))
    monkeypatch.setattr(longer, "leaders", lambda seen: {(LONGER, LONGER): promising}[seen])
    model: Any = SimpleNamespace(
        samples=BEGINNING, settings=ObserverSettings(effects={"drag": {}}), observer="its observer"
    )
    assert shows_later(problem(LONGER), model) is expected
    assert asked in ([], [(("drag",), 1, "its observer")])


@pytest.mark.moderate
def test_over_the_longer_record_a_model_has_the_likelihood_of_one_that_was_not_on_the_beginning() -> None:
    """What was taken there competes with what was not; one pass about the beginning lost 17 to two passes."""
    whole = Problem(free_record(1.0), FREE, SETTINGS)
    part = whole.part(slice(0, len(whole.record) // 3))
    effects = {"drag": {"dqx": 0.0, "dqy": 0.0}}
    found = longer._over(whole, Carrying(part, fit(part.carrying(effects))))
    fresh = fit(whole.carrying(effects))
    assert found.fitted.likelihood == pytest.approx(fresh.likelihood, abs=0.5)
