"""The choice of effects, on stub models whose every gain and price is written down here."""

import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import pytest

from evaluation.measured.criterion import TIE
from evaluation.measured.engine import (
    OUTWEIGHED,
    Dissent,
    Estimate,
    Outcome,
    Rules,
    Score,
    Step,
    Trial,
    Tried,
    _near,
    as_near,
    choose,
    last_carried,
    leader,
    leaves_the_rest,
    tried_reason,
    unphysical,
    why_not,
)


@dataclass(frozen=True)
class Worth:
    """What a stub effect gains, what it costs, its coefficient, and what stands against it."""

    gain: float
    price: float = 1.0
    low: float = 1.0
    high: float = 2.0
    positive: bool = True
    objected: bool = False
    impossible: bool = False


@dataclass
class Stub:
    """A model is the tuple of what it carries; its likelihood is the sum of the gains."""

    effects: dict[str, Worth]
    width: int = 99
    asked: list[tuple[str, ...]] = field(default_factory=list)
    later: list[str] = field(default_factory=list)

    def likelihood(self, carried):
        return sum(self.effects[name].gain for name in carried)

    def promise(self, current, barred):
        return tuple(name for name in self.effects if name not in current and name not in barred)

    def hopeful(self, look, tried, refused, number):
        return look[: self.width]

    def fit(self, current, look, names, tried):
        self.asked.append(tuple(names))
        return {n: "no run with it" if self.effects[n].impossible else (*current, n) for n in names}

    def score(self, current, look, fits):
        return {name: self._score(fit, current, name) for name, fit in fits.items()}

    def _score(self, more, less, name):
        price = self.effects[name].price
        return Score(self.likelihood(more), self.likelihood(more) - self.likelihood(less), price, price)

    def coefficients(self, fit):
        worths = {name: self.effects[name] for name in fit}
        return {n: {f"{n}_c": Estimate(0.5 * (w.low + w.high), w.low, w.high, w.positive)} for n, w in worths.items()}

    def objection(self, current, name, trial):
        self.later.append(name)
        return "the rest is predicted worse" if self.effects[name].objected else None

    def without(self, current, name):
        less = tuple(other for other in current if other != name)
        return less, self._score(current, less, name)

    def settled(self, current, names, newest):
        return current


def rules(dissent=Dissent.ENDS, most=6, **more):
    return Rules(most, dissent, **more)


def chosen(effects, how=None, width=99, start=()):
    return choose(Stub(effects, width), start, how or rules())


def names(found):
    return [step.name for step in found.steps]


def outcomes(one):
    return {each.name: each.outcome for each in one.tried}


def test_where_the_one_with_the_right_sign_is_objected_to_the_best_is_asked_after_it():
    effects = {
        "drag": Worth(500.0, low=-2.0, high=-1.0),
        "friction": Worth(499.0, objected=True),
        "delay": Worth(300.0),
    }
    stub = Stub(effects)
    assert names(choose(stub, (), rules(Dissent.NEXT, most=1, signs=False))) == ["drag"]
    assert stub.later == ["friction", "drag"]


@pytest.mark.parametrize(
    ("behind", "first"),
    [(0.9 * TIE, "friction"), (1.1 * TIE, "drag")],  # no further than the record cannot tell
)
def test_of_two_that_are_not_told_apart_the_one_is_taken_whose_sign_is_right(behind, first):
    wrong = {"drag": Worth(500.0, low=-2.0, high=-1.0), "other": Worth(500.0 - 0.1 * TIE, low=-2.0, high=-1.0)}
    effects = {**wrong, "friction": Worth(500.0 - behind, low=1.0, high=2.0)}
    found = chosen(effects, rules(most=1, signs=False))
    assert names(found) == [first]
    # Either sign, where it may be either; a price counts as a gain does.
    assert names(chosen(effects | {"drag": Worth(500.0, positive=False)}, rules(most=1, signs=False))) == ["drag"]
    dear = {"friction": Worth(500.0 + behind, price=1.0 + 2.0 * behind)}
    assert names(chosen(effects | dear, rules(most=1, signs=False))) == [first]


def fallen_back(best, trials):
    """What is called `x_lag` is `x`, where both were carried."""
    simpler = best.removesuffix("_lag")
    return simpler if simpler != best and simpler in trials else None


def test_the_simpler_one_is_taken_where_the_best_is_not_told_from_it():
    effects = {"x_lag": Worth(500.0), "x": Worth(498.0), "y": Worth(499.0)}
    found = chosen(effects, rules(most=1, simpler=fallen_back))
    assert outcomes(found.rounds[0]) == {"x_lag": Outcome.NESTED, "x": Outcome.TAKEN, "y": Outcome.BEATEN}
    assert found.gains == {"x": 498.0}
    why = {one.name: tried_reason(one, "x") for one in found.rounds[0].tried}
    assert "the record does not tell it from x, which is simpler" in why["x_lag"]
    assert "x explains more for its price" in why["y"]
    # Without the rule, or without the simpler one, or where another is the best, nothing changes.
    assert names(chosen(effects, rules(most=1))) == ["x_lag"]
    assert names(chosen({"x_lag": Worth(500.0), "y": Worth(499.0)}, rules(most=1, simpler=fallen_back))) == ["x_lag"]
    assert names(chosen({**effects, "y": Worth(501.0)}, rules(most=1, simpler=fallen_back))) == ["y"]


