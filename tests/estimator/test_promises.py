"""What "explained" promises (docs/reference/trace.md): a claim that holds, and each promise broken by itself."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import f

from estimator.thresholds import THRESHOLDS
from estimator.trace import promises
from estimator.trace.criterion import TIE
from estimator.trace.engine import Estimate
from estimator.trace.nameless import Contest
from estimator.trace.promises import Claim, Constant, Departure, Errors, Level, Vote
from estimator.trace.sidebands import Sidebands

SURE = Estimate(0.05, 0.04, 0.06)
HOLDS = Claim(
    residual=Errors(before=3.0, after=1.0, floor=1.0, samples=1e5, gain=900.0),
    effects={"drive_gain": {"hx": SURE, "hy": Estimate(0.001, -0.002, 0.004)}},
    constants=(Constant("dxx", 1.1, 1.0, 1.2, declared=1.0, deviation=0.5, positive=True),),
    levels=(Level("sense_clipping", -1.0, 1.0, lowest=-0.99, highest=1.002, noise=1e-3),),
    votes=(Vote("error of the angle", "rad", Errors(0.2, 0.01, 0.01, samples=1.0)),),
    departures={"drive_gain": Departure(0.5, 1e-3)},  # by chance
)


def guards_against(claim: Claim) -> set[str]:
    return {guard.__name__ for guard in promises.GUARDS if guard(claim)}


def test_what_holds_has_nothing_against_it() -> None:
    assert promises.broken(HOLDS) == ()
    assert promises.holds_in_part(HOLDS)


@pytest.mark.parametrize(
    ("guard", "part"),
    [
        ("fell", {"residual": Errors(3.0, 1.0, 1.0, 1e5, gain=-0.1)}),
        ("at_floor", {"residual": Errors(3.0, 1.11, 1.0, 1e5, gain=900.0)}),
        ("at_floor", {"residual": Errors(1.0324, 1.0303, 1.0, 1e6, 1e6, gain=60.0)}),
        ("signs", {"effects": {"dry_friction": {"fx": Estimate(-2.0, -3.0, -1.0, positive=True)}}}),
        ("signs", {"effects": {"drive_gain": {"hx": Estimate(-1.3, -1.4, -1.2, gain=True)}}}),
        ("signs", {"effects": {"sense_gain": {"gy": Estimate(-45.0, -46.0, -44.0, gain=True)}}}),
        ("beyond_zero", {"effects": {"dry_friction": {"fx": Estimate(0.5, -0.1, 1.1, positive=True)}}}),
        ("beyond_zero", {"effects": {"drag": {"dqx": Estimate(0.5, math.nan, math.nan)}}}),
        ("constants", {"constants": (Constant("kxx", 1.22, 1.21, 1.23, declared=1.0, deviation=0.05),)}),
        ("constants", {"constants": (Constant("kxx", 0.78, 0.77, 0.79, declared=1.0, deviation=0.05),)}),
        ("constants", {"constants": (Constant("dxx", -0.9, -1.0, -0.8, declared=0.9, deviation=0.6, positive=True),)}),
        ("levels", {"levels": (Level("saturation", 0.2, 5.2, lowest=0.2, highest=5.8, noise=1e-3),)}),
        ("levels", {"levels": (Level("saturation", 0.2, 5.2, lowest=0.1, highest=5.2, noise=1e-3),)}),
        ("constant", {"departures": {"drive_gain": Departure(0.11, 1e-5)}}),
        ("votes", {"votes": (Vote("error of the angle", "rad", Errors(0.22, 0.24, 0.003, samples=1.0)),)}),
        ("votes", {"votes": (Vote("error of the angle", "rad", Errors(0.041, 0.038, 0.003, samples=1.0)),)}),
        ("votes", {"votes": (Vote("error of the angle", "rad", Errors(0.041, math.nan, 0.003, samples=1.0)),)}),
        ("votes", {"votes": (Vote("error of the rate", "rad/s", Errors(0.40, 0.43, 0.01, samples=200.0), 0.158),)}),
        ("votes", {"votes": (Vote("error of the rate", "rad/s", Errors(0.40, math.nan, 0.01, samples=200.0), 0.158),)}),
        ("observed", {"observed": Errors(1.2, 1.4, 1.0, 1e5)}),
        ("observed", {"observed": Errors(1.2, math.nan, 1.0, 1e5)}),
        ("fell", {"residual": Errors(1.00, 1.01, 1.0, 1e5, gain=3.0)}),
        ("apart", {"sidebands": (Sidebands("base_vibration:1", "interference:2", 89.2),)}),
    ],
)
def test_each_promise_that_is_broken_is_told_by_its_own_guard(guard: str, part: dict) -> None:
    claim = replace(HOLDS, **part)
    assert guards_against(claim) == {guard}
    (sentence,) = promises.broken(claim)
    assert sentence


@pytest.mark.parametrize(
    "part",
    [
        {"residual": Errors(3.0, 1.09, 1.0, 1e5, gain=0.1)},
        {"residual": Errors(1.07, 1.03, 1.0, 1e6, 1e6, gain=60.0)},  # more went than is left
        {"residual": Errors(1.03, 1.024, 1.0, 1e6, 1e6, gain=60.0)},  # what is left does not matter
        {"residual": Errors(1.0324, 1.0303, 1.0, 1e3, 1e3, gain=60.0)},  # or is as much as chance makes
        {"residual": Errors(1.0324, 1.0303, 1.0, 1e6, 1e6, gain=60.0), "effects": {}},  # nothing is named
        {"effects": {"dry_friction": {"fx": Estimate(-0.1, -0.3, 0.1, positive=True), "fy": SURE}}},
        {"effects": {"drive_gain": {"hx": Estimate(-0.95, -0.99, -0.91, gain=True)}}},
        # a channel the other way round
        {"effects": {"drive_gain": {"hx": Estimate(-2.03, -2.1, -1.96, gain=True), "hy": SURE}}},
        {"effects": {"drag": {"dqx": Estimate(-0.05, -0.06, -0.04)}}},  # not declared positive
        {"constants": (Constant("kxx", 1.19, 1.18, 1.20, declared=1.0, deviation=0.05),)},
        {"constants": (Constant("kxx", 1.3, 1.1, 1.5, declared=1.0, deviation=0.05),)},  # may as well lie within
        {"constants": (Constant("kxy", -0.1, -0.11, -0.09, declared=0.0, deviation=0.05),)},
        {"constants": (Constant("kxx", math.nan, math.nan, math.nan, declared=1.0, deviation=0.05),)},
        {"levels": (Level("saturation", 0.2, 5.2, lowest=0.195, highest=5.205, noise=1e-3),)},
        {"votes": (Vote("error of the angle", "rad", Errors(0.0061, 0.0062, 0.003, samples=1.0)),)},  # to be expected
        {"votes": (Vote("error of the angle", "rad", Errors(0.040, 0.020, 0.003, samples=1.0)),)},
        {"votes": (Vote("error of the rate", "rad/s", Errors(0.40, 0.43, 0.01, samples=20.0), 0.158),)},  # by chance
        {"votes": (Vote("error of the rate", "rad/s", Errors(0.40, 0.40, 0.01, samples=200.0), 0.0),)},  # it lags
        {"votes": (Vote("error of the rate", "rad/s", Errors(0.01, 0.0105, 0.01, samples=200.0), 0.0),)},  # expected
        {"votes": ()},
        {"observed": Errors(1.4, 1.3, 1.0, 1e5)},
        {"observed": Errors(1.02, 1.05, 1.0, 1e5)},
    ],
)
def test_what_is_within_the_promise_is_let_through(part: dict) -> None:
    assert guards_against(replace(HOLDS, **part)) == set()


def test_gains_are_told_in_four_digits_with_a_true_minus() -> None:
    less = replace(HOLDS, residual=Errors(3.0, 1.0, 1.0, 1e5, gain=-12345.6))
    assert promises.fell(less) == ("the part held out is not predicted better: −1.235e+04 in twice the log-likelihood",)
    (outdone,) = promises.outdone(replace(HOLDS, contest=Contest(100.0, 987.65, 100.0, 1000)))
    assert "987.6 in twice the log-likelihood, what is named 100" in outdone


def test_a_residual_without_a_likelihood_falls_by_its_rms() -> None:
    assert Errors(1.8, 1.79, 1.0).fell
    assert not Errors(1.8, 1.8, 1.0).fell
    assert not Errors(1.8, math.nan, 1.0).fell
    assert not Errors(1.8, math.nan, 1.0, gain=1e6).fell  # samples that are no numbers have no likelihood
    claim = replace(HOLDS, residual=Errors(1.8, 12.0, 1.0, 1e5))
    assert guards_against(claim) == {"fell", "at_floor"}
    assert "rose from 1.8 to 12 ×" in promises.fell(claim)[0]


@pytest.mark.moderate
def test_the_floor_is_allowed_a_tenth_more_or_what_chance_makes_of_few_samples() -> None:
    """By draws of the residual: of complete models one in a hundred is turned away where samples are few."""
    assert Errors(9.0, 1.1, 1.0, 1e6).at_floor
    assert not Errors(9.0, 1.101, 1.0, 1e6).at_floor
    assert not Errors(9.0, 1.101, 1.0).at_floor
    random = np.random.default_rng(5)
    left = np.sqrt(np.mean(random.standard_normal((20_000, 30)) ** 2, axis=1))
    floor = np.sqrt(np.mean(random.standard_normal((20_000, 45)) ** 2, axis=1))
    turned_away = [not Errors(9.0, a, b, 30, 45).at_floor for a, b in zip(left[:4000], floor[:4000], strict=True)]
    assert np.mean(turned_away) == pytest.approx(0.01, abs=0.005)
    exact = [not Errors(9.0, a, 1.0, 30).at_floor for a in left[:4000]]
    assert np.mean(exact) == pytest.approx(0.01, abs=0.005)


@pytest.mark.moderate
def test_a_rate_that_an_effect_leaves_as_far_off_is_seldom_said_to_be_farther_off() -> None:
    """Of moves that halve the angle between error and estimate, |e + δ| = |e| but for chance: one in forty."""
    random = np.random.default_rng(11)
    n, told = 200, 0
    for _ in range(2000):
        e = random.standard_normal(n)
        moved = -0.25 * e + math.sqrt(0.25**2 * 7.0) * random.standard_normal(n)  # E[e·δ] = −E[δ²]/2
        before, after, size = (float(np.sqrt(np.mean(one**2))) for one in (e, e + moved, moved))
        told += Vote("error of the rate", "rad/s", Errors(before, after, 1e-3, float(n)), size).against
    assert told / 2000 == pytest.approx(0.025, abs=0.015)


@pytest.mark.moderate
def test_the_middle_between_right_and_chance_is_no_gain() -> None:
    """Coefficients c found elsewhere, where the truth is c and where it is 0: as often below 0 as above."""
    random = np.random.default_rng(7)
    c, signal = 3.0, np.ones(50) / math.sqrt(50.0)
    gains: dict[float, list[float]] = {0.0: [], c: []}
    for truth, found in gains.items():
        for noise in random.standard_normal((4000, 50)):
            seen = truth * signal + noise
            found.append(float(np.sum(seen**2) - np.sum((seen - c * signal) ** 2)))
    wrong = np.mean(np.array(gains[0.0]) > 0.0), np.mean(np.array(gains[c]) <= 0.0)
    assert wrong[0] == pytest.approx(wrong[1], abs=0.02)
    assert Errors(1.0, 1.0, 1.0, gain=1e-3).fell
    assert Errors(1.0, 1.0 + 1e-3, 1.0, 1e5, gain=1e-3).fell  # of so many samples an rms is sure of itself to 2e-3
    assert not Errors(1.0, 1.0 + 4e-3, 1.0, 1e5, gain=1e-3).fell
    assert not Errors(2.0, 1.0, 1.0, gain=0.0).fell


def test_the_share_is_of_the_power_above_the_floor() -> None:
    assert Errors(3.0, math.sqrt(3.0), 1.0).share == pytest.approx(0.75)
    assert Errors(3.0, 0.9, 1.0).share == 1.0
    assert Errors(2.0, 3.0, 1.0).share == pytest.approx(1.0 - 8.0 / 3.0)
    assert Errors(0.9, 0.8, 1.0).share == 0.0
    assert Errors(0.9, 0.8, 1.0).nothing_above
    assert not Errors(1.1, 0.8, 1.0).nothing_above
    assert Errors(3.0, math.nan, 1.0).share == 0.0


@pytest.mark.parametrize(
    ("claim", "holds"),
    [
        (replace(HOLDS, residual=Errors(3.0, 2.2, 1.0, 1e5)), True),  # 1 − 3.84/8 = 0.52
        (replace(HOLDS, residual=Errors(3.0, 2.3, 1.0, 1e5)), False),  # 0.46
        (replace(HOLDS, residual=Errors(3.0, 2.0, 1.0, 1e5, gain=-5.0)), False),
        (replace(HOLDS, effects={}), False),
        (replace(HOLDS, residual=Errors(3.0, 2.0, 1.0, 1e5), observed=Errors(1.2, 1.3, 1.0, 1e5)), False),
        (replace(HOLDS, effects={"drag": {"dqx": Estimate(0.1, -0.1, 0.3)}}), False),
        (replace(HOLDS, effects={"dry_friction": {"fx": Estimate(-2.0, -3.0, -1.0, positive=True)}}), False),
        (replace(HOLDS, levels=(Level("saturation", 0.2, 5.2, 0.2, 5.8, 1e-3),)), False),
        (replace(HOLDS, votes=(Vote("error of the angle", "rad", Errors(0.2, 0.2, 0.01, 1.0)),)), False),
        (replace(HOLDS, constants=(Constant("kxx", 1.3, 1.29, 1.31, 1.0, 0.05),)), True),  # told beside it
    ],
)
def test_a_part_is_explained_by_most_of_it(claim: Claim, holds: bool) -> None:
    assert promises.holds_in_part(claim) is holds


@pytest.mark.parametrize(
    ("before", "lead", "said"),
    [(2.2, -300.0, False), (2.2, 300.0, False), (2.2, -1100.0, True), (1.05, -300.0, True), (1.05, 1100.0, False)],
)
def test_a_part_must_not_be_surely_outdone_by_a_force_without_a_name(before: float, lead: float, *, said: bool) -> None:
    """Dispersion 171: odds of 20 to 1 are a lead of 1024.  A residual near the floor has to be told from nothing."""
    contest = Contest(named=0.0, nameless=-lead, both=0.0, samples=400, dispersions=(171.0, 140.0))
    claim = Claim(Errors(before, 0.9, 1.0, 400.0), {"a": {"c": Estimate(1.0, 0.9, 1.1)}}, contest=contest)
    assert bool(promises.outdone(claim)) is said
    assert bool(promises.nameless(claim)) is (lead < 1024.0)


def test_the_dominant_effects_are_named() -> None:
    assert promises.minor({"cubic_stiffness": 191_500.0, "drag": 646.0, "sense_gain": 30_000.0}) == ("drag",)
    assert promises.minor({"a": 5.0}) == ()
    assert promises.minor({}) == ()


def test_a_channel_the_other_way_round_is_said_to_be_a_polarity() -> None:
    flipped, usual = Estimate(-1.98, -2.0, -1.96, gain=True), Estimate(0.03, 0.02, 0.04, gain=True)
    said = promises.turned("drive_gain", {"hx": flipped, "hy": flipped})
    assert said == "drive gain of x and y is a polarity: x and y are driven or sensed reversed"
    said = promises.turned("sense_gain", {"gy": flipped})
    assert said == "sense gain of y is a polarity: y is driven or sensed reversed"
    assert promises.turned("drive_gain", {"hx": usual, "hy": usual}) is None
    not_beyond_doubt = Estimate(-2.0, -3.1, -0.9, gain=True)
    assert promises.turned("drive_gain", {"hx": not_beyond_doubt, "hy": usual}) is None
    assert promises.turned("drive_gain", {"hx": Estimate(-4.0, -4.1, -3.9, gain=True), "hy": usual}) is None
    assert promises.turned("cubic_stiffness", {"k3x": replace(flipped, gain=False)}) is None


def test_a_conflict_with_what_is_declared_says_how_far_and_a_small_damping_is_none() -> None:
    small = Constant("dxx", 0.5, 0.4, 0.6, declared=0.5, deviation=0.2, positive=True)
    assert promises.constants(replace(HOLDS, constants=(small,))) == ()
    far = Constant("kxx", 1.25, 1.24, 1.26, declared=1.0, deviation=0.05)
    (said,) = promises.constants(replace(HOLDS, constants=(far,)))
    assert "kxx comes out at 1.25, 5 standard deviations from the declared 1:" in said
    (fixed,) = promises.constants(replace(HOLDS, constants=(replace(far, deviation=0.0),)))
    assert "inf standard deviations" in fixed


def test_a_residual_of_less_than_one_sample_is_one() -> None:
    """As wide as Fisher's F of one and one degree makes it, and no wider."""
    few = Errors(900.0, 60.0, 1.0, samples=0.1, floor_samples=0.1)
    assert few.at_floor is (math.sqrt(f.isf(0.01, 1.0, 1.0)) >= 60.0)
    assert not Errors(900.0, 64.0, 1.0, samples=0.1, floor_samples=0.1).at_floor


