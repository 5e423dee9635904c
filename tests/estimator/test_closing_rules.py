"""The closing scan's rules that need no observer, docs/decisions/0019-closing-scan.md, and the closed forms of how far
the angle is off. The scans themselves are in test_completeness.py.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from estimator.completeness.answer import Lacking, Outcome
from estimator.completeness.closing import (
    _is_of_the_rate,
    beside_those,
    closing_scan,
    information_of,
    price,
    require_scannable,
)
from estimator.completeness.constants import calibrated_effects, off, shares
from estimator.completeness.information import Information, ScannedCoefficient
from estimator.completeness.lacking import HARMLESS, largest
from estimator.completeness.scores import Scores
from estimator.completeness.stretch import Stretch
from estimator.completeness.stretched import Stretched, likelihood_of
from estimator.completeness.turning import Turning
from estimator.completeness.words import Nearest, in_words
from estimator.diagnosis import Interval
from estimator.errors import ModelError
from estimator.record import Record
from estimator.trace.problem import Problem
from estimator.trace.score_test import Score
from tests.estimator.test_scan import DEVICE, SETTINGS

RATE_HZ = DEVICE.sample_rate
SINGLE = replace(
    DEVICE, stiffness=DEVICE.stiffness[:1], damping=DEVICE.damping[:1], sense_gain=DEVICE.sense_gain[:1],
    noise=DEVICE.noise[:1],
)  # fmt: skip
CYCLE = RATE_HZ * 2.0 * math.pi / math.sqrt(DEVICE.target)
"""Samples in a cycle of the resonance."""
ENOUGH = max(2000, math.ceil(100.0 * CYCLE))


def record(samples: int = ENOUGH) -> Record:
    """Both channels swing, driven."""
    swing = np.sin(np.arange(samples)[:, None] + np.array([0.0, 1.0]))
    return Record(swing, swing[:, :, None], np.full(samples, 1.0 / RATE_HZ))


def stretch(found: Record) -> Stretch:
    return Stretch(found, 0.0)


def refused(*found: Record, device=DEVICE) -> str:
    with pytest.raises(ModelError) as told:
        require_scannable([stretch(one) for one in found], device)
    return str(told.value)


def test_a_record_of_enough_cycles_and_samples_can_be_scanned() -> None:
    require_scannable([stretch(record())], DEVICE)
    require_scannable([stretch(record()), stretch(record(50))], DEVICE)  # the first one decides


def test_what_says_nothing_of_a_model_is_refused_with_its_reason() -> None:
    assert "are too few" in refused(record(ENOUGH // 2))
    assert "a single sample is too few" in refused()
    slow = replace(record(), step=np.full(ENOUGH, 0.1 / RATE_HZ))  # as many samples, a tenth of the cycles
    assert "cycles of the resonance, are too few" in refused(slow)
    quick = replace(record(1000), step=np.full(1000, 1.0))
    assert "1000 samples" in refused(quick)
    assert "a single axis has no angle" in refused(record(), device=SINGLE)


@pytest.mark.parametrize("channel", [0, 1])
def test_a_dead_channel_is_told(channel: int) -> None:
    sense = record().sense.copy()
    sense[:, channel] = 0.0
    assert "a sense channel is dead" in refused(replace(record(), sense=sense))
    assert "a sense channel is dead" in refused(record(), replace(record(), sense=sense))  # in any stretch
    drive = record().drive.copy()
    drive[7, channel] = np.nan
    assert "is dead" in refused(replace(record(), drive=drive))


def test_half_of_the_samples_may_be_lost_and_no_more() -> None:
    def lost(every: int) -> Record:
        sense = record().sense.copy()
        sense[::every] = np.nan
        return replace(record(), sense=sense)

    require_scannable([stretch(lost(3))], DEVICE)
    sense = lost(3).sense.copy()
    sense[1::3] = np.nan
    assert refused(replace(record(), sense=sense)).startswith("67% of the samples are lost")


def test_a_run_that_cannot_be_judged_is_unknown_with_its_reason_and_size() -> None:
    short = [stretch(record(10)), stretch(record(30))]
    found = closing_scan(short, DEVICE, SETTINGS, None, scored_s=(0.0, 1.0))
    assert (found.outcome, found.samples, found.seconds) == (Outcome.UNKNOWN, 40, pytest.approx(40 / RATE_HZ))
    assert found.reason.startswith("not scanned: 10 samples")


# ------------------------------------------------------------------------------------------- what it does to the angle


def test_the_angle_is_off_by_what_the_coefficients_move_it_at_its_worst() -> None:
    """Against SciPy: the 95 % interval of a normal combination of two coefficients that go with each other."""
    moves = np.array([[0.0, 0.0], [1.0, -2.0], [-3.0, 1.0]])
    values, covariance = np.array([0.4, 0.1]), np.array([[4e-3, 1e-3], [1e-3, 9e-3]])
    time, none = np.arange(3.0), np.zeros(3)
    found = largest(*Turning({"a": slice(0, 2)}, time, moves, none, none).course(["a"], values, covariance))
    drawn = multivariate_normal(values, covariance, seed=1).rvs(400_000) @ moves[2]
    assert found.value == pytest.approx(1.1)  # −3 × 0.4 + 0.1, whichever way
    low, high = norm.interval(0.95, 1.1, drawn.std())
    assert (found.low, found.high, found.unit) == (pytest.approx(low, rel=0.01), pytest.approx(high, rel=0.01), "rad")


def test_the_interval_of_a_size_does_not_go_below_nothing() -> None:
    assert largest(np.array([-0.01]), np.array([1.0])).low == 0.0


def turning() -> Turning:
    sensitivity = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    return Turning({"a": slice(0, 1), "b": slice(1, 3)}, np.array([5.0, 9.0]), sensitivity, np.zeros(2), np.zeros(2))


def test_shifts_add_up_and_deviations_add_as_squares() -> None:
    moved = turning().with_shift(*turning().course(["a"], np.array([0.5]), np.array([[0.04]])))
    np.testing.assert_allclose(moved.shift, [0.0, 0.5])
    np.testing.assert_allclose(moved.deviation, [0.0, 0.2])
    covariance = np.array([[0.01, 0.002], [0.002, 0.04]])
    more = moved.with_shift(*turning().course(["b"], np.array([-0.1, 0.2]), covariance))
    np.testing.assert_allclose(more.shift, [0.0, 0.5 - 0.2 + 0.6])
    spread = 2.0**2 * 0.01 + 3.0**2 * 0.04 + 2.0 * 2.0 * 3.0 * 0.002
    np.testing.assert_allclose(more.deviation, [0.0, math.sqrt(0.2**2 + spread)])
    np.testing.assert_array_equal(more.of("b"), turning().sensitivity[:, 1:])


# ----------------------------------------------------------------------------------------------------------- judging


def likelihood(*known: Record) -> Stretched:
    return likelihood_of(Problem(record(), DEVICE, SETTINGS), known or (record(),))


def score(name: str, gain: float = 0.0, **given: float) -> Score:
    size = np.zeros(len(likelihood().effect(name).coefficients))
    return Score(name, gain, size, size, 1.0, given)


def test_two_numbers_cost_twice_as_much_and_a_longer_record_more() -> None:
    """Schwarz: twice the log-likelihood is worth ln n for each number, a frequency that is searched being one."""
    of = likelihood()
    assert price(of, score("sense_gain"), 1000) == pytest.approx(math.log(1000.0))
    assert price(of, score("drive_gain"), 1000) == pytest.approx(2.0 * math.log(1000.0))
    assert price(of, score("drive_gain"), 10_000) == pytest.approx(2.0 * math.log(10_000.0))
    coefficients = len(of.effect("interference").coefficients)
    found = price(of, score("interference", omega=1.0), 1000)
    assert found == pytest.approx((coefficients + 1) * math.log(1000.0))


def test_a_line_may_come_again_and_another_effect_may_not() -> None:
    tested = {"interference:1": {"omega": 1.0}, "interference:2": {"omega": 2.0}, "drive_saturation:2": {"limit": 1.0}}
    there = {"interference:1": {"omega": 1.0}, "drive_saturation:4": {"limit": 2.0}}
    assert beside_those(tested, there) == {"interference:2": {"omega": 2.0}}


@pytest.mark.parametrize(
    ("share", "power", "rates"),
    [(1.02, 0.5, True), (0.98, 0.5, True), (1.02, 2.0, False), (1.2, 0.5, False), (0.8, 0.5, False)],
)
def test_a_weak_line_beside_the_resonance_is_what_a_rate_leaves(share: float, power: float, rates: bool) -> None:
    """It must hold a hundredth of the power to be a line."""
    seen = scores(samples=2000)
    line = {"omega": share * math.sqrt(DEVICE.target)}
    assert _is_of_the_rate(line, power * 0.01 * 2000, likelihood(), seen) is rates


def test_what_has_no_frequency_is_no_line() -> None:
    assert not _is_of_the_rate({}, 0.0, likelihood(), scores(samples=2000))


def scores(**known: Any) -> Scores:
    """Two coefficients of the drive gain, one of another effect; nothing else is asked for."""
    usual: dict[str, Any] = {
        "normal": np.arange(9.0).reshape(3, 3),
        "score": np.arange(3.0),
        "plausible": np.array([0.05, 0.06, 2.0]),
        "table": (),
        "ratio": 1.0,
        "widening": 1.0,
        "samples": 8,
    }
    return Scores({"drive_gain": slice(0, 2), "sense_gain": slice(2, 3)}, **(usual | known))


def test_what_was_tested_goes_to_the_budget_with_size_and_sensitivity() -> None:
    """The sensitivity has effects that were included meanwhile, and stand in another place."""
    columns = {"sense_gain": slice(0, 1), "other": slice(1, 2), "drive_gain": slice(2, 4)}
    sensitivity = np.array([[0.0] * 4, [1.0, 2.0, 3.0, 4.0]])
    moved = Turning(columns, np.array([0.0, 1.0]), sensitivity, np.array([0.0, 0.3]), np.array([0.0, 0.4]))
    loud = scores(widening=3.0)
    found = information_of(loud, moved, likelihood())
    assert [(c.effect, c.symbol, c.plausible) for c in found.coefficients] == [
        ("drive_gain", "hx", 0.05), ("drive_gain", "hy", 0.06), ("sense_gain", "gy", 2.0)
    ]  # fmt: skip
    np.testing.assert_array_equal(found.sensitivity, [[0.0] * 3, [3.0, 4.0, 1.0]])
    np.testing.assert_array_equal(found.normal, loud.normal)
    np.testing.assert_array_equal(found.score, loud.score)
    assert found.widening == 3.0
    np.testing.assert_allclose(found.found, [0.0, 0.5])


def test_effects_are_alike_where_what_they_do_to_the_record_is_the_same() -> None:
    same = np.outer([1.0, 2.0, 2.0], [1.0, 2.0, 2.0])  # of one column each, as long as the coefficients say
    assert scores(normal=same).alike("drive_gain", np.array([0.1, 0.1])) == ["sense_gain"]
    assert scores(normal=np.eye(3)).alike("drive_gain", np.array([0.1, 0.1])) == []


# ------------------------------------------------------------------------------------------------------------ in words


def lacking(effect: str, angle: float, alike: tuple[str, ...] = ()) -> Lacking:
    size = {"hx": Interval(-0.02, -0.021, -0.019, "1"), "tx": Interval(3e-6, 2e-6, 4e-6, "s")}
    return Lacking(effect, effect, size, 100.0, Interval(angle, 0.0, 2 * angle, "rad"), alike)


def test_what_is_lacking_is_named_with_size_and_angle() -> None:
    words = in_words([lacking("drive_gain", 0.31, ("sense_gain",))], [[lacking("clipping", 0.01)]], [], 30)
    first, second = words.split("; the angle is off by up to 0.31 rad; ")
    assert first == "lacks drive_gain (or sense_gain): hx = −0.0200 ± 0.0010, tx = (3.0 ± 1.0) × 10⁻⁶ s"
    assert second.startswith("small effect found: clipping, negligible: hx")


def test_what_is_harmless_is_told_as_such() -> None:
    words = in_words([], [[lacking("clipping", 0.01)]], [], 30)
    assert words.startswith("small effect found: clipping, negligible: ")
    assert pytest.approx(1.0 / 3.0) == HARMLESS


def test_what_no_effect_explains_is_told() -> None:
    alone = in_words([], [], ["a line at 50 Hz", "low frequencies"], 30)
    assert alone == "the residual is explained by no effect known: a line at 50 Hz, low frequencies"
    beside = in_words([], [[lacking("clipping", 0.01)]], ["a line at 50 Hz"], 30)
    assert beside.startswith("beside what is harmless, the residual is explained by no effect known: a line at 50 Hz; ")
    assert "small effect found: clipping" in beside


def test_constants_that_are_off_together_are_told_together() -> None:
    found = [lacking("drive_gain", 0.03), lacking("drive_delay", 0.04)]
    words = in_words(found, [], [], 30)
    assert words.startswith("lacks the constants of the calibration together, each a little off: drive_gain hx = ")
    assert "; drive_delay hx = " in words
    assert words.endswith("; the angle is off by up to 0.05 rad")
    small = in_words([], [found], [], 30)
    assert small.startswith("small effect found: the constants of the calibration together, each a little off, ")
    assert small.endswith(", 0.05 rad of the angle")


def test_shares_add_up_to_the_whole_where_one_part_takes_from_another() -> None:
    parts = shares(np.array([4.0, 6.0, -1.0]), {"a": slice(0, 2), "b": slice(2, 3)})
    assert parts == {"a": pytest.approx(3.0), "b": 0.0}  # of two that nearly cancel, not the square of each
    assert shares(np.array([-1.0]), {"a": slice(0, 1)}) == {"a": 0.0}


def test_constants_are_effects_with_every_coefficient_declared() -> None:
    declared = {"hx": 0.01, "hy": 0.02, "gy": 0.005, "mx": 0.1, "clock": 1e-5, "ex": 0.1, "ey": 0.0}
    names = ["cubic_stiffness", "drive_gain", "drive_misalignment", "sense_gain", "sense_cross_coupling"]
    assert calibrated_effects(declared, names, DEVICE) == ("drive_gain", "sense_gain")


def told_of(score: list[float], normal: list[float]) -> Information:
    """Of gains, each told by itself."""
    of = (ScannedCoefficient("drive_gain", "hx", "1", 1.0), ScannedCoefficient("drive_gain", "hy", "1", 1.0))
    of = (*of, ScannedCoefficient("sense_gain", "gy", "1", 1.0))
    return Information(
        of, np.diag(normal), np.array(score), np.array([0.0, 1.0]), np.array([[0.0] * 3, [1.0, 0.0, 2.0]])
    )


def test_it_tells_which_constants_are_off() -> None:
    """By hand: a coefficient of deviation s predicts better by s² b²/(1 + s² n) − ln(1 + s² n), twice the log."""
    declared = {"hx": 0.01, "hy": 0.01, "gy": 0.01}
    names = ("drive_gain", "sense_gain")
    one = off(told_of([-2e4, 0.0, 0.0], [1e6, 1e6, 1e6]), names, declared, DEVICE, 20.0)
    assert one is not None
    assert list(one.places) == ["drive_gain"]
    assert one.evidence == pytest.approx(1e-4 * 4e8 / 101.0 - 2.0 * math.log(101.0))
    assert one.found.mean == pytest.approx([1e-4 * 2e4 / 101.0, 0.0])
    both = off(told_of([-2e4, 1e4, 1e4], [1e6, 1e6, 1e6]), names, declared, DEVICE, 20.0)
    assert both is not None
    assert list(both.places) == ["drive_gain", "sense_gain"]
    assert off(told_of([-1e3, 0.0, 0.0], [1e6, 1e6, 1e6]), names, declared, DEVICE, 20.0) is None
    assert off(told_of([-2e4, 0.0, 0.0], [1e6, 1e6, 1e6]), (), declared, DEVICE, 20.0) is None


def test_nothing_at_all_says_how_much_was_looked_for() -> None:
    assert in_words([], [], [], 30) == "none of the 30 effects tested is significant"


def test_what_leaves_most_of_the_residual_is_only_nearest() -> None:
    words = in_words([], [[lacking("clipping", 0.01)]], [], 30, Nearest("drive_saturation", "5.23 × the noise"))
    assert words.startswith(
        "something is missing that no effect explains by itself: drive_saturation comes nearest and leaves 5.23 × the "
        "noise; hil trace tells; "
    )
    assert "drive_saturation:" not in words  # no coefficients
