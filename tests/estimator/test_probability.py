"""How probable an account is: odds by hand, and what no likelihood may override."""

import math

import pytest

from estimator.trace.criterion import TIE
from estimator.trace.engine import Outcome, Round, Score, Tried
from estimator.trace.nameless import Contest
from estimator.trace.probability import (
    NOTHING,
    OTHER,
    Account,
    beside_nothing,
    classes,
    doubted,
    of_rounds,
    stated,
)

WHITE = Contest(named=900.0, nameless=0.0, both=900.0, samples=40_000)
SURE = Account(NOTHING, 900.0)


def of(*accounts, contest=WHITE, is_open=False):
    found = classes("sense_gain", accounts, contest, is_open=is_open)
    assert sum(found.probabilities.values()) == pytest.approx(1.0)
    assert list(found.probabilities.values()) == sorted(found.probabilities.values(), reverse=True)
    return found.probabilities


def test_two_kinds_stand_in_the_odds_of_their_likelihoods() -> None:
    found = of(Account("sense_gain", 0.0), Account("drive_gain", 2.0 * math.log(3.0)), SURE)
    assert found["sense_gain"] == pytest.approx(0.75)
    assert found["drive_gain"] == pytest.approx(0.25)


def test_what_is_less_sure_counts_as_much_less() -> None:
    found = of(Account("sense_gain", 0.0), Account("drive_gain", 10.0 * 2.0 * math.log(3.0), 10.0), SURE)
    assert found["drive_gain"] == pytest.approx(0.25)
    surer = of(Account("sense_gain", 0.0), Account("drive_gain", 2.0 * math.log(3.0), 0.1), SURE)
    assert surer["drive_gain"] == pytest.approx(0.25)  # never more sure than white noise


def test_nothing_is_as_likely_beforehand_as_all_kinds_together() -> None:
    kinds = [Account(f"effect_{number}", 0.0) for number in range(9)]
    found = of(*kinds, Account(NOTHING, 0.0))
    assert found[NOTHING] == pytest.approx(0.5)
    assert found["effect_3"] == pytest.approx(0.5 / 9.0)


def test_one_that_was_nearer_takes_the_larger_part() -> None:
    assert of(Account("sense_gain", 0.0), Account("drive_gain", -2.0 * math.log(3.0)), SURE)["drive_gain"] == (
        pytest.approx(0.75)
    )


def test_something_else_where_a_force_does_more_than_may_be_left() -> None:
    kinds = Account("sense_gain", 0.0), SURE
    may_be_left = -40_000 * math.log(0.98)
    just = Contest(named=900.0, nameless=-1e6, both=900.0 + may_be_left, samples=40_000)
    # as likely as the effect, and half as likely beforehand as an effect or nothing
    assert of(*kinds, contest=just)[OTHER] == pytest.approx(1.0 / 3.0)
    little = Contest(named=900.0, nameless=-1e6, both=960.0, samples=40_000)
    assert of(*kinds, contest=little)[OTHER] < 1e-9
    much = Contest(named=900.0, nameless=-1e6, both=9000.0, samples=40_000)
    assert of(*kinds, contest=much)[OTHER] > 1.0 - 1e-9
    unsure = Contest(named=900.0, nameless=-1e6, both=9000.0, samples=40_000, dispersions=(1.0, 1e6))
    assert of(*kinds, contest=unsure)[OTHER] < 1e-9  # a gain that is not sure is none
    same = Contest(named=900.0, nameless=-1e6, both=899.0, samples=40_000, dispersions=(1.0, 1e4))
    assert of(*kinds, contest=same)[OTHER] < 1e-9


def test_something_else_where_a_force_does_as_well_in_place_of_the_effect() -> None:
    even = Contest(named=900.0, nameless=900.0, both=900.0, samples=40_000)
    assert of(Account("sense_gain", 0.0), SURE, contest=even)[OTHER] == pytest.approx(1.0 / 3.0)
    ahead = Contest(named=900.0, nameless=900.0 - 2.0 * TIE, both=900.0, samples=40_000)
    assert of(Account("sense_gain", 0.0), SURE, contest=ahead)[OTHER] == pytest.approx(0.5 / (0.5 + 400.0), rel=1e-6)


@pytest.mark.parametrize(("dispersion", "times"), [(3.0, 3.0), (1.0, 1.0), (0.2, 1.0)])
def test_a_lead_counts_for_as_much_less_as_it_is_less_sure(dispersion: float, times: float) -> None:
    """And for no more where it is surer than white innovations make it: odds of 400 then, for either force."""
    instead = Contest(900.0, 900.0 - 2.0 * times * TIE, 900.0, 40_000, (dispersion, 1.0))
    said = of(Account("sense_gain", 0.0), SURE, contest=instead)[OTHER]
    assert said == pytest.approx(0.5 / (0.5 + 400.0), rel=1e-6)
    gained = times * (2.0 * TIE - 40_000 * math.log(0.98))
    beside = Contest(named=900.0, nameless=-1e6, both=900.0 + gained, samples=40_000, dispersions=(1.0, dispersion))
    said = of(Account("sense_gain", 0.0), SURE, contest=beside)[OTHER]
    assert said == pytest.approx(200.0 / 201.0, rel=1e-6)


def test_what_a_promise_speaks_against_is_something_else_at_odds_of_twenty() -> None:
    found = of(Account("sense_gain", 0.0), SURE, is_open=True)
    assert found[OTHER] == pytest.approx(20.0 / 21.0)