def test_coefficients_that_differ_a_little_may_do_so_for_sure() -> None:
    assert promises.broken(replace(HOLDS, departures={"drive_gain": Departure(0.045, 0.0)})) == ()


def test_what_is_not_constant_may_be_said_to_act_so() -> None:
    departing = replace(HOLDS, departures={"drive_gain": Departure(0.3, 0.0)})
    (said,) = promises.broken(departing)
    assert "by 30% of their size" in said
    assert promises.holds_in_part(departing)


# -- exactly at a bound -----------------------------------------------------------------------------------------------


def test_an_error_that_is_as_large_as_before_did_not_fall() -> None:
    assert not Errors(2.0, 2.0, 1.0).fell
    assert not Errors(2.0, 1.0, 1.0, gain=0.0).fell
    assert Errors(2.0, 1.9, 1.0).fell
    assert not Errors(2.0, math.nan, 1.0).fell


def test_at_the_floor_is_up_to_a_tenth_more_and_nothing_stood_above_what_is_as_large_as_it() -> None:
    assert Errors(2.0, THRESHOLDS.promises.floor, 1.0).at_floor
    assert not Errors(2.0, 1.1000001, 1.0).at_floor
    assert not Errors(2.0, math.inf, 1.0).at_floor
    assert Errors(1.0, 1.0, 1.0).nothing_above
    assert not Errors(1.0000001, 1.0, 1.0).nothing_above