@pytest.mark.parametrize(
    ("simpler", "dissent", "taken"),
    [
        (Worth(498.0, price=600.0), Dissent.ENDS, ["x_lag"]),  # not worth its price
        (Worth(498.0, objected=True), Dissent.ENDS, []),
        (Worth(498.0, objected=True), Dissent.NEXT, ["x_lag"]),
        (Worth(498.0, objected=True), Dissent.AGAIN, ["x_lag"]),
    ],
)
def test_a_simpler_one_that_may_not_be_taken_makes_way(simpler, dissent, taken):
    found = chosen({"x_lag": Worth(500.0), "x": simpler}, rules(dissent, most=1, simpler=fallen_back))
    assert names(found) == taken


@pytest.mark.parametrize("dissent", Dissent)
def test_the_best_is_the_largest_likelihood_less_its_price(dissent):
    effects = {"much": Worth(50.0, price=30.0), "cheap": Worth(45.0, price=5.0), "little": Worth(20.0, price=1.0)}
    found = chosen(effects, rules(dissent, most=1))
    assert names(found) == ["cheap"]
    assert outcomes(found.rounds[0]) == {
        "much": Outcome.BEATEN,
        "cheap": Outcome.TAKEN,
        "little": Outcome.BEATEN,
    }
    assert found.gains == {"cheap": 45.0}


@pytest.mark.parametrize("dissent", Dissent)
def test_it_goes_on_until_nothing_outweighs_its_price(dissent):
    effects = {"a": Worth(40.0), "b": Worth(9.0), "equal": Worth(3.0, price=3.0), "dear": Worth(8.0, price=8.5)}
    found = chosen(effects, rules(dissent))
    assert names(found) == ["a", "b"]
    assert found.rounds[-1].taken is None
    assert outcomes(found.rounds[-1]) == {"equal": Outcome.TOO_DEAR, "dear": Outcome.TOO_DEAR}
    assert found.rounds[-1].tried[1].reason == "gains 8.00, and 8.50 would be needed"


def test_what_is_needed_may_differ_from_the_price_that_ranks():
    class Chance(Stub):
        def score(self, current, look, fits):
            return {n: Score(self.effects[n].gain, self.effects[n].gain, 1.0, 10.0) for n in fits}

    found = choose(Chance({"a": Worth(9.0), "b": Worth(8.0)}), (), rules())
    assert names(found) == []
    assert names(choose(Chance({"a": Worth(11.0)}), (), rules())) == ["a"]


@pytest.mark.parametrize("most", [1, 2, 3])
@pytest.mark.parametrize("dissent", Dissent)
def test_no_more_than_so_many_are_taken(most, dissent):
    effects = {name: Worth(gain) for name, gain in zip("abcd", (40.0, 30.0, 20.0, 10.0), strict=True)}
    found = chosen(effects, rules(dissent, most))
    assert names(found) == list("abcd")[:most]
    assert found.fit == tuple("abcd"[:most])
    assert found.more
    assert found.rounds[-1].tried == ()
    assert found.rounds[-1].look == tuple("abcd"[most:])
    assert not chosen(dict(list(effects.items())[:most]), rules(dissent, most)).more


def test_what_the_start_carries_counts_for_nothing():
    effects = {"known": Worth(99.0), "a": Worth(40.0), "b": Worth(30.0), "c": Worth(20.0)}
    found = chosen(effects, rules(most=2), start=("known",))
    assert names(found) == ["a", "b"]
    assert found.gains == {"a": 40.0, "b": 30.0}
    assert found.fit == ("known", "a", "b")


OBJECTED = {"a": Worth(40.0), "b": Worth(30.0, objected=True), "c": Worth(20.0), "d": Worth(10.0)}


@pytest.mark.parametrize(
    ("dissent", "expected"),
    [
        (Dissent.ENDS, ["a"]),
        (Dissent.NEXT, ["a", "c", "d"]),
        (Dissent.AGAIN, ["a", "c", "d"]),
        (Dissent.CUTS, ["a"]),
    ],
)
def test_what_the_later_part_does_not_bear_out_is_not_taken(dissent, expected):
    found = chosen(OBJECTED, rules(dissent))
    assert names(found) == expected
    assert found.fit == tuple(expected)
    objected = found.rounds[1]
    assert outcomes(objected)["b"] is Outcome.OBJECTED
    assert next(one.reason for one in objected.tried if one.name == "b") == "the rest is predicted worse"
    assert ("b" in found.barred) is (dissent in (Dissent.NEXT, Dissent.AGAIN))


