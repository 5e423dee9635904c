"""How a choice for two axes begins, on how much of the record, and what is fitted again (docs/decisions/tracing.md)."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.effects import catalogue
from estimator.errors import ModelError
from estimator.record import Record
from estimator.settings import ObserverSettings
from estimator.trace import parameters, selection
from estimator.trace.criterion import TIE
from estimator.trace.engine import Dissent, Outcome, Round, Score, Tried
from estimator.trace.probability import Account
from estimator.trace.problem import Problem
from estimator.trace.rivals import Rival
from estimator.trace.searched import NOTHING
from tests.estimator.device import NOMINAL as DEVICE

COMPARED, CONFIRMED = 1000, 6000


def problem(samples: int) -> Problem:
    record = Record(np.zeros((samples, 2)), np.zeros((samples, 2, 1)), np.full(samples, 1 / 4000.0))
    return Problem(record, DEVICE, ObserverSettings(effects={"drag": {"dqx": 1.0}}))


def model(effects: tuple[str, ...], samples: int, likelihood: float = 0.0) -> Any:
    return SimpleNamespace(
        likelihood=likelihood,
        settings=ObserverSettings(initial={"kxx": 7.0}, effects={name: {} for name in effects}),
        observer=SimpleNamespace(effects=effects),
        estimates=SimpleNamespace(innovation=np.zeros((samples, 2))),
    )


class Bench:
    """Records what is fitted, and on how much; the choice takes what it is told to."""

    def __init__(self, taken: tuple[str, ...], kept: tuple[str, ...], *, more: bool, likelihood: float) -> None:
        self.taken, self.kept, self.more, self.likelihood = taken, kept, more, likelihood
        self.fits: list[tuple[int, tuple[str, ...], float | None]] = []
        self.searched: list[tuple[str, int, str]] = []
        self.held: list[tuple[int, int, Any]] = []

    def fit(self, asked: Problem, passes: int = 2, *, about: Any = None) -> Any:
        if about is not None:  # of the whole record, about what the part came to
            assert passes == 1
            assert tuple(about.effects) == tuple(asked.effects)
        self.fits.append((len(asked.record), tuple(asked.effects), asked.settings.initial.get("kxx")))
        return model(tuple(asked.effects), len(asked.record), self.likelihood)

    def choose(self, family: Any, start: Any, rules: Any, progress: Callable[[int, int], None], reducible: Any) -> Any:
        assert reducible is family
        progress(1, rules.most)
        self.family, self.rules = family, rules
        rounds = [
            SimpleNamespace(taken=name, look=SimpleNamespace(alike=lambda other: {f"beside {other}": 0.5}))
            for name in (*self.taken, None)
        ]
        steps, carried = [], ("drag",)
        for name in self.taken:
            carried = (*carried, name)
            searched = {one: f"searched {one}" for one in carried[1:]}
            fit = SimpleNamespace(fitted=model(carried, COMPARED), searched=searched, problem=family.problem)
            steps.append(SimpleNamespace(name=name, trial=SimpleNamespace(fit=fit)))
        last = SimpleNamespace(fitted=model(("drag", *self.kept), COMPARED), less={})
        last.fitted.settings = ObserverSettings(
            initial={"kxx": 7.0}, effects={name: {} for name in last.fitted.observer.effects}
        )
        self.last = last
        carrying = steps[-1].trial.fit if steps else start
        return SimpleNamespace(
            steps=steps, rounds=rounds, more=self.more, fit=carrying, gains=dict.fromkeys(self.kept, 500.0)
        )

    def best_way(self, family: Any, chosen: Any, rules: Any, progress: Callable[[int, int], None]) -> Any:
        assert (family, rules) == (self.family, self.rules)
        self.asked_again = chosen
        return SimpleNamespace(**vars(chosen))

    def gone_on(self, family: Any, chosen: Any, rules: Any, progress: Callable[[int, int], None]) -> Any:
        progress(1, rules.most)
        samples = len(family.problem.record)
        self.held.append((samples, len(chosen.fit.fitted.estimates.innovation), rules))
        self.last.fitted = model(("drag", *self.kept), samples)
        fit = SimpleNamespace(fitted=self.last.fitted, searched=chosen.steps[-1].trial.fit.searched,
                              problem=family.problem)  # fmt: skip
        return SimpleNamespace(**(vars(chosen) | {"fit": fit}))

    def asked(self, more: Problem, model: Any) -> bool:
        self.later = len(more.record), model.observer.effects
        return True

    def refine(self, asked: Problem, fitted: Any, name: str, *, before: str) -> Any:
        self.searched.append((name, len(asked.record), before))
        return fitted, f"again {name}"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Bench, Any]]:
    def run(
        samples: int,
        taken: tuple[str, ...] = (),
        kept: tuple[str, ...] | None = None,
        *,
        more: bool = False,
        likelihood: float = 0.0,
        widened: float = 1.0,
        later: bool = False,
        told_apart: tuple[str, ...] = (),
    ) -> tuple[Bench, Any]:
        made = Bench(taken, taken if kept is None else kept, more=more, likelihood=likelihood)
        monkeypatch.setattr(selection, "_SET", replace(selection._SET, compared=COMPARED, confirmed=CONFIRMED))
        monkeypatch.setattr(selection, "gone_on", made.gone_on)
        monkeypatch.setattr(selection, "shows_later", lambda more, model: later and made.asked(more, model))
        monkeypatch.setattr(selection, "fit", made.fit)
        monkeypatch.setattr(selection, "choose", made.choose)
        monkeypatch.setattr(selection, "best_way", made.best_way)
        monkeypatch.setattr(
            selection, "pruned", lambda family, chosen: SimpleNamespace(**(vars(chosen) | {"fit": made.last}))
        )
        monkeypatch.setattr(selection, "refine_parameters", made.refine)
        monkeypatch.setattr(parameters, "refine_parameters", made.refine)
        monkeypatch.setattr(selection, "widening", lambda model: widened)
        monkeypatch.setattr(selection, "coefficients_of", lambda observer: {name: {} for name in observer.effects})
        monkeypatch.setattr(selection, "effects_of", lambda model, searched: {n: {} for n in model.observer.effects})
        monkeypatch.setattr(
            selection,
            "rivals",
            lambda step: {} if step.name in told_apart else {f"rival of {step.name}": None},
        )
        monkeypatch.setattr(selection, "accounts", lambda step, look: (step.name, look))
        monkeypatch.setattr(selection, "left_out", lambda look: ("left out", look))
        told: list[tuple[str, int, int]] = []
        found = selection.select(problem(samples), lambda *what: told.append(what))
        assert told == [("effects", 1, 3)] * (1 + len(made.held))
        return made, found

    return run


def test_of_a_short_record_with_one_effect_nothing_is_fitted_again(bench: Any) -> None:
    made, found = bench(COMPARED, ("drive_gain",))
    assert made.fits == [(COMPARED, ("drag",), None)]
    assert made.searched == []
    assert set(found.effects) == {"drag", "drive_gain"}
    assert tuple(found.before.observer.effects) == ("drag",)
    assert tuple(found.after.observer.effects) == ("drag", "drive_gain")
    assert (found.gain, found.patchwork, found.samples) == ({"drive_gain": 500.0}, False, COMPARED)
    assert found.searched == {"drive_gain": "searched drive_gain"}
    assert found.alike == {"drive_gain": {"beside drive_gain": 0.5}}
    assert found.rivals == {"drive_gain": {"rival of drive_gain": None}}
    assert found.accounts == {"drive_gain": ("drive_gain", found.rounds[0].look)}


def test_candidates_compete_on_a_part_and_the_models_before_and_after_are_of_the_whole(bench: Any) -> None:
    made, found = bench(COMPARED + 1, ("drive_gain",))
    assert len(made.family.problem.record) == COMPARED
    first, *whole = made.fits
    assert first == (COMPARED, ("drag",), None)
    assert sorted(whole, key=lambda one: len(one[1])) == [
        (COMPARED + 1, ("drag",), 7.0),  # both from the constants of the part
        (COMPARED + 1, ("drag", "drive_gain"), 7.0),
    ]
    assert found.samples == COMPARED + 1
    assert made.searched == [("drive_gain", COMPARED + 1, "searched drive_gain")]
    assert found.searched == {"drive_gain": "again drive_gain"}


@pytest.mark.parametrize("samples", [4 * COMPARED - 1, 4 * COMPARED, CONFIRMED + 1])
def test_the_choice_of_a_record_four_times_as_long_is_held_to_more_of_it(bench: Any, samples: int) -> None:
    made, found = bench(samples, ("drive_gain",), told_apart=("drive_gain",))
    if samples < 4 * COMPARED:
        assert made.held == []
        return
    ((held, before, rules),) = made.held
    assert (held, before, rules) == (min(samples, CONFIRMED), COMPARED, selection.RULES)
    _, *whole = made.fits
    carried = [("drag",)] if samples <= CONFIRMED else [("drag",), ("drag", "drive_gain")]
    # What was held to all of it is of the whole already.
    assert sorted((effects for _, effects, _ in whole), key=len) == carried
    assert {length for length, *_ in whole} == {samples}
    assert len(made.searched) == (samples > CONFIRMED)
    assert found.samples == samples


@pytest.mark.parametrize(
    ("samples", "told_apart", "held"),
    [
        (2 * COMPARED - 1, (), False),
        (2 * COMPARED, (), True),
        (2 * COMPARED, ("drive_gain",), False),
        (2 * COMPARED, ("drive_gain", "line"), False),
        (2 * COMPARED, ("line",), True),
    ],
)
def test_the_choice_of_a_record_twice_as_long_is_held_to_more_of_it_where_the_beginning_does_not_tell_some_apart(
    bench: Any, samples: int, told_apart: tuple[str, ...], *, held: bool
) -> None:
    """Whoever was taken and not kept does not matter."""
    made, _ = bench(samples, ("drive_gain", "gone"), ("drive_gain",), told_apart=told_apart)
    assert [one[0] for one in made.held] == ([samples] if held else [])


@pytest.mark.parametrize("samples", [COMPARED, COMPARED + 1])
def test_the_choice_is_held_to_more_of_a_shorter_record_where_that_shows_what_the_beginning_does_not(
    bench: Any, samples: int
) -> None:
    made, found = bench(samples, ("drive_gain",), later=True)
    assert len(made.held) == (samples > COMPARED)
    if made.held:
        assert made.held[0][0] == samples
        assert made.later == (samples, ("drag", "drive_gain"))
    assert found.samples == samples


def test_a_long_record_on_which_nothing_is_chosen_is_fitted_whole_once(bench: Any) -> None:
    made, found = bench(COMPARED + 1, ())
    assert made.fits == [(COMPARED, ("drag",), None), (COMPARED + 1, ("drag",), 7.0)]
    assert found.before is found.after


def test_parameters_are_searched_for_again_beside_another_effect(bench: Any) -> None:
    made, found = bench(COMPARED, ("interference", "drive_gain"))
    assert made.searched == [
        ("interference", COMPARED, "searched interference"),
        ("drive_gain", COMPARED, "searched drive_gain"),
    ]
    assert len(made.fits) == 1
    assert found.searched == {"interference": "again interference", "drive_gain": "again drive_gain"}


def test_of_a_patchwork_no_parameter_is_searched_for(bench: Any) -> None:
    made, found = bench(COMPARED + 1, ("interference", "drive_gain"), more=True)
    assert made.searched == []
    assert found.patchwork


@pytest.mark.parametrize(("widened", "searched"), [(1.99, 1), (2.0, 0), (2.01, 0)])
def test_of_what_explains_nothing_no_parameter_is_searched_for(bench: Any, widened: float, searched: int) -> None:
    """Four times the predicted power, and it is no model wherever its parameters are."""
    made, found = bench(COMPARED + 1, ("interference",), widened=widened)
    assert len(made.searched) == searched
    assert set(found.searched) == {"interference"}


def test_what_a_later_effect_made_superfluous_is_gone_from_the_model(bench: Any) -> None:
    made, found = bench(COMPARED, ("drag:2", "drive_gain"), ("drive_gain",))
    assert made.fits[1:] == [(COMPARED, ("drag", "drive_gain"), 7.0)]
    assert set(found.effects) == {"drag", "drive_gain"}
    assert set(found.gain) == {"drive_gain"}


def test_where_nothing_is_taken_every_account_is_of_the_first_look(bench: Any) -> None:
    made, found = bench(COMPARED)
    assert found.after is found.before
    assert (set(found.effects), found.gain, found.searched) == ({"drag"}, {}, {})
    assert found.accounts == {None: ("left out", found.rounds[0].look)}
    assert (made.rules.most, made.rules.dissent) == (3, Dissent.ENDS)
    assert (made.rules.signs, made.rules.anew) == (True, True)


def test_an_observer_that_diverges_is_no_model_to_begin_with(bench: Any) -> None:
    with pytest.raises(ModelError, match="the observer diverges on this record; correct"):
        bench(COMPARED, likelihood=-np.inf)


def test_coefficients_are_those_of_the_model_after_with_what_was_searched_for(
    monkeypatch: pytest.MonkeyPatch, bench: Any
) -> None:
    _, found = bench(COMPARED, ("drive_gain",))
    monkeypatch.setattr(selection, "estimates_of", lambda model, searched: (model, searched))
    assert found.coefficients == (found.after, found.searched)


def test_what_is_taken_out_is_neither_carried_nor_counted(monkeypatch: pytest.MonkeyPatch, bench: Any) -> None:
    made, found = bench(COMPARED, ("drive_gain", "sense_gain"))
    less = selection.without(problem(COMPARED), found, ("drive_gain",))
    assert made.fits[-1] == (COMPARED, ("drag", "sense_gain"), 7.0)
    assert (set(less.effects), less.gain) == ({"drag", "sense_gain"}, {"sense_gain": 500.0})
    assert tuple(less.after.observer.effects) == ("drag", "sense_gain")
    fits = len(made.fits)
    none = selection.without(problem(COMPARED), found, ("drive_gain", "sense_gain"))
    assert none.after is found.before
    assert (set(none.effects), none.gain) == ({"drag"}, {})
    assert len(made.fits) == fits


class Exchange:
    """A selection of `drag`, known already, a delay and a line, with two rivals of the delay; fits are noted."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *, lead: float) -> None:
        self.fits: list[tuple[int, dict[str, Any], Any]] = []
        self.refined: list[tuple[str, Any]] = []
        self.lead = lead
        monkeypatch.setattr(selection, "fit", self.fit)
        monkeypatch.setattr(selection, "refine_parameters", self.refine)
        monkeypatch.setattr(parameters, "refine_parameters", self.refine)
        monkeypatch.setattr(selection, "effects_of", lambda model, searched: dict.fromkeys(model.observer.effects))
        likeness = {"drive_delay": {"sense_delay": 1.0, "drive_delay:2": 0.9, "sense_low_pass": 0.99}}
        tried = [
            Tried(name, outcome, "", Score(0.0, 50.0, 1.0, 5.0), {})
            for name, outcome in (("sense_delay", Outcome.TAKEN), ("drive_delay", Outcome.BEATEN))
        ]
        look = SimpleNamespace(alike=lambda name: likeness[name])
        self.selection = selection.Selection(
            effects={"drag": {}, "sense_delay": {"tsx": 3e-5}, "interference": {"omega": 9.0}},
            rounds=(Round(look, tuple(tried), "sense_delay"), Round("later", (), None)),
            alike={"sense_delay": {"drive_delay": 1.0}, "interference": {"base_vibration": 1.0}},
            rivals={
                "sense_delay": {
                    "drive_delay": Rival(1.5, TIE, {"band": 2.0}, "how surely"),
                    "sense_low_pass": Rival(4.0, TIE, {}),
                },
                "interference": {},
            },
            accounts={
                "sense_delay": (Account("sense_delay", 0.0), Account("drive_delay", 1.5), Account("nothing", 900.0)),
                "interference": (Account("interference", 0.0),),
            },
            before="before",
            after=model(("drag", "sense_delay", "interference"), COMPARED, 1000.0),
            gain={"sense_delay": 400.0, "interference": 90.0},
            searched={"sense_delay": NOTHING, "interference": "of the line"},
            patchwork=False,
        )

    def fit(self, asked: Problem) -> Any:
        self.fits.append((len(asked.record), dict(asked.effects), asked.settings.initial))
        return model(tuple(asked.effects), COMPARED, 1000.0 - self.lead)

    def refine(self, asked: Problem, fitted: Any, name: str, *, before: Any) -> Any:
        self.refined.append((name, before))
        return fitted, "found anew"