def test_what_has_no_say_stands_at_odds_of_twenty_at_best() -> None:
    (one, other) = doubted((Account("interference", -50.0), Account("drive_gain", 3.0)), {"interference"})
    assert (one.deficit, other.deficit) == (TIE, 3.0)
    assert one.weight == pytest.approx(1.0 / 20.0)
    (wide,) = doubted((Account("interference", -50.0, 4.0),), {"interference"})
    assert wide.weight == pytest.approx(1.0 / 20.0)
    (sharp,) = doubted((Account("interference", -50.0, 0.25),), {"interference"})
    assert sharp.deficit == TIE  # a lead is never worth more than of white innovations
    (far,) = doubted((Account("interference", 80.0),), {"interference"})
    assert far.deficit == 80.0


def test_where_nothing_is_named_nothing_is_what_all_are_compared_with() -> None:
    found = beside_nothing((Account("sense_gain", 0.0), Account("drive_gain", 40.0), Account(NOTHING, 12.0)))
    assert {one.name: one.deficit for one in found} == {"sense_gain": TIE, "drive_gain": 28.0, NOTHING: 0.0}
    said = classes(None, found, Contest(0.0, 5.0, 5.0, 40_000), is_open=False)
    assert said.effect is None
    assert said.probabilities[NOTHING] > 0.95


def test_without_a_contest_nothing_is_said_for_something_else() -> None:
    assert of(Account("sense_gain", 0.0), SURE, contest=None)[OTHER] == pytest.approx(0.0, abs=1e-12)
    lost = Contest(named=-math.inf, nameless=900.0, both=-math.inf, samples=40_000)
    assert of(Account("sense_gain", 0.0), SURE, contest=lost)[OTHER] > 0.999


def asked(taken, *tried):
    """A round in which these were carried, by gain and price, None without a model; the rest is only promised."""
    carried = tuple(
        Tried(name, Outcome.BEATEN, "", None if worth is None else Score(0.0, *worth, 0.0), {}) for name, worth in tried
    )
    return Round({"a": 7.0, "b": 5.0, "c": -2.0}, carried, taken)


def test_of_each_round_all_that_was_asked_is_accounted_for_by_who_was_taken() -> None:
    """Gains less prices where there is a model, else what is promised; a last round without any says nothing."""
    first = asked("a", ("a", (50.0, 8.0)), ("b", (31.0, 9.0)), ("d", None))
    rounds = [first, asked("c", ("c", (20.0, 1.0))), asked(None)]
    found = of_rounds(rounds, lambda look: look)
    assert set(found) == {"a", "c"}
    assert {one.name: one.deficit for one in found["a"]} == {NOTHING: 42.0, "a": 0.0, "b": 20.0, "c": 44.0}
    assert {one.name: one.deficit for one in found["c"]} == {NOTHING: 19.0, "a": 12.0, "b": 14.0, "c": 0.0}


def test_where_nobody_was_taken_the_first_round_is_accounted_for_beside_nothing() -> None:
    found = of_rounds([asked(None, ("b", (31.0, 9.0))), asked(None, ("c", (99.0, 1.0)))], lambda look: look)
    assert {one.name: one.deficit for one in found[None]} == {NOTHING: 0.0, "a": -7.0, "b": -22.0, "c": 2.0}


def test_an_account_is_as_sure_as_white_innovations_unless_it_is_said_otherwise() -> None:
    assert (Account("a", 1.0).dispersion, Account("a", 1.0).name) == (1.0, "a")


def test_an_account_far_ahead_or_behind_has_a_finite_weight() -> None:
    assert Account("a", -1e9).weight == math.exp(300.0)
    assert Account("a", 1e9).weight == 0.0
    assert Account("a", 4.0, 0.5).weight == pytest.approx(math.exp(-2.0))


def test_a_part_named_out_of_several_is_told_by_what_it_is_called() -> None:
    accounts = {"drive_gain:1": (Account("drive_gain", 0.0), SURE), "other": (SURE,)}
    (told,) = stated(accounts, {"drive_gain:1": "drive_gain", "gone": "gone"}, {"drive_gain"}, None, is_open=True)
    assert told.effect == "drive_gain"
    assert told.probabilities[OTHER] == pytest.approx(20.0 / 21.0)
    doubtful = Account("drive_gain", -90.0), Account("drag", 0.0), SURE
    (said,) = stated({"drag": doubtful}, {"drag": "drag"}, {"drive_gain"}, None, is_open=False)
    assert said.probabilities["drag"] == pytest.approx(20.0 / 21.0)  # behind by odds of twenty, at least


def test_a_force_in_place_of_nothing_named_is_only_asked_for_what_it_does_beside_it() -> None:
    """Where nothing is named, in place of it and beside it are one question and counted once."""
    may_be_left = -40_000 * math.log(0.98)
    just = Contest(named=0.0, nameless=may_be_left, both=may_be_left, samples=40_000)
    assert of(SURE, Account("sense_gain", 0.0), contest=just)[OTHER] == pytest.approx(1.0 / 3.0)
    even = 1.0 + may_be_left  # in place of a name it does as well as both, and beside it as much as may be left
    twice = Contest(named=1.0, nameless=even, both=even, samples=40_000)
    assert of(SURE, Account("sense_gain", 0.0), contest=twice)[OTHER] == pytest.approx(0.5)