def test_next_asks_the_same_round_and_again_makes_a_new_one():
    asked = {}
    for dissent in (Dissent.NEXT, Dissent.AGAIN):
        stub = Stub(OBJECTED)
        choose(stub, (), rules(dissent))
        asked[dissent] = stub.asked
    assert asked[Dissent.NEXT] == [("a", "b", "c", "d"), ("b", "c", "d"), ("d",)]
    assert asked[Dissent.AGAIN] == [("a", "b", "c", "d"), ("b", "c", "d"), ("c", "d"), ("d",)]


def test_next_passes_over_what_is_too_dear_for_a_worse_one_that_is_not():
    class Bars(Stub):
        def score(self, current, look, fits):
            return {n: Score(self.effects[n].gain, self.effects[n].gain, 0.0, self.effects[n].price) for n in fits}

    effects = {"dear": Worth(30.0, price=31.0), "fair": Worth(20.0, price=10.0)}
    assert names(choose(Bars(effects), (), rules(Dissent.NEXT))) == ["fair"]
    assert names(choose(Bars(effects), (), rules(Dissent.ENDS))) == []


def test_a_way_that_is_cut_says_of_those_behind_that_they_follow():
    found = chosen(OBJECTED, rules(Dissent.CUTS))
    assert [one.taken for one in found.rounds] == ["a", None, None, None, None]
    assert outcomes(found.rounds[2])["c"] is Outcome.AFTER
    assert "follows b, which the rest is predicted worse" in {one.reason for one in found.rounds[2].tried}
    assert found.gains == {"a": 40.0}
    first = chosen(OBJECTED | {"a": Worth(40.0, objected=True)}, rules(Dissent.CUTS))
    assert [one.taken for one in first.rounds] == [None] * 5
    assert outcomes(first.rounds[0])["a"] is Outcome.OBJECTED
    behind = [outcomes(one)[name] for one, name in zip(first.rounds[1:], "bcd", strict=False)]
    assert behind == [Outcome.AFTER] * 3
    assert (names(first), first.fit) == ([], ())


def test_the_later_part_is_not_asked_of_what_is_too_dear():
    stub = Stub({"a": Worth(0.5)})
    choose(stub, (), rules())
    assert stub.later == []


def test_of_equals_the_simpler():
    for order in (("simple", "rich"), ("rich", "simple")):
        worth = {"simple": Worth(10.0, price=2.0), "rich": Worth(14.0, price=6.0)}
        found = chosen({name: worth[name] for name in order}, rules(most=1))
        assert names(found) == ["simple"]
    effects = {"rich": Worth(10.0, price=6.0), "simple": Worth(10.0, price=2.0)}
    assert names(chosen(effects, rules(most=1))) == ["simple"]


class Overlap(Stub):
    """double is nearly nothing beside the two it stood for; `more` adds to whatever there is."""

    TOGETHER: ClassVar = {
        "": 0.0,
        "double": 50.0,
        "truth": 45.0,
        "other": 25.0,
        "double other": 55.0,
        "double truth": 60.0,
    }

    def likelihood(self, carried):
        known = " ".join(sorted(set(carried) - {"more"}))
        return self.TOGETHER.get(known, 90.5 if "double" in carried else 90.0) + (4.0 if "more" in carried else 0.0)


class Drawn(Stub):
    """Alone, `force` draws some of what `cubic` would explain and is ahead of `reading`, the truth, by `ahead`; beside
    `cubic` it is behind by `behind`.
    """

    ahead, behind = 10.0, 40.0

    def likelihood(self, carried):
        cubic = "cubic" in carried
        lines = {"force": 1000.0 - self.behind if cubic else 1000.0 + self.ahead, "reading": 1000.0, "far": 800.0}
        return max((lines[name] for name in carried if name in lines), default=0.0) + 100.0 * cubic


DRAWN = {"force": Worth(0.0), "reading": Worth(0.0), "far": Worth(0.0), "cubic": Worth(0.0)}


def drawn(near=0.9, worths=None, simpler=None, **more):
    family = Drawn(DRAWN | (worths or {}))
    for name, value in more.items():
        setattr(family, name, value)
    how = rules(most=2, near=near, signs=False, **({} if simpler is None else {"simpler": simpler}))
    return family, choose(family, (), how, reducible=family)


def test_what_is_simpler_and_not_told_apart_keeps_its_place():
    def simpler(best, trials):
        return "force" if best == "reading" and "force" in trials else None

    _, found = drawn(simpler=simpler)
    assert names(found) == ["force", "cubic"]