def test_a_rival_stands_in_the_place_of_what_it_replaces(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Exchange(monkeypatch, lead=1.5)
    found = selection.instead(problem(COMPARED), made.selection, "sense_delay", "drive_delay")
    ((samples, effects, initial),) = made.fits
    assert (samples, initial) == (COMPARED, {"kxx": 7.0})
    assert effects == {"drag": {}, "interference": {"omega": 9.0}, "drive_delay": {"band": 2.0}}
    assert made.refined == [("drive_delay", "how surely")]
    assert set(found.effects) == {"drag", "interference", "drive_delay"}
    assert found.gain == {"drive_delay": 398.5, "interference": 90.0}
    assert found.searched == {"interference": "of the line", "drive_delay": "found anew"}
    assert [one.taken for one in found.rounds] == ["drive_delay", None]
    assert {one.name: one.outcome for one in found.rounds[0].tried} == {
        "sense_delay": Outcome.BEATEN, "drive_delay": Outcome.TAKEN}  # fmt: skip
    # Who was replaced is told apart; the others are as near to the one as they were to the other.
    assert found.alike == {
        "drive_delay": {"drive_delay:2": 0.9, "sense_low_pass": 0.99},
        "interference": {"base_vibration": 1.0},
    }
    assert found.rivals == {"drive_delay": {"sense_low_pass": Rival(2.5, TIE, {})}, "interference": {}}
    assert found.accounts == {
        "drive_delay": (Account("sense_delay", -1.5), Account("drive_delay", 0.0), Account("nothing", 898.5)),
        "interference": (Account("interference", 0.0),),
    }
    assert (found.before, found.patchwork) == ("before", False)


def test_a_rival_that_the_observer_loses_is_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    made = Exchange(monkeypatch, lead=np.inf)
    found = selection.instead(problem(COMPARED), made.selection, "sense_delay", "drive_delay")
    assert made.refined == []
    assert found.searched["drive_delay"] == "how surely"


@pytest.mark.parametrize("unless_right", [True, False])
def test_what_is_fitted_by_the_likelihood_itself_is_the_model_behind(
    monkeypatch: pytest.MonkeyPatch, unless_right: bool
) -> None:
    made, asked = SimpleNamespace(name="exact"), problem(COMPARED)
    none: Any = {}
    before = selection.Selection(
        effects={"drag": {"dqx": 1.0}}, rounds=(), alike=none, rivals=none, accounts=none,
        before=none, after=none, gain={"drag": 500.0}, searched={"drag": NOTHING}, patchwork=False,
    )  # fmt: skip

    told: list[Any] = []

    def exact(given: Problem, model: Any, **how: Any) -> Any:
        assert (given, model, how.pop("unless_right")) == (asked, before.after, unless_right)
        how.pop("told")(3, 7)
        return made

    def effects_of(model: Any, searched: Any) -> Any:
        assert (model, searched) == (made, before.searched)
        return {"drag": {"dqx": 2.0}}

    monkeypatch.setattr(selection, "by_prediction_error", exact)
    monkeypatch.setattr(selection, "effects_of", effects_of)
    found = selection.exactly(asked, before, lambda *seen: told.append(seen), unless_right=unless_right)
    assert told == [("constants", 3, 7)]
    assert (found.after, found.effects) == (made, {"drag": {"dqx": 2.0}})
    assert found == replace(before, after=made, effects=found.effects)
    made = before.after
    assert selection.exactly(asked, before, lambda *_: None, unless_right=unless_right) is before


def test_a_line_is_the_last_to_be_believed() -> None:
    """Of all effects, those that have no cause but a frequency."""
    assert {name for name in catalogue.names() if selection.RULES.last(name)} == {"interference", "base_vibration"}
    assert selection.RULES.last("interference:2")