def test_where_nothing_stood_above_the_floor_no_share_of_it_went() -> None:
    assert Errors(1.0, 0.5, 1.0).share == 0.0
    assert Errors(0.5, 2.0, 1.0).share == 0.0
    assert Errors(3.0, 1.0, 1.0).share == 1.0
    assert Errors(3.0, 0.5, 1.0).share == 1.0
    assert Errors(3.0, 5.0, 1.0).share == pytest.approx(-2.0)
    assert Errors(3.0, math.nan, 1.0).share == 0.0


def test_a_tenth_of_the_largest_gain_is_not_minor() -> None:
    assert promises.minor({"a": 10.0, "b": 1.0, "c": 0.99}) == ("c",)
    assert promises.minor({}) == ()
    assert promises.minor({"a": -5.0}) == ("a",)  # less than nothing


def test_half_of_the_power_is_a_part() -> None:
    named = {"drag": {"dqx": Estimate(2.0, 1.0, 3.0)}}
    half = Errors(7.0, 5.0, 1.0, 1e6)
    assert half.share == 0.5
    assert promises.holds_in_part(Claim(half, named))
    assert not promises.holds_in_part(Claim(replace(half, after=5.01), named))
    assert not promises.holds_in_part(Claim(half, {}))
    vote = Vote("error of the angle", "rad", half)
    assert promises.votes(Claim(half, named, votes=(vote,))) == ()
    assert promises.votes(Claim(half, named, votes=(replace(vote, errors=replace(half, after=5.01)),)))