def test_one_that_came_near_is_asked_again_beside_what_was_taken_since():
    family, found = drawn()
    assert names(found) == ["cubic", "reading"]  # in the order in which they stand now
    assert found.fit == ("cubic", "reading")
    assert found.gains == {"cubic": 1060.0 - 1010.0, "reading": 1000.0}
    assert [one.taken for one in found.rounds] == ["reading", "cubic", None]
    assert outcomes(found.rounds[0])["force"] is Outcome.BEATEN
    assert outcomes(found.rounds[0])["reading"] is Outcome.TAKEN
    last = found.steps[-1]
    assert last.before == ("cubic",)
    assert set(last.beside) == {"force"}
    assert last.beside["force"].fit == ("force", "cubic")
    assert last.beside["force"].score.gain == 1060.0 - 100.0
    assert ("far",) not in family.asked  # too far behind then
    assert "reading" in family.later  # the part without a vote was heard


def test_the_rounds_that_follow_an_exchange_stay_as_they_were():
    """Only beside two others `reading` is the better account: a round later than above."""

    class Later(Drawn):
        def likelihood(self, carried):
            late = {"cubic", "last"} <= set(carried)
            lines = {"force": 960.0 if late else 1010.0, "reading": 1000.0}
            line = max((lines[name] for name in carried if name in lines), default=0.0)
            return line + 100.0 * ("cubic" in carried) + 70.0 * ("last" in carried)

    family = Later({"force": Worth(0.0), "reading": Worth(0.0), "cubic": Worth(0.0), "last": Worth(0.0)})
    found = choose(family, (), rules(most=3, near=0.9, signs=False), reducible=family)
    assert names(found) == ["cubic", "last", "reading"]
    assert [one.taken for one in found.rounds] == ["reading", "cubic", "last", None]
    assert found.fit == ("cubic", "last", "reading")


@pytest.mark.parametrize(("behind", "kept"), [(7.0, ["cubic", "reading"]), (6.0, ["force", "cubic"])])
def test_what_is_better_by_no_more_than_a_tie_takes_no_place(
    monkeypatch: pytest.MonkeyPatch, behind: float, kept: list[str]
) -> None:
    monkeypatch.setattr("evaluation.measured.engine.TIE", 6.0)
    assert names(drawn(behind=behind)[1]) == kept


def test_nobody_is_asked_again_where_the_rules_do_not_say_so():
    family, found = drawn(near=None)
    assert names(found) == ["force", "cubic"]
    assert names(choose(family, (), rules(most=2, near=0.9, signs=False))) == [
        "force",
        "cubic",
    ]  # a family that loses nothing


@pytest.mark.parametrize(("behind", "taken"), [(0.9 * TIE, ["force", "cubic"]), (1.1 * TIE, ["cubic", "reading"])])
def test_an_exchange_has_to_be_told_apart(behind, taken):
    assert names(drawn(behind=behind)[1]) == taken


def test_no_exchange_for_one_that_the_rest_objects_to_or_that_costs_what_it_gains():
    assert names(drawn(worths={"reading": Worth(0.0, objected=True)})[1])[0] == "force"
    assert names(drawn(worths={"reading": Worth(0.0, price=45.0)})[1]) == ["force", "cubic"]
    assert names(drawn(worths={"reading": Worth(0.0, impossible=True)})[1]) == ["force", "cubic"]


def test_beside_one_that_took_a_place_the_others_are_asked_again():
    """A drag is worth something beside a line and nothing beside the coupling, which comes after a spring."""

    class Stand(Stub):
        TOGETHER: ClassVar = {
            "": 0.0,
            "drag": 100.0,
            "line": 90.0,
            "coupling": 80.0,
            "spring": 70.0,
            "drag line": 150.0,
            "coupling drag": 149.0,
            "drag spring": 120.0,
            "drag line spring": 190.0,
            "coupling drag line": 160.0,
            "line spring": 180.0,
            "coupling drag spring": 300.0,
            "coupling spring": 300.0,
            "coupling line spring": 300.0,
        }

        def likelihood(self, carried):
            return self.TOGETHER[" ".join(sorted(carried))]

    family = Stand({name: Worth(0.0) for name in ("drag", "line", "coupling", "spring")})
    found = choose(family, (), rules(most=3, near=0.9), reducible=family)
    assert names(found) == ["spring", "coupling"]
    assert found.barred == {"drag": "superfluous beside coupling"}
    assert [one.taken for one in found.rounds] == [None, "coupling", "spring", None]


def test_what_has_become_superfluous_leaves_its_place_while_effects_are_chosen():
    """As many as may be are two: the third of these had to be kept out, and the first with it."""
    effects = {"double": Worth(0.0), "truth": Worth(0.0), "other": Worth(0.0)}
    family = Overlap(effects)
    family.TOGETHER = Overlap.TOGETHER | {"double other": 59.0, "other truth": 89.8, "double truth": 60.0}
    found = choose(family, (), rules(most=3), reducible=family)
    assert names(found) == ["truth", "other"]
    assert found.fit == ("truth", "other")
    assert found.barred == {"double": "superfluous beside other"}
    assert [one.taken for one in found.rounds] == [None, "truth", "other", None]
    assert outcomes(found.rounds[0])["double"] is Outcome.SUPERFLUOUS
    assert not found.more
    kept = choose(family, (), rules(most=3))
    assert names(kept) == ["double", "truth", "other"]


