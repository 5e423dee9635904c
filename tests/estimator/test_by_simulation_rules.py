"""What the free run's choice is asked and how its answer is told, with the choice itself a stub."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.identification.problem import Problem
from estimator.record import Record
from estimator.refinement import Refined
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from estimator.thresholds import THRESHOLDS
from estimator.trace import by_simulation
from estimator.trace.by_simulation import RULES, trace_by_simulation, without
from estimator.trace.engine import Chosen, Dissent, Outcome, Round, Score, Step, Trial, Tried
from estimator.trace.free_run_model import FreeRun, Promise

LONG, COMPARED = 30_000, THRESHOLDS.free_runs.compared
DEVICE = Device(sample_rate=600.0, stiffness=(1.9e5,), damping=(40.0,), amplitude=0.1, sense_gain=(2.0,), noise=(1e-4,))
SETTINGS = ObserverSettings(effects={"given": {}})
NAMES = ("cubic", "drag", "friction", "line", "never")
NONE: Array = np.zeros((0, 0))


def problem() -> Problem:
    record = Record(np.zeros((LONG, 1)), np.ones((LONG, 1, 1)), np.full(LONG, 1 / 600.0))
    return Problem(record, DEVICE, SETTINGS)


def fit(*free: str) -> Refined:
    return Refined(free, free, np.zeros(len(free)), np.zeros(len(free)), np.zeros((LONG, 1)), np.zeros(1))


def run(*effects: str) -> Any:
    return FreeRun(effects, f"observer of {effects}", fit(*(f"c_{name}" for name in effects)))  # type: ignore[arg-type]


def promised(**gains: float) -> dict[str, Promise]:
    return {name: Promise(gain, 3.0, NONE) for name, gain in gains.items()}


def tried(name: str, outcome: Outcome, gain: float) -> Tried:
    return Tried(name, outcome, "why", Score(gain, gain, 3.0, 3.0), {})


LOOKS = (
    promised(cubic=90.0, drag=50.0, friction=40.0, line=5.0, never=1.5),
    promised(drag=45.0, friction=39.0, line=4.0, never=2.5),
    promised(friction=12.0, line=2.0, never=3.5),
)


def chosen(steps: int) -> Chosen[FreeRun, Any]:
    """Cubic, then drag, of which the first `steps` are taken; friction is carried in the first round and beaten."""
    rounds = [
        Round(LOOKS[0], (tried("cubic", Outcome.TAKEN, 80.0), tried("friction", Outcome.BEATEN, 30.0)), "cubic"),
        Round(LOOKS[1], (tried("drag", Outcome.TAKEN, 44.0),), "drag"),
    ][:steps]
    rounds.append(Round(LOOKS[steps], (), None))
    names = ("given", "cubic", "drag")[: steps + 1]
    score = Score(1.0, 80.0, 3.0, 3.0)
    made = tuple(Step(name, Trial(run(name), score), run(), {}) for name in names[1:])
    gains = dict(zip(names[1:], (80.0, 44.0), strict=False))
    return Chosen(made, tuple(rounds), {"line": "a line is the last to be believed"}, False, gains, run(*names))


class Asked:
    """What the parts were asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
        self.fits: list[Any] = []
        self.told: list[tuple[str, int, int]] = []
        self.signatures: dict[str, Array] = {}
        self.looks: list[Any] = []

        def choose(model: Any, start: Any, rules: Any, progress: Any) -> Any:
            self.model, self.start, self.rules = model, start, rules
            progress(1, 6)
            return chosen(steps)

        def fitted(problem: Problem, effects: tuple[str, ...], current: Any, rows: Any) -> Any:
            self.fits.append((len(problem.record), effects, current, rows))
            return run(*effects)

        def promises_of(
            part: Problem, taken: Any, left: Any, current: Refined, rows: Any, shown: str | None = None
        ) -> Any:
            self.looks.append((list(taken), list(left), current.free, rows, shown))
            return {name: Promise(1.0, 1.0, self.signatures.get(name, np.zeros((50, 0)))) for name in left}

        monkeypatch.setattr(by_simulation, "choose", choose)
        monkeypatch.setattr(by_simulation, "fitted", fitted)
        monkeypatch.setattr(by_simulation, "promises_of", promises_of)
        monkeypatch.setattr(by_simulation, "candidates", lambda device, settings, asked: NAMES)
        monkeypatch.setattr(by_simulation, "coefficient_names", lambda problem, name: {f"c_{name}"})

    def trace(self) -> Any:
        return trace_by_simulation(problem(), 50, lambda *told: self.told.append(told))