@pytest.mark.parametrize(("lead", "ahead"), [(TIE, False), (TIE + 1e-9, True)])
def test_a_name_that_is_ahead_by_as_much_as_tells_two_apart_is_not_ahead_enough(lead: float, *, ahead: bool) -> None:
    claim = Claim(Errors(1.05, 1.0, 1.0), {"drag": {}}, contest=Contest(0.0, 0.0, lead, 99))
    assert (promises.nameless(claim) == ()) is ahead
    assert (promises.outdone(claim) == ()) is ahead
    behind = replace(claim, residual=Errors(3.0, 1.0, 1.0), contest=Contest(0.0, lead, 0.0, 99))
    assert (promises.outdone(behind) == ()) is not ahead
    just = replace(behind, residual=Errors(THRESHOLDS.promises.floor, 1.0, 1.0))
    assert promises.outdone(just) != ()  # what is at the floor before is not there for sure


def test_an_interval_that_ends_at_zero_holds_it() -> None:
    assert promises.may_be_nothing("drag", {"dqx": Estimate(1.0, 0.0, 2.0)}) is not None
    assert promises.may_be_nothing("drag", {"dqx": Estimate(-1.0, -2.0, 0.0)}) is not None
    assert promises.may_be_nothing("drag", {"dqx": Estimate(1.0, 1e-12, 2.0)}) is None
    assert promises.may_be_nothing("drag", {"dqx": Estimate(-1.0, -2.0, -1e-12)}) is None
    assert promises.may_be_nothing("drag", {}) is None