@pytest.mark.parametrize(("gone", "stays"), [("first", "second"), ("second", "first")])
def test_whoever_leaves_its_place_is_told_beside_whom(gone, stays):
    """Beside the one that was taken last, which stands for it."""

    class Third(Stub):
        def likelihood(self, carried):
            known = {"first": 50.0, "second": 40.0, "third": 51.0}
            return sum(known[name] for name in carried if name != gone or "third" not in carried)

        def promise(self, current, barred):  # the third is not seen before the others are carried
            look = super().promise(current, barred)
            return look if {"first", "second"} <= {*current, *barred} else tuple(n for n in look if n != "third")

    family = Third({"first": Worth(0.0), "second": Worth(0.0), "third": Worth(0.0, price=0.5)})
    found = choose(family, (), rules(most=5), reducible=family)
    assert names(found) == [stays, "third"]
    assert found.barred == {gone: "superfluous beside third"}


@pytest.mark.parametrize("dissent", Dissent)
def test_a_wrong_sign_beyond_doubt_bars_a_candidate_where_signs_are_asked_for(dissent):
    effects = {"drives": Worth(50.0, low=-3.0, high=-0.1), "unsure": Worth(20.0, low=-3.0, high=0.1)}
    found = chosen(effects, rules(dissent))
    assert names(found) == ["unsure"]
    assert found.barred == {"drives": "fits only with a negative drives_c, which would be something else"}
    assert outcomes(found.rounds[0])["drives"] is Outcome.UNPHYSICAL
    assert names(chosen(effects, rules(dissent, signs=False))) == ["drives", "unsure"]
    assert names(chosen({"drives": Worth(50.0, low=-3.0, high=-0.1, positive=False)}, rules(dissent))) == ["drives"]


def test_a_wrong_sign_may_be_asked_for_again_beside_what_was_taken():
    """Drag bends a ring-down one way and friction the other: alone it has the wrong sign, beside friction the right."""

    class Bent(Stub):
        def coefficients(self, fit):
            sign = 1.0 if "friction" in fit else -1.0
            known = {"drag": Estimate(sign, sign - 0.5, sign + 0.5, True), "friction": Estimate(1.0, 0.5, 1.5, True)}
            return {name: {f"{name}_c": known[name]} for name in fit}

    effects = {"drag": Worth(50.0), "friction": Worth(50.0 * OUTWEIGHED)}
    assert names(choose(Bent(effects), (), rules())) == ["friction"]
    found = choose(Bent(effects), (), rules(anew=True))
    assert names(found) == ["friction", "drag"]
    assert found.barred == {}
    assert outcomes(found.rounds[0])["drag"] is Outcome.UNPHYSICAL
    # Far ahead of all that have the right sign, it is what shows most; beside what is missing its sign is right.
    effects["friction"] = Worth(math.nextafter(effects["friction"].gain, 0.0))
    assert names(choose(Bent(effects), (), rules())) == ["friction"]
    found = choose(Bent(effects), (), rules(anew=True))
    assert names(found) == ["drag", "friction"]
    assert outcomes(found.rounds[0]) == {"drag": Outcome.TAKEN, "friction": Outcome.BEATEN}
    alone = choose(Bent({"drag": Worth(50.0)}), (), rules(anew=True))
    assert names(alone) == ["drag"]


def test_of_those_of_a_wrong_sign_the_likeliest_is_taken_and_held_to_the_rest_of_the_record():
    wrong = {"low": -2.0, "high": -1.0}
    effects = {"dear": Worth(90.0, price=45.0, **wrong), "drag": Worth(80.0, **wrong), "small": Worth(20.0)}
    assert names(chosen(effects, rules(most=1, anew=True))) == ["drag"]
    objected = effects | {"drag": Worth(80.0, objected=True, **wrong)}
    assert names(chosen(objected, rules(most=1, anew=True))) == []


def test_what_was_taken_settles_beside_each_that_follows():
    """`settled` is asked of the model with the newest, about all that were taken before it and the newest, and what it
    answers is carried on.
    """

    class Settling(Stub):
        def __init__(self, effects):
            super().__init__(effects)
            self.settles = []

        def settled(self, current, names, newest):
            self.settles.append((current, tuple(names), newest))
            return (*current, "better")

        def likelihood(self, carried):
            return super().likelihood([name for name in carried if name != "better"]) + 5.0 * ("better" in carried)

        def coefficients(self, fit):
            return super().coefficients([name for name in fit if name != "better"])

    family = Settling({"limit": Worth(50.0), "coupling": Worth(30.0), "third": Worth(20.0)})
    found = choose(family, (), rules(most=3), reducible=family)
    assert family.settles == [
        (("limit",), (), "limit"),
        (("limit", "better", "coupling"), ("limit",), "coupling"),
        (("limit", "better", "coupling", "better", "third"), ("limit", "coupling"), "third"),
    ]
    assert [step.trial.fit for step in found.steps] == [
        ("limit", "better"),
        ("limit", "better", "coupling", "better"),
        ("limit", "better", "coupling", "better", "third", "better"),
    ]
    assert found.fit == found.steps[-1].trial.fit
    family.settles.clear()
    choose(family, (), rules(most=3))
    assert family.settles == []