def test_candidates_compete_on_the_beginning_and_the_models_are_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Asked(monkeypatch, 2)
    found = asked.trace()
    assert (RULES.most, RULES.dissent, RULES.signs) == (6, Dissent.NEXT, True)
    assert asked.rules is RULES
    model = asked.model
    assert (len(model.problem.record), model.names) == (COMPARED, NAMES)
    assert (model.choice, model.later) == (slice(50, COMPARED * 2 // 3), slice(COMPARED * 2 // 3, COMPARED))
    first, before, after = asked.fits
    assert first == (COMPARED, ("given",), None, model.choice)
    assert before == (LONG, ("given",), None, slice(50, None))
    assert after[:2] == (LONG, ("given", "cubic", "drag"))
    assert after[2].free == ("c_given", "c_cubic", "c_drag")
    assert after[3] == slice(50, None)
    assert found.effects == ("cubic", "drag")
    assert found.evidence == {"cubic": 80.0, "drag": 44.0}
    assert found.observer_before == "observer of ('given',)"
    assert found.observer == "observer of ('given', 'cubic', 'drag')"
    assert (found.before.free, found.after.free) == (("c_given",), ("c_given", "c_cubic", "c_drag"))
    assert asked.told == [("free runs", 1, 6), ("refinement", 0, 2), ("refinement", 1, 2), ("refinement", 2, 2)]


def test_a_line_that_was_looked_for_competes_unless_it_is_declared(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Asked(monkeypatch, 2)
    lines: dict[str, dict[str, float]] = {"given": {"w": 2.0}, "never": {"w": 3.0}}
    monkeypatch.setattr(by_simulation, "candidates", lambda device, settings, asked: NAMES[:-1])
    monkeypatch.setattr(by_simulation, "begun", lambda device, asked, residuals: lines)
    asked.trace()
    assert asked.model.names == NAMES
    assert asked.model.problem.begun == lines


def test_why_each_of_the_others_was_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Barred, beaten, or promising too little in the last round that had a choice."""
    said = Asked(monkeypatch, 2).trace().rejected
    assert said == {
        "line": "a line is the last to be believed",
        "friction": "carried, it gains 30.0 in twice the log-likelihood; cubic explains more for its price",
        "never": "evidence 3.5 does not outweigh its coefficients",
    }


def test_where_as_many_are_taken_as_may_be_the_last_choice_is_that_of_the_last_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(by_simulation, "RULES", replace(RULES, most=2))
    assert Asked(monkeypatch, 2).trace().rejected["never"] == "evidence 2.5 does not outweigh its coefficients"


def test_where_nothing_is_taken_both_models_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Asked(monkeypatch, 0)
    found = asked.trace()
    assert found.effects == ()
    assert found.after is found.before
    assert found.observer is found.observer_before
    assert len(asked.fits) == 2
    assert found.alike == ()
    assert set(found.accounts) == {None}
    worth = {account.name: -account.deficit for account in found.accounts[None]}
    assert worth == {"nothing": 0.0, "cubic": 87.0, "drag": 47.0, "friction": 37.0, "line": 2.0, "never": -1.5}


def test_accounts_are_of_gains_less_prices_and_of_promises_where_nobody_was_carried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    accounts = Asked(monkeypatch, 2).trace().accounts
    assert set(accounts) == {"cubic", "drag"}
    deficits = {account.name: account.deficit for account in accounts["cubic"]}
    assert deficits == {"nothing": 77.0, "cubic": 0.0, "friction": 50.0, "drag": 30.0, "line": 75.0, "never": 78.5}


def test_alike_are_those_whose_signature_beside_the_rest_is_one_s_own_turned_by_little(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The cosine of the smallest angle between the two spaces, above 0.98."""
    asked = Asked(monkeypatch, 2)
    axes = np.eye(50)
    near, far = 0.985, 0.975
    asked.signatures = {
        "cubic": 5.0 * axes[:, :2],
        "drag": axes[:, 8:9],
        "friction": (near * axes[:, 1] + np.sqrt(1.0 - near**2) * axes[:, 5])[:, None] * 3.0,
        "line": (far * axes[:, 0] + np.sqrt(1.0 - far**2) * axes[:, 6])[:, None],
    }
    found = asked.trace()
    assert found.alike == (("cubic", "friction", pytest.approx(near)),)
    (one, other) = asked.looks
    # Beside the other that was taken, without its own coefficients among those that are fitted.
    assert one[0] == ["given", "drag"]
    assert one[1] == ["cubic", "friction", "line", "never"]
    assert one[2] == ("c_given", "c_drag")
    assert (one[3], one[4]) == (asked.model.choice, "cubic")
    monkeypatch.setattr(by_simulation, "as_near", lambda rounds: {"cubic": {"line"}, "never": {"friction"}})
    assert asked.trace().alike == (*found.alike, ("cubic", "line", pytest.approx(far)))
    assert other[0] == ["given", "cubic"]
    assert other[1] == ["drag", "friction", "line", "never"]


def test_without_some_the_rest_is_fitted_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Asked(monkeypatch, 2)
    found = asked.trace()
    asked.fits.clear()
    less = without(problem(), found, ("cubic",), 7)
    assert asked.fits == [(LONG, ("given", "drag"), found.after, slice(7, None))]
    assert (less.effects, less.evidence) == (("drag",), {"drag": 44.0})
    assert (less.observer, less.after.free) == ("observer of ('given', 'drag')", ("c_given", "c_drag"))
    asked.fits.clear()
    none = without(problem(), found, ("drag", "cubic"), 7)
    assert asked.fits == []
    assert (none.effects, none.evidence) == ((), {})
    assert (none.observer, none.after) == (found.observer_before, found.before)
    assert SimpleNamespace(**vars(none)).rejected == found.rejected