def test_a_range_may_be_left_by_six_times_the_noise() -> None:
    level = Level("sense_clipping", -1.0, 1.0, -1.75, 1.75, 0.125)
    assert promises.contradicted(level) is None
    assert promises.contradicted(replace(level, highest=1.7500001)) is not None
    assert promises.contradicted(replace(level, lowest=-1.7500001)) is not None
    assert "ends at -1 V, and the part held out reads -1.751 V" in str(
        promises.contradicted(replace(level, lowest=-1.751))
    )


def test_a_constant_may_be_off_by_four_deviations_to_the_last_bit() -> None:
    def off(low: float, high: float, **more: bool) -> str | None:
        return promises.conflict(Constant("kxx", 0.5 * (low + high), low, high, 10.0, 0.5, **more))

    assert off(12.0, 13.0) is None
    assert off(12.0000001, 13.0) is not None
    assert off(7.0, 8.0) is None
    assert off(7.0, 7.9999999) is not None
    assert "standard deviations" in str(off(-3.0, 0.0, positive=True))  # not negative beyond doubt
    assert "comes out negative, -2" in str(off(-3.0, -1.0, positive=True))
    assert "inf standard deviations" in str(promises.conflict(Constant("kxx", 3.0, 2.0, 4.0, 10.0, 0.0)))


