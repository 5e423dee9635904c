"""Stated probabilities beside how often they were right: bins, the error, the diagram, and what counts as right."""

import numpy as np
import pytest

from evaluation.undeclared.calibration import calibration, most_probable
from evaluation.undeclared.judging import judge
from evaluation.undeclared.summary import summarise
from tests.undeclared.test_judging import BACKLASH, CUBIC, GAIN, said, truth


def test_the_error_is_the_distance_of_what_was_stated_from_what_was_so() -> None:
    statements = [(0.9, True)] * 6 + [(0.9, False)] * 4 + [(0.2, False)] * 10
    found = calibration(statements)
    assert [(one.number, one.stated, one.so) for one in found.bins] == [
        (10, pytest.approx(0.2), 0.0), (10, pytest.approx(0.9), 0.6),
    ]  # fmt: skip
    assert found.error == pytest.approx((10 * 0.2 + 10 * 0.3) / 20)
    low, high = found.bins[1].low, found.bins[1].high
    assert (low, high) == pytest.approx((0.2624, 0.8784), abs=1e-4)  # Clopper and Pearson of 6 in 10, tabulated


@pytest.mark.moderate
def test_honest_odds_have_a_small_error_and_boasts_a_large_one() -> None:
    rng = np.random.default_rng(1)
    stated = rng.uniform(0.0, 1.0, 20_000)
    so = rng.uniform(0.0, 1.0, 20_000) < stated
    honest = calibration(zip(stated.tolist(), so.tolist(), strict=True)).error
    assert honest is not None
    assert honest < 0.015
    squared = calibration(zip((1.0 - (1.0 - stated) ** 4).tolist(), so.tolist(), strict=True)).error
    assert squared == pytest.approx(0.3, abs=0.02)  # the mean of 1 − (1 − p)⁴ − p is 4/5 − 1/2


def test_a_certainty_is_in_the_last_bin_and_none_is_refused() -> None:
    assert calibration([(1.0, True)]).bins[0].high == 1.0
    assert calibration([]).error is None
    with pytest.raises(ValueError, match="no probability"):
        calibration([(1.2, True)])


def test_the_most_probable_stands_with_its_look_alikes() -> None:
    entry = {"classes": {"sense_gain": 0.5, "drive_gain": 0.3, "drag": 0.15, "nothing": 0.05}}
    assert most_probable(entry, []) == ({"sense_gain"}, 0.5)
    alike = [frozenset({"sense_gain", "drive_gain"}), frozenset({"drag", "dry_friction"})]
    members, probability = most_probable(entry, alike)
    assert members == {"sense_gain", "drive_gain"}
    assert probability == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("category", "hidden", "classes", "statement"),
    [
        ("single", [GAIN], {"sense_gain": 0.9, "nothing": 0.1}, (0.9, True)),
        ("single", [GAIN], {"cubic_stiffness": 0.7, "sense_gain": 0.3}, (0.7, False)),
        ("single", [GAIN], {"something else": 0.95, "sense_gain": 0.05}, (0.95, False)),
        ("single", [GAIN], {"nothing": 0.95, "sense_gain": 0.05}, (0.95, False)),
        ("double", [GAIN, CUBIC], {"cubic_stiffness": 0.8, "nothing": 0.2}, (0.8, True)),
        ("clean", [], {"nothing": 0.97, "sense_gain": 0.03}, (0.97, True)),
        ("clean", [], {"sense_gain": 0.6, "nothing": 0.4}, (0.6, False)),
        ("outside", [BACKLASH], {"something else": 0.99, "nothing": 0.01}, (0.99, True)),
        ("outside", [BACKLASH], {"cubic_stiffness": 0.99, "nothing": 0.01}, (0.99, False)),
    ],
)
def test_what_is_right_depends_on_what_was_hidden(category, hidden, classes, statement) -> None:
    answer = said("explained") | {"probabilities": [{"effect": None, "classes": classes}]}
    assert judge(truth(category, *hidden), answer).statements == (statement,)


def test_nothing_is_right_of_a_calm_record_only_where_the_bound_holds() -> None:
    stated = {"probabilities": [{"effect": None, "classes": {"nothing": 1.0}}]}
    for high, right in ((0.03, True), (0.01, False)):
        bound = {"gy": {"value": 0.0, "ci95": [-high, high], "unit": "1"}}
        answer = said("adequate", rejected=[("sense_gain", bound)]) | stated
        assert judge(truth("calm", GAIN), answer).statements == ((1.0, right),)


@pytest.mark.moderate
def test_the_campaign_counts_them() -> None:
    answer = said("explained") | {"probabilities": [{"effect": None, "classes": {"sense_gain": 0.75, "nothing": 0.25}}]}
    judged = [judge(truth("single", GAIN), answer), judge(truth("clean"), answer), judge(truth("clean"), None)]
    found = summarise(judged)["calibration"]
    assert (found["n"], found["error"]) == (2, pytest.approx(0.25))
    both = summarise([*judged, judge(truth("calm", GAIN), answer)])
    for kind, number, error in (("", 3, 1 / 12), ("_excited", 2, 0.25), ("_calm", 1, 0.25)):
        assert (both[f"calibration{kind}"]["n"], both[f"calibration{kind}"]["error"]) == (number, pytest.approx(error))