def test_the_sign_is_asked_of_all_that_a_model_carries():
    right, wrong = Estimate(1.0, 0.5, 1.5, True), Estimate(-1.0, -1.5, -0.5, True)
    assert unphysical({"old": {"fx": wrong}, "new": {"k3x": right}}) == "a negative fx"
    assert unphysical({"old": {"fx": right}, "new": {"k3x": right}}) is None


@pytest.mark.parametrize(("size", "wrong"), [(0.019, None), (0.021, "a negative fy")])
def test_a_trifle_of_the_wrong_sign_is_chance_on_an_axis_that_has_none(size, wrong):
    """Two hundredths of the coefficient of the other axis; not of one whose sign is free."""
    fy = Estimate(-5.0 * size, -6.0 * size, -4.0 * size, True)
    assert unphysical({"friction": {"fx": Estimate(5.0, 4.0, 6.0, True), "fy": fy}}) == wrong
    assert unphysical({"friction": {"fx": Estimate(5.0, 4.0, 6.0), "fy": fy}}) == "a negative fy"


def test_who_has_no_model_is_barred_with_its_reason():
    found = chosen({"a": Worth(50.0, impossible=True), "b": Worth(20.0)})
    assert names(found) == ["b"]
    assert found.barred == {"a": "no run with it"}
    (lost, _) = found.rounds[0].tried
    assert (lost.outcome, lost.score, lost.coefficients) == (Outcome.IMPOSSIBLE, None, {})


def test_every_candidate_that_was_carried_has_its_gain_price_and_interval():
    (first, *_) = chosen({"a": Worth(50.0, price=3.0, low=4.0, high=8.0), "b": Worth(20.0)}).rounds
    assert {one.name: (one.score.gain, one.score.price, one.score.bar) for one in first.tried if one.score} == {
        "a": (50.0, 3.0, 3.0),
        "b": (20.0, 1.0, 1.0),
    }
    assert first.tried[0].coefficients == {"a_c": Estimate(6.0, 4.0, 8.0, True)}


def test_who_is_carried_follows_from_what_was_carried_until_nobody_is_added():
    class Wider(Stub):
        def hopeful(self, look, tried, refused, number):
            return look[:1] if not tried else look[:2] if number == 0 and tried[leader(tried)].score.gain < 15 else ()

    stub = Wider({"a": Worth(10.0), "b": Worth(20.0), "c": Worth(30.0)})
    found = choose(stub, (), rules(most=2))
    assert stub.asked == [("a",), ("b",), ("a",)]
    assert names(found) == ["b", "a"]


def test_a_family_is_told_who_was_refused():
    class Wider(Stub):
        def hopeful(self, look, tried, refused, number):
            return look[:3] if not tried else look[3:4] if {"b", "c"} == refused else ()

    stub = Wider({"a": Worth(9.0), "b": Worth(9.0, impossible=True), "c": Worth(9.0, low=-2, high=-1), "d": Worth(8.0)})
    choose(stub, (), rules(most=1))
    assert stub.asked == [("a", "b", "c"), ("d",)]


def test_progress_never_passes_its_end():
    said = []
    choose(Stub({"a": Worth(9.0), "b": Worth(0.5)}), (), rules(most=2), lambda done, most: said.append((done, most)))
    assert said == [(0, 2), (1, 2), (2, 2)]


@pytest.mark.parametrize("outcome", [Outcome.TOO_DEAR, Outcome.BEATEN, Outcome.OBJECTED])
def test_who_was_carried_and_not_taken_is_told_with_its_gain(outcome):
    tried = Tried("drag", outcome, "the rest objects", Score(0.0, 45_123.4, 3.0, 20.0), {})
    said = tried_reason(tried, "cubic_damping")
    assert "carried, it gains 45\u202f100 in twice the log-likelihood" in said
    assert ("the rest objects" in said) is (outcome is Outcome.OBJECTED)
    assert ("cubic damping explains more" in said) is (outcome is Outcome.BEATEN)
    assert leaves_the_rest(45_123.4).startswith("carried, it gains 45\u202f100")


def test_why_somebody_was_not_taken_is_told_by_the_last_round_that_carried_it_and_took_another():
    effects = {"a": Worth(60.0), "b": Worth(40.0), "c": Worth(20.0), "d": Worth(0.5)}
    rounds = choose(Stub(effects), (), rules(most=2)).rounds  # a, then b
    tried, taken = last_carried(rounds, "c".__eq__)
    assert (tried.name, tried.outcome, taken) == ("c", Outcome.BEATEN, "b")
    tried, taken = last_carried(rounds, "b".__eq__)
    assert (tried.outcome, taken) == (Outcome.BEATEN, "a")  # not of the round that took it
    assert last_carried(rounds, "a".__eq__) is None
    assert last_carried(rounds, "e".__eq__) is None
    assert why_not(rounds, "c".__eq__).startswith("carried, it gains 20")
    assert why_not(rounds, "c".__eq__).endswith("b explains more for its price")
    assert why_not(rounds, "d".__eq__).endswith("no more than chance")
    assert why_not(rounds, "e".__eq__) is None