@pytest.mark.parametrize(("size", "chance", "told"), [(0.05, 0.0, False), (0.06, 1e-4, False), (0.06, 0.9e-4, True)])
def test_a_twentieth_of_a_coefficient_and_chance_are_no_departure(size: float, chance: float, *, told: bool) -> None:
    claim = Claim(Errors(2.0, 1.0, 1.0), {"drag": {}}, departures={"dry_friction:1": Departure(size, chance)})
    said = promises.constant(claim)
    assert bool(said) is told
    if told:
        assert said[0].startswith(
            "dry friction:1 has other coefficients in each part of the record, by 6% of their size"
        )


@pytest.mark.parametrize(
    ("value", "high", "polarity"),
    [
        (-2.0, -1.9, True),
        (-1.5, -1.4, True),
        (-1.49, -1.4, False),
        (-3.0, -2.9, True),
        (-3.01, -2.9, False),
        (-2.0, -1.0, False),
    ],
)
def test_a_polarity_is_a_gain_of_the_other_sign_and_of_half_to_twice_its_size(
    value: float, high: float, *, polarity: bool
) -> None:
    given = {"hx": Estimate(value, value - 0.1, high, gain=True), "hy": Estimate(0.1, 0.0, 0.2, gain=True)}
    said = promises.turned("drive_gain", given)
    assert said == ("drive gain of x is a polarity: x is driven or sensed reversed" if polarity else None)
    assert (promises.wrong_sign("drive_gain", given) is None) is (polarity or high == -1.0)
    assert promises.turned("drag", {"dqx": Estimate(-2.0, -2.1, -1.9)}) is None
    reversed_too = Estimate(-2.0, -2.1, -1.9, gain=True)
    both = promises.turned("sense_gain", {"hx": reversed_too, "hy": reversed_too})
    assert both == "sense gain of x and y is a polarity: x and y are driven or sensed reversed"


