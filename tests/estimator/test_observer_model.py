"""Models of two axes in the choice: who is carried, who is improved, what taking one out loses."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.record import Record
from estimator.settings import ObserverSettings
from estimator.trace import observer_model, parameters
from estimator.trace.criterion import TIE, chance_gain
from estimator.trace.engine import Estimate, Score, Trial
from estimator.trace.observer_model import Carrying, ObserverModel, numbers
from estimator.trace.problem import Problem
from estimator.trace.searched import NOTHING, Searched
from tests.estimator.device import UNLIKE as DEVICE

N = 30_000
PROBLEM = Problem(Record(np.zeros((N, 2)), np.zeros((N, 2, 1)), np.full(N, 1 / 4000.0)), DEVICE, ObserverSettings())
WATCHED: dict[str, dict[str, float]] = {
    "sense_gain": {},
    "drive_gain": {},
    "drag": {},
    "interference:1": {"omega": 700.0},
}


def fitted(effects: Any, likelihood: float, *, settled: bool = True) -> Any:
    return SimpleNamespace(
        likelihood=likelihood,
        settings=ObserverSettings(effects=effects),
        observer=SimpleNamespace(effects=effects),
        estimates=SimpleNamespace(innovation=np.zeros((N, 2))),
        settled=settled,
    )


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, tuple[str, ...], int]]:
    """What is fitted: samples, effects, passes, none where it is finished; a model's likelihood is what its effects are
    worth together, and one more when it is finished.
    """
    done: list[tuple[int, tuple[str, ...], int]] = []
    worth = {"known": 0.0, "sense_gain": 500.0, "drive_gain": 450.0, "drag": 300.0, "interference:1": 100.0}

    def fit(asked: Problem, passes: int = 2, *, again: bool = True) -> Any:
        done.append((len(asked.record), tuple(asked.effects), passes))
        return fitted(dict(asked.effects), 1000.0 + sum(worth[name] for name in asked.effects), settled=again)

    def finished(asked: Problem, model: Any) -> Any:
        assert not model.settled
        done.append((len(asked.record), tuple(model.settings.effects), 0))
        return fitted(model.settings.effects, model.likelihood + 1.0)

    monkeypatch.setattr(observer_model, "fit", fit)
    monkeypatch.setattr(observer_model, "finished", finished)
    monkeypatch.setattr(observer_model, "coefficients_of", lambda observer: dict(observer.effects))
    monkeypatch.setattr(observer_model, "parameters_of", lambda model, name: model.settings.effects[name])
    monkeypatch.setattr(observer_model, "turned_into", lambda asked, name, given: None)
    return done


def trial(name: str, gain: float, likelihood: float = 1500.0) -> Trial[Any]:
    model = fitted({"known": {}, name: {}}, likelihood)
    return Trial(Carrying(PROBLEM, model), Score(likelihood, gain, 10.0, 20.0))


LINE = {"interference:1": WATCHED["interference:1"]}
LOOK: Any = SimpleNamespace(watched=WATCHED, evidence=dict.fromkeys(WATCHED))
BASE = Carrying(PROBLEM, fitted({"known": {}}, 1000.0), {"known": NOTHING})


def test_those_near_the_best_are_improved_and_all_are_beside_what_is_carried(
    monkeypatch: pytest.MonkeyPatch, fits: Any
) -> None:
    asked: dict[str, Any] = {}
    told: list[tuple[str, int, int]] = []

    def near(models: Any, base: Any, tried: Any, watched: Any) -> list[str]:
        asked.update(models=set(models), tried=tried, base=base.likelihood)
        return ["interference:1"]

    def refine(problem: Problem, model: Any, name: str, *, to_beat: float) -> Any:
        asked["to_beat"] = to_beat
        return fitted(model.settings.effects, 2000.0), "searched"

    monkeypatch.setattr(observer_model, "worth_refining", near)
    monkeypatch.setattr(observer_model, "refine_parameters", refine)
    model = ObserverModel(PROBLEM, lambda *what: told.append(what))
    found: Any = model.fit(BASE, LOOK, ["sense_gain", "interference:1"], {})
    first = [(N, ("known", "sense_gain"), 2), (N, ("known", "interference:1"), 2)]
    assert fits == [*first, (N, ("known", "sense_gain"), 0)]  # the line is behind by 400
    assert asked == {
        "models": {"sense_gain", "interference:1"}, "tried": {}, "base": 1000.0, "to_beat": 1501.0,
    }  # fmt: skip
    assert found["interference:1"].fitted.likelihood == 2000.0
    assert found["interference:1"].searched == {"known": NOTHING, "interference:1": "searched"}
    assert found["sense_gain"].searched == {"known": NOTHING, "sense_gain": NOTHING}
    assert told == [("candidates", 1, 2), ("candidates", 2, 2), ("parameters", 1, 1)]
    # What was tried in the round before counts, too: the best of it gains 900 over the base.
    model.fit(BASE, LOOK, ["sense_gain", "interference:1"], {"drag": trial("drag", 900.0)})
    assert (asked["tried"], asked["to_beat"]) == ({"drag": 900.0}, 1900.0)


@pytest.mark.parametrize(
    ("likelihoods", "begins", "ends"),
    [
        ({False: 700.0, True: 1400.0}, True, 1400.0),  # there it is found
        ({False: 700.0, True: 600.0}, True, 700.0),
        ({False: -np.inf, True: 1400.0}, True, 1400.0),
        ({False: 1000.0, True: 1400.0}, True, 1400.0),  # no more than without it, which it may be
        ({False: 1000.5, True: 1400.0}, False, 1000.5),
    ],
)
def test_one_that_loses_begins_again_with_the_coefficients_of_the_scan(
    monkeypatch: pytest.MonkeyPatch, fits: Any, likelihoods: dict[bool, float], begins: bool, ends: float
) -> None:
    begun: list[tuple[dict[str, float], bool]] = []

    def fit(asked: Problem, *, again: bool = True) -> Any:
        given = dict(asked.effects["interference:1"])
        begun.append((given, again))
        return fitted(dict(asked.effects), likelihoods["lcx" in given])

    monkeypatch.setattr(observer_model, "fit", fit)
    monkeypatch.setattr(observer_model, "worth_refining", lambda *asked: [])
    monkeypatch.setattr(observer_model, "worth_finishing", lambda *asked: [])
    scanned = SimpleNamespace(coefficients=np.array([0.1, 0.2, 0.3, 0.4]))
    look: Any = SimpleNamespace(watched=WATCHED, evidence={"interference:1": scanned})
    told: list[tuple[str, int, int]] = []
    model = ObserverModel(PROBLEM, lambda *what: told.append(what))
    found: Any = model.fit(BASE, look, ["interference:1"], {})
    assert found["interference:1"].fitted.likelihood == ends
    assert told == [("candidates", 1, 1), *([("candidates begun again", 1, 1)] if begins else [])]
    # As often as it takes, not with the passes of a glance.
    fresh = ({"omega": 700.0, "lcx": 0.1, "lsx": 0.2, "lcy": 0.3, "lsy": 0.4}, True)
    assert begun == [({"omega": 700.0}, False), *([fresh] if begins else [])]


@pytest.mark.parametrize(
    ("name", "high", "searched"),
    [("sense_high_pass:3", -1.0, False), ("sense_high_pass:3", 1.0, True), ("drag", -1.0, True)],
)
def test_no_search_for_the_corner_of_a_filter_that_would_have_to_run_backwards(
    monkeypatch: pytest.MonkeyPatch, fits: Any, name: str, high: float, *, searched: bool
) -> None:
    """Elsewhere a coefficient of the wrong sign may stand for a parameter that is not there yet."""
    monkeypatch.setattr(observer_model, "fit", lambda asked, **how: fitted(dict(asked.effects), 1500.0, settled=False))
    given = {"c": Estimate(-8.5, -9.0, high, positive=True), "other": Estimate(0.01, -1.0, 1.0, positive=True)}
    monkeypatch.setattr(observer_model, "estimates_of", lambda model, searches: {name: given})
    monkeypatch.setattr(observer_model, "worth_refining", lambda *asked: [name])
    asked: list[str] = []

    def refine(problem: Problem, model: Any, name: str, *, to_beat: float) -> Any:
        asked.append(name)
        return model, NOTHING

    monkeypatch.setattr(observer_model, "refine_parameters", refine)
    look: Any = SimpleNamespace(watched={name: {}})
    assert isinstance(ObserverModel(PROBLEM).fit(BASE, look, [name], {})[name], Carrying)
    assert asked == ([name] if searched else [])


@pytest.mark.parametrize(
    ("watched", "between"),
    [
        ({"dry_friction:1": {"v0": 1.0}, "dry_friction:2": {"v0": 9.0}, "dry_friction:3": {"v0": 4.0}}, 3.0),
        ({"dry_friction:1": {"v0": 1.0}, "drive_saturation": {"v0": 9.0}}, None),  # another kind
        ({"interference:1": {"omega": 1.0}, "interference:2": {"omega": 9.0}}, None),  # two lines are two
        ({"dry_friction:1": {"v0": 1.0, "vs": 2.0}, "dry_friction:2": {"v0": 9.0, "vs": 2.0}}, None),
    ],
)
@pytest.mark.parametrize("earlier", [True, False])
def test_a_search_begins_between_two_of_a_kind_where_that_is_better(
    monkeypatch: pytest.MonkeyPatch, fits: Any, watched: Any, between: float | None, *, earlier: bool
) -> None:
    """At the geometric mean of the best and the next best of its kind, wherever that was carried."""
    names = list(watched)
    worth = {name: 1500.0 - 100.0 * place for place, name in enumerate(names)}

    def fit(asked: Problem, passes: int = 2, *, again: bool = True) -> Any:
        ((name, given),) = ((name, given) for name, given in asked.effects.items() if name != "known")
        at = given.get("v0", given.get("omega"))
        return fitted(dict(asked.effects), 1600.0 if at == between else worth[name], settled=again)

    monkeypatch.setattr(observer_model, "fit", fit)
    monkeypatch.setattr(observer_model, "finished", lambda asked, model: model)
    monkeypatch.setattr(observer_model, "worth_refining", lambda *asked: [names[0]])
    monkeypatch.setattr(observer_model, "worth_following", lambda *asked: {})
    begun: list[Any] = []

    def refine(problem: Problem, model: Any, name: str, *, to_beat: float) -> Any:
        begun.append((name, model.settings.effects[name], model.likelihood))
        return model, NOTHING

    monkeypatch.setattr(observer_model, "refine_parameters", refine)
    look: Any = SimpleNamespace(watched=watched)
    before = names[1:] if earlier else []
    tried = {name: trial(name, worth[name] - 1000.0, worth[name]) for name in before}
    for name in before:
        tried[name].fit.fitted.settings.effects[name].update(watched[name])
    ObserverModel(PROBLEM).fit(BASE, look, [name for name in names if name not in before], tried)
    expected = watched[names[0]] if between is None else {"v0": between}
    assert begun == [(names[0], expected, 1500.0 if between is None else 1600.0)]


@pytest.mark.parametrize("better", [True, False])
def test_what_has_the_parameter_of_another_that_was_searched_follows_it_where_it_is_better_there(
    monkeypatch: pytest.MonkeyPatch, fits: Any, *, better: bool
) -> None:
    worth = {("interference:1", 7.0): 1090.0, ("base_vibration:1", 7.0): 1080.0}
    worth["base_vibration:1", 7.5] = 1200.0 if better else 1070.0

    def fit(asked: Problem, passes: int = 2, *, again: bool = True) -> Any:
        ((name, given),) = ((name, given) for name, given in asked.effects.items() if name != "known")
        return fitted(dict(asked.effects), worth[name, given["omega"]], settled=again)

    monkeypatch.setattr(observer_model, "fit", fit)
    monkeypatch.setattr(observer_model, "worth_refining", lambda *asked: ["interference:1"])
    monkeypatch.setattr(observer_model, "worth_following", lambda *asked: {"base_vibration:1": asked[-1][0]})
    moved, known = fitted({"known": {}, "interference:1": {"omega": 7.5}}, 1190.0), np.array([[4.0]])
    monkeypatch.setattr(
        observer_model,
        "refine_parameters",
        lambda *asked, **more: (moved, Searched(("omega",), known, np.ones((3, 1)))),
    )
    look: Any = SimpleNamespace(watched={"interference:1": {"omega": 7.0}, "base_vibration:1": {"omega": 7.0}})
    found: Any = ObserverModel(PROBLEM).fit(BASE, look, ["interference:1", "base_vibration:1"], {})["base_vibration:1"]
    assert found.fitted.settings.effects["base_vibration:1"] == {"omega": 7.5 if better else 7.0}
    searched = found.searched["base_vibration:1"]
    if better:
        np.testing.assert_array_equal(searched.covariance, known)
        np.testing.assert_array_equal(searched.moves, np.zeros((4, 1)))  # what moves its own four nobody asked
    else:
        assert searched is NOTHING


def test_what_turns_into_a_simpler_effect_is_no_model(monkeypatch: pytest.MonkeyPatch, fits: Any) -> None:
    monkeypatch.setattr(observer_model, "worth_refining", lambda *asked: [])
    monkeypatch.setattr(
        observer_model, "turned_into", lambda asked, name, given: "drive gain" if name == "drag" else None
    )
    found = ObserverModel(PROBLEM).fit(BASE, LOOK, ["drag", "sense_gain"], {})
    assert found["drag"] == "its parameters go where it is drive gain"
    assert isinstance(found["sense_gain"], Carrying)


def test_taking_one_out_loses_what_the_model_without_it_lacks(fits: Any) -> None:
    carried = {"known": {}, "sense_gain": {"gy": 0.1}, "drag": {"dqx": 1.0}}
    current = Carrying(PROBLEM, fitted(carried, 1800.0), dict.fromkeys(carried, NOTHING))
    less, score = ObserverModel(PROBLEM).without(current, "drag")
    assert fits == [(N, ("known", "sense_gain"), 1)]
    assert (score.likelihood, score.gain) == (1800.0, 300.0)
    assert score.price == pytest.approx(2 * np.log(2 * N))  # two coefficients, of samples of two axes
    assert score.bar == pytest.approx(-2.0 * np.log(1e-4 / 30.0))  # χ² of two, for one of thirty
    assert set(less.searched) == {"known", "sense_gain"}
    assert ObserverModel(PROBLEM).without(current, "drag")[0] is less  # of one pass, however often it is asked
    assert len(fits) == 1


@pytest.mark.parametrize(("power", "asked"), [(1.04, []), (1.06, ["limit"])])
def test_what_was_found_is_searched_for_again_beside_the_newest_where_something_is_left(
    monkeypatch: pytest.MonkeyPatch, power: float, asked: list[str]
) -> None:
    """Of those that were taken before it, the ones with a parameter that was searched for, from where that was."""
    known = Searched(("level",), np.eye(1), np.zeros((2, 1)))
    better = replace(known, covariance=4.0 * np.eye(1))
    done: list[str] = []

    def refined(problem: Any, model: Any, name: str, *, before: Searched) -> Any:
        assert (problem, before) == (PROBLEM, known)
        done.append(name)
        return fitted(model.settings.effects, model.likelihood + 10.0), better

    monkeypatch.setattr(parameters, "refine_parameters", refined)
    monkeypatch.setattr(observer_model, "widening", lambda model: power**0.5)
    searched = {"limit": known, "drag": NOTHING, "newest": known}
    current = Carrying(PROBLEM, fitted({name: {} for name in searched}, 100.0), searched)
    settled = ObserverModel(PROBLEM).settled(current, ["limit", "drag"], "newest")
    assert done == asked
    assert settled.fitted.likelihood == 100.0 + 10.0 * len(asked)
    assert settled.searched == searched | dict.fromkeys(asked, better)


@pytest.mark.parametrize("taken", [[], ["before"]])
@pytest.mark.parametrize("power", [1.04, 1.06])
def test_a_corner_that_no_coefficient_tells_is_looked_for_by_itself_where_something_is_left(
    monkeypatch: pytest.MonkeyPatch, power: float, taken: list[str]
) -> None:
    """The newest too: beside nobody, its size may stand for the phase of whoever is still missing."""
    known = Searched(("leak_x", "leak_y"), np.eye(2), np.zeros((4, 2)))

    def apart(problem: Any, model: Any, name: str) -> Any:
        return fitted(model.settings.effects, model.likelihood + 10.0), known if name == "before" else NOTHING

    monkeypatch.setattr(observer_model, "refine_apart", apart)
    monkeypatch.setattr(observer_model, "widening", lambda model: power**0.5)
    names = [*taken, "newest"]
    current = Carrying(PROBLEM, fitted({name: {} for name in names}, 100.0), {"newest": NOTHING})
    settled = ObserverModel(PROBLEM).settled(current, taken, "newest")
    again = names if power > 1.05 else []
    assert settled.fitted.likelihood == 100.0 + 10.0 * len(again)
    assert settled.searched == {"newest": NOTHING} | dict.fromkeys([name for name in taken if again], known)


def test_a_short_part_is_asked_about_each_in_place_of_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def hopeful(look: Any, gains: Any, refused: Any, left: Any, screened: Any, *, calm: bool) -> list[str]:
        asked.update(gains=gains, refused=refused, left=left)
        return list(screened(["drive_gain", "interference:1"], ["drive_gain"]))

    def spoken_for(*what: Any) -> list[str]:
        asked["of"] = what
        return ["drive_gain"]

    monkeypatch.setattr(observer_model, "hopeful", hopeful)
    monkeypatch.setattr(observer_model, "spoken_for", spoken_for)
    monkeypatch.setattr(observer_model, "look_at", lambda problem, model: ("left by", *model.settings.effects))
    best, other = trial("sense_gain", 500.0), trial("drag", 100.0, 1100.0)
    model = ObserverModel(PROBLEM)
    assert model.hopeful(LOOK, {"drag": other, "sense_gain": best}, {"drive_delay"}, 0) == ["drive_gain"]
    assert asked["gains"] == {"drag": 100.0, "sense_gain": 500.0}
    assert asked["refused"] == {"drive_delay"}
    assert asked["left"]() == ("left by", "known", "sense_gain")
    others = {"drive_gain": {"known": {}, "drive_gain": {}}, "interference:1": {"known": {}, **LINE}}
    beside = ({"known": {}, "sense_gain": {}}, {"known": {}}, others)
    assert asked["of"] == (PROBLEM, *beside, ["drive_gain"], 500.0, model.progress)


def test_those_that_are_barred_are_watched_and_have_no_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    from estimator.trace.look import Look

    seen: Any = None
    evidence: Any = dict.fromkeys(WATCHED)
    monkeypatch.setattr(observer_model, "look_at", lambda problem, model: Look(WATCHED, seen, evidence))
    current = Carrying(PROBLEM, fitted({}, 0.0))
    whole = ObserverModel(PROBLEM).promise(current, ())
    assert set(whole.evidence) == set(WATCHED)
    barred = ObserverModel(PROBLEM).promise(current, {"drag"})
    assert (set(barred.evidence), set(barred.watched)) == (set(WATCHED) - {"drag"}, set(WATCHED))


def test_what_does_not_carry_over_is_objected_to(monkeypatch: pytest.MonkeyPatch) -> None:
    for over in (True, False):
        monkeypatch.setattr(observer_model, "carries_over", lambda problem, base, model, name, over=over: over)
        said = ObserverModel(PROBLEM).objection(BASE, "drag", trial("drag", 100.0))
        assert (said is None) is over
        assert over or "does not predict the rest better" in str(said)


@pytest.mark.parametrize(
    ("name", "calm", "numbers"),
    [
        ("parasitic_mode:1", True, 2),  # its frequency and its damping show nowhere else
        ("parasitic_mode:1", False, 4),
        ("drive_saturation", True, 3),
        ("drive_saturation", False, 3),
    ],
)
def test_of_a_mode_a_drive_of_one_frequency_tells_the_coefficients_alone(
    monkeypatch: pytest.MonkeyPatch, name: str, calm: bool, numbers: int
) -> None:
    monkeypatch.setattr(observer_model, "of_resonance_alone", lambda record, device: calm)
    problem: Any = SimpleNamespace(record=None, device=DEVICE)
    assert observer_model.told(name, problem) == numbers


def borne_out(monkeypatch: pytest.MonkeyPatch, late: float, carried: float) -> bool:
    """Of an effect that gains a lot, so much of it in the last third, and `carried` by who has not seen that."""
    monkeypatch.setattr(observer_model, "foresight", lambda problem, seen: carried if problem.effects else 0.0)
    monkeypatch.setattr(observer_model, "coefficients_of", lambda observer: {})
    monkeypatch.setattr(observer_model, "parameters_of", lambda model, name: {})
    monkeypatch.setattr(observer_model, "leads", lambda model, base: np.array([9e5, 9e5, late]))

    def carrying(effects: Any) -> Any:
        return SimpleNamespace(effects=effects)

    problem: Any = SimpleNamespace(record=range(900), device=DEVICE, carrying=carrying)
    base, model = (SimpleNamespace(likelihood=one, observer=None) for one in (0.0, 1e6))
    return observer_model.carries_over(problem, base, model, "drive_gain")


def test_what_bears_out_and_what_speaks_against_is_more_than_the_bound_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chance gives an effect of two coefficients −2 ln 10⁻⁴; two accounts are told apart that differ by odds of 20."""
    chance = chance_gain(2, 1)
    assert chance == pytest.approx(-2.0 * np.log(1e-4))
    below = np.nextafter(chance, 0.0)
    assert not borne_out(monkeypatch, 4.0 * chance, chance)
    assert borne_out(monkeypatch, 4.0 * chance, np.nextafter(chance, 99.0))
    assert not borne_out(monkeypatch, chance, chance / 4.0)
    assert borne_out(monkeypatch, chance, np.nextafter(chance / 4.0, 99.0))
    assert not borne_out(monkeypatch, below, -TIE)
    assert borne_out(monkeypatch, below, np.nextafter(-TIE, 0.0))


def test_coefficients_are_those_of_the_model_with_what_was_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observer_model, "estimates_of", lambda model, searched: (model, searched))
    model: Any = "model"
    carrying = Carrying(PROBLEM, model, {"drag": NOTHING})
    assert ObserverModel(PROBLEM).coefficients(carrying) == ("model", {"drag": NOTHING})


@pytest.mark.parametrize(
    ("name", "paid"), [("sense_low_pass", 2), ("sense_high_pass", 2), ("drag", 2), ("drive_saturation", 3)]
)
def test_how_an_effect_begins_and_wanes_is_not_paid_for(name: str, paid: int) -> None:
    """A few samples tell it; the price of a number is that of one that all samples tell of.  A level is one more."""
    assert numbers(name, PROBLEM.device) == paid