def test_gains_of_a_round_are_of_those_that_have_a_model():
    effects = {"a": Worth(9.0), "b": Worth(5.0), "c": Worth(7.0, impossible=True)}
    first = chosen(effects).rounds[0]
    assert first.gains == {"a": 9.0, "b": 5.0}
    assert {one.name for one in first.tried} == {"a", "b", "c"}


def test_a_step_keeps_the_others_of_its_round_and_the_model_before():
    effects = {"a": Worth(9.0), "b": Worth(5.0)}
    first, second = chosen(effects).steps
    assert (first.name, first.before, first.trial.fit) == ("a", (), ("a",))
    assert {name: trial.fit for name, trial in first.beside.items()} == {"b": ("b",)}
    assert (second.name, second.before, second.beside) == ("b", ("a",), {})


def test_who_comes_as_near_as_the_one_taken_is_not_told_from_it_unless_the_rest_objects():
    effects = {
        "a": Worth(90.0),
        "near": Worth(90.0 - 0.9 * TIE),
        "dear": Worth(90.0, price=1.0 + 1.1 * TIE),
        "far": Worth(90.0 - 1.001 * TIE),
        "unasked": Worth(90.0 - 0.5 * TIE, objected=True),
        "none": Worth(90.0, impossible=True),
        "later": Worth(30.0),
    }
    found = choose(Stub(effects), (), rules(Dissent.NEXT, most=1))
    assert names(found) == ["a"]
    assert as_near(found.rounds) == {"a": {"near", "unasked"}}  # behind one that is taken, the rest says nothing
    leads = effects | {"unasked": Worth(95.0, objected=True)}
    assert as_near(choose(Stub(leads), (), rules(Dissent.NEXT, most=1)).rounds) == {"a": {"near"}}


def test_one_that_ties_by_as_much_as_tells_two_apart_is_told_apart():
    """It stays behind, though the sign of the best is wrong."""
    wrong = {"positive": True, "low": -2.0, "high": -1.0}
    for behind, first in ((TIE, "a"), (TIE - 1e-9, "b")):
        effects = {"a": Worth(50.0, **wrong), "b": Worth(50.0 - behind)}
        assert names(chosen(effects, Rules(1, Dissent.ENDS, signs=False)))[0] == first


def test_a_tie_is_odds_of_twenty_to_one() -> None:
    """Beyond that one account is told from another (`criterion.odds`)."""
    assert math.exp(TIE / 2.0) == pytest.approx(20.0)


def test_negative_beyond_doubt_is_below_zero_and_no_trifle() -> None:
    """A fiftieth of the largest that is there is one."""

    def wrong(value: float, high: float, other: float = 0.0, low: float = 0.5) -> str | None:
        own = Estimate(value, -9.0, high, positive=True)
        return unphysical({"drag": {"dqx": own, "dqy": Estimate(other, low, 9.0, positive=True)}})

    assert wrong(-1.0, 0.0) is None
    assert wrong(-1.0, -1e-300) == "a negative dqx"
    assert wrong(-0.02, -0.01, other=1.0) is None
    assert wrong(-math.nextafter(0.02, 1.0), -0.01, other=1.0) == "a negative dqx"
    assert wrong(-0.02, -0.01, other=1.0, low=0.0) == "a negative dqx"  # what may be nothing makes nothing small
    unsigned = Estimate(-1.0, -2.0, -0.5)
    assert unphysical({"drag": {"dqx": unsigned}}) is None


def test_a_drive_that_pushes_less_than_nothing_is_none_but_for_one_the_other_way_round() -> None:
    """An observer that has lost the motion turns its drive off; nobody's drive is."""

    def wrong(value: float, high: float, *, gain: bool = True) -> str | None:
        return unphysical({"drive_gain": {"hx": Estimate(value, -9.0, high, gain=gain)}})

    assert wrong(-1.01, -1.001) == "hx = -1.01, a gain of the other sign"
    assert wrong(-1.01, -1.0) is None
    assert wrong(-1.01, -1.001, gain=False) is None
    assert wrong(-2.0, -1.9) is None