CALM = Claim(
    Errors(1.02, 1.02, 1.0, 1e5, gain=-1.5), {"sense_high_pass": {"hpx": SURE}}, contest=Contest(-1.5, 0.0, -1.5, 1000)
)


def test_a_constant_may_have_either_sign_unless_it_is_said_otherwise() -> None:
    assert not Constant("kxy", -5.0, -6.0, -4.0, declared=-5.0, deviation=1.0).positive


def test_what_the_bench_file_says_more_of_than_the_record_is_not_determined() -> None:
    """Two observations of deviation 1 leave 1/√2."""
    half = 1.959963984540054 / math.sqrt(2.0)

    def constant(name: str, times: float) -> Constant:
        return Constant(name, 5.0, 5.0 - times * half, 5.0 + times * half, declared=1.0, deviation=1.0)

    assert promises.undetermined(replace(HOLDS, constants=(constant("dyy", 0.999),))) == ()
    (said,) = promises.undetermined(replace(HOLDS, constants=(constant("dyy", 1.001), constant("kyy", 0.9))))
    assert said == "the record does not determine dyy: it says less of it than the bench file"
    (said,) = promises.undetermined(replace(HOLDS, constants=(constant("dyy", 1.001), constant("dxy", 2.0))))
    assert said == "the record does not determine dyy and dxy: it says less of each than the bench file"


def test_sidebands_of_what_modulates_may_be_said_to_act_like_lines() -> None:
    pair = replace(HOLDS, sidebands=(Sidebands("base_vibration:1", "interference:2", 89.2),))
    (said,) = promises.apart(pair)
    assert said == (
        "base vibration:1 and interference:2 lie 89.2 Hz to either side of the vibration: something that modulates it "
        "acts like them"
    )
    assert promises.holds_in_part(pair)


def test_how_much_went_is_told_where_most_is_left() -> None:
    """(1.0324² − 1.0303²) / (1.0324² − 1) is 6.6 %."""
    few = replace(HOLDS, residual=Errors(1.0324, 1.0303, 1.0, 1e6, 1e6, gain=60.0))
    (said,) = promises.at_floor(few)
    assert said == ("of what stood above the noise floor on the part held out 7% went: 1.03 × the noise floor is left")
    rose = replace(HOLDS, residual=Errors(1.0303, 1.0324, 1.0, 1e6, 1e6, gain=60.0))
    (said,) = promises.at_floor(rose)
    assert "part held out 0% went" in said