def test_who_came_near_a_step_had_more_than_that_share_of_its_gain() -> None:
    """And is not carried, and has a model of the right signs."""

    class Family:
        def fit(self, less: str, look: str, names: list[str], tried: object) -> dict[str, str | tuple[str, float]]:
            assert (less, look, tried) == ("less", "look", {"taken": holder})
            return {name: "no model" if name == "impossible" else (name, 1.0) for name in names}

        def coefficients(self, fit: tuple[str, float]) -> dict[str, dict[str, Estimate]]:
            high = -1.0 if fit[0] == "wrong" else 1.0
            return {fit[0]: {"c": Estimate(-2.0, -3.0, high, positive=True)}}

        def score(self, less: str, look: str, fits: dict[str, tuple[str, float]]) -> dict[str, Score]:
            return {name: Score(1.0, 2.0, 3.0, 4.0) for name in fits}

    gains = {"bound": 90.0, "over": math.nextafter(90.0, 99.0), "carried": 95.0, "impossible": 95.0, "wrong": 95.0}
    beside = {name: Trial(name, Score(0.0, gain, 0.0, 0.0)) for name, gain in gains.items()}
    step: Any = Step("taken", Trial("fit", Score(0.0, 100.0, 0.0, 0.0)), "before", beside)
    family: Any = Family()
    holder: Any = Trial("fit", Score(0.0, 70.0, 0.0, 0.0))
    rules = Rules(3, Dissent.ENDS, near=0.9)
    found = _near(family, "less", "look", step, holder, {"carried"}, rules)
    assert found == {"over": Trial(("over", 1.0), Score(1.0, 2.0, 3.0, 4.0))}
    unsigned = replace(rules, signs=False)
    assert set(_near(family, "less", "look", step, holder, {"carried"}, unsigned)) == {"over", "wrong"}
    assert _near(family, "less", "look", step, holder, (), replace(rules, near=None)) == {}


def test_what_a_step_may_have_turned_into_is_asked_whatever_it_gained() -> None:
    """A saturation whose limit went to nothing is a drive of another gain, which may have had the wrong sign when the
    saturation was taken, or have gained too little.
    """

    class Family:
        def fit(self, less: str, look: str, names: list[str], tried: object) -> dict[str, tuple[str, ...]]:
            assert len(set(names)) == len(names)
            return {name: (name,) for name in names}

        def coefficients(self, fit: tuple[str, ...]) -> dict[str, dict[str, Estimate]]:
            return {}

        def score(self, less: str, look: str, fits: dict[str, tuple[str, ...]]) -> dict[str, Score]:
            return {name: Score(1.0, 2.0, 3.0, 4.0) for name in fits}

    def gain(name: str, look: str) -> str | None:
        assert (name, look) == ("saturation", "look")
        return "gain"

    family: Any = Family()
    rules = Rules(3, Dissent.ENDS, near=0.9, nested=gain)
    for gained, beside in ((None, {}), (1.0, {"gain": 1.0}), (95.0, {"gain": 95.0, "other": 95.0})):
        trials = {name: Trial(name, Score(0.0, own, 0.0, 0.0)) for name, own in beside.items()}
        step: Any = Step("saturation", Trial("fit", Score(0.0, 100.0, 0.0, 0.0)), "before", trials)
        asked = {"gain"} | ({"other"} if gained == 95.0 else set())
        assert set(_near(family, "less", "look", step, step.trial, (), rules)) == asked
        assert set(_near(family, "less", "look", step, step.trial, {"gain"}, rules)) == asked - {"gain"}
    nothing = replace(rules, nested=lambda name, look: None)
    assert _near(family, "less", "look", replace(step, beside={}), step.trial, (), nothing) == {}


def test_of_a_step_that_is_the_last_to_be_believed_whoever_gained_is_asked_again() -> None:
    class Family:
        def fit(self, less: str, look: str, names: list[str], tried: object) -> dict[str, tuple[str, ...]]:
            return {name: (name,) for name in names}

        def coefficients(self, fit: tuple[str, ...]) -> dict[str, dict[str, Estimate]]:
            return {}

        def score(self, less: str, look: str, fits: dict[str, tuple[str, ...]]) -> dict[str, Score]:
            return {name: Score(1.0, 2.0, 3.0, 4.0) for name in fits}

    gains = {"none": 0.0, "lost": -9.0, "little": 1e-9, "near": 95.0}
    beside = {name: Trial(name, Score(0.0, gain, 0.0, 0.0)) for name, gain in gains.items()}
    rules = Rules(3, Dissent.ENDS, near=0.9, last=lambda name: name == "line")
    family: Any = Family()
    for name, asked in (("line", {"little", "near"}), ("law", {"near"})):
        step: Any = Step(name, Trial("fit", Score(0.0, 100.0, 0.0, 0.0)), "before", beside)
        assert set(_near(family, "less", "look", step, step.trial, (), rules)) == asked


def test_a_coefficient_may_have_either_sign_and_is_a_size_unless_it_is_said_otherwise() -> None:
    assert Estimate(1.0, 0.0, 2.0) == Estimate(1.0, 0.0, 2.0, positive=False, shape=False)


def test_signs_count_and_nobody_is_tried_anew_or_asked_again_unless_the_rules_say_so() -> None:
    assert Rules(3, Dissent.ENDS) == Rules(3, Dissent.ENDS, signs=True, anew=False, near=None)
    assert not Rules(3, Dissent.ENDS).last("interference")
