"""From a record to a diagnosis: two made records, and the parts of an answer by hand."""

import re
from dataclasses import replace

import numpy as np
import pytest

from estimator.diagnosis import Rejected, Separation, Verdict
from estimator.scaling import Scaling
from estimator.trace.ambiguity import Member, exchanged
from estimator.trace.checks import CHECKS
from estimator.trace.filtered import Filtered
from estimator.trace.fit import fit, settle
from estimator.trace.likelihood import Check, Evaluation
from estimator.trace.named import effects_of
from estimator.trace.probabilities import _classes, probabilities
from estimator.trace.problem import Effects
from estimator.trace.rejected import rejected as rejections
from estimator.trace.rejected import ruled_out
from estimator.trace.search import margin
from estimator.trace.trace import trace
from tests.trace.linear import fitted
from tests.trace.plain import problem, records
from tests.trace.test_checks import SURE, evaluation, evidence, model
from tests.trace.test_search import orthogonal, search

LATE, SPLIT = 5e-6, 4000
RETIRED = (
    "promise|claim|asked|look|seen|watched|standing|price|bar|hopeful|spoken|whom|objection|dissent|widening|nameless|"
    "rival|contest|without a name|kin|alike|near|separations|ways?|hill|climb|cliff|same number|wanes|calm|in earnest|"
    "lawful|nothing|who|nobody|surprise|luck|reign|farewell|undone|carried"
)
"""What `docs` and messages no longer say."""


@pytest.mark.slow
def test_a_record_with_nothing_hidden_is_adequate() -> None:
    sense, drive = records(1, 7000)
    found = trace(problem(sense[0], drive[0]), split=SPLIT)
    assert (found.verdict, found.effects, found.separations) == (Verdict.ADEQUATE, (), ())
    assert found.probabilities[0].probabilities["nothing"] == max(found.probabilities[0].probabilities.values())


@pytest.mark.slow
def test_a_late_pair_of_channels_is_told_with_the_late_drive() -> None:
    """x(t − τ) answers u(t − τ): only the noise of the force says which of the two is late."""
    sense, drive = records(1, 7000, LATE)
    found = trace(problem(sense[0], drive[0]), split=SPLIT)
    assert found.verdict is Verdict.EXPLAINED
    assert [effect.name for effect in found.effects] == ["sense_delay"]
    pairs = [(one.effect, one.other) for one in found.separations]
    assert pairs == [("sense_delay", "sense_low_pass"), ("sense_delay", "drive_delay")]  # far above the resonance
    assert all(one.correlation > 0.99 for one in found.separations)
    for name in ("tsx", "tsy"):
        interval = found.effects[0].coefficients[name]
        assert abs(interval.value - LATE) < 4.0 / 1.96 * (interval.high - interval.value)
        assert 2e-7 < interval.high - interval.value < 2e-6
        assert interval.unit == "s"
        assert interval.value - interval.low == pytest.approx(interval.high - interval.value)
    shares = found.probabilities[0].probabilities
    assert sum(shares.values()) == pytest.approx(1.0)
    assert set(shares) == {"sense_delay", "sense_low_pass", "drive_delay", "nothing", "something else"}
    assert found.share is not None


@pytest.mark.slow
def test_a_delay_of_both_drives_is_grouped_with_one_of_both_channels() -> None:
    sense, drive = records(1, 2500, LATE)

    class Few(Filtered):
        """With few candidates: the pair, and one that is neither."""

        def candidates(self, model, evaluation: Evaluation) -> Effects:  # type: ignore[no-untyped-def]
            names = ("sense_delay", "drive_delay", "sense_gain")
            return {name: {} for name in names if name not in model.effects}

    of = Few(problem(sense[0], drive[0]))
    for name, other in (("sense_delay", "drive_delay"), ("drive_delay", "sense_delay")):
        best = settle(of, fit(of, {name: {}}))
        best, groups = exchanged(of, best)
        (kept,) = groups
        assert {kept, *(member.name for member in groups[kept])} == {name, other}


def test_coefficients_and_parameters_come_in_si() -> None:
    sense, drive = records(1, 60)
    of = Filtered(problem(sense[0], drive[0]))
    given = {"interference": {"omega": 700.0, "lcx": 2e-7}, "sense_delay": {"tsx": 1e-6, "tsy": -2e-6}}
    layout = of.layout(given)
    theta = layout.mean.copy()
    theta[layout.names.index("omega")] *= 1.01
    start = replace(fitted(orthogonal()), layout=layout)
    found = effects_of(replace(start, model=replace(start.model, effects=given, theta=theta)))
    assert found["sense_delay"] == pytest.approx(given["sense_delay"])
    assert found["interference"] == pytest.approx({"omega": 707.0, "lcx": 2e-7, "lsx": 0.0, "lcy": 0.0, "lsy": 0.0})


def test_probabilities_are_likelihoods_that_sum_to_one() -> None:
    found = _classes("drag", {"nothing": 0.0, "drag": 2.0 * np.log(9.0), "else": -np.inf})
    assert found.probabilities == pytest.approx({"drag": 0.9, "nothing": 0.1, "else": 0.0})
    assert list(found.probabilities) == ["drag", "nothing", "else"]


@pytest.mark.parametrize("left", [True, False])
def test_the_unknown_is_as_probable_as_a_force_makes_the_record(left: bool) -> None:
    """n ln of the ratio of mean squares, less twice the logarithms, less the cost of two numbers; nothing but that cost
    where no check finds more than a complete model leaves.
    """
    found = search(orthogonal(a=(1, 60.0), b=(1, 3.0)))
    quiet, force = evaluation(np.eye(1), scale=1.0), evaluation(np.eye(1), scale=0.97, logs=0.002)
    n = quiet.count.sum()
    one = replace(evidence(found.best, quiet=quiet, disturbed=force), without={"a": found.base})
    checks = [Check("disturbance", not left, ""), Check("prior", False, "")]
    group = [Member("c", 0.99, found.best, 3.0)]
    (shares,) = probabilities(one, checks, {"a": group}, found)
    weights = shares.probabilities
    other = (n * np.log(1.0 / 0.97) - 2.0 * 0.002 * n if left else 0.0) - 2.0 * np.log(n)
    assert np.log(weights["c"] / weights["a"]) == pytest.approx(-1.5)
    assert 2.0 * np.log(weights["something else"] / weights["a"]) == pytest.approx(other)
    assert 2.0 * np.log(weights["a"] / weights["nothing"]) == pytest.approx(found.best.gain_over(found.base))


def rejected(**gains: tuple[int, float]) -> dict[str, Rejected]:
    of = orthogonal(**gains)
    found = search(of)
    sense, drive = records(1, 60)
    groups: dict[str, list[Member]] = {name: [] for name in found.best.model.effects}
    scaling = Scaling.of(problem(sense[0], drive[0]).device)
    return {each.name: each for each in rejections(of, found, groups, {}, scaling)}


def test_every_unnamed_candidate_says_its_gain_and_its_largest_size() -> None:
    """Of unit columns and unit noise: 1.96/√2000 to either side of a size of √(gain/2000)."""
    found = rejected(a=(1, 60.0), b=(1, 15.0), c=(1, 3.0))
    assert set(found) == {"b", "c"}
    assert found["b"].reason.startswith("raises 2 ln L by 1")
    gain, least = re.findall(r"[\d.]+(?= )", found["c"].reason.split("by")[1])
    assert float(gain) == pytest.approx(3.0, rel=0.05)
    assert float(least) == pytest.approx(margin(2), rel=0.01)
    bound = found["c"].bound["c0"]
    assert bound.value == pytest.approx(np.sqrt(3.0 / 2000), rel=0.05)
    assert bound.high - bound.value == pytest.approx(1.96 / np.sqrt(2000), rel=0.15)  # times the scatter's root
    assert bound.value - bound.low == pytest.approx(bound.high - bound.value)


def test_a_member_of_a_group_is_not_ruled_out() -> None:
    others = (Rejected("b", "this record does not separate it from a"), Rejected("c", "no more than chance"))
    assert ruled_out(others, [Separation("a", "b", 1.0, None, None)]) == others[1:]
    assert ruled_out(others, []) == others


def test_a_candidate_that_was_taken_out_again_says_so() -> None:
    of = orthogonal(a=(1, 60.0), b=(1, 3.0))
    found = search(of)
    assert list(found.best.model.effects) == ["a"]
    sense, drive = records(1, 60)
    scaling = Scaling.of(problem(sense[0], drive[0]).device)
    left = rejections(of, replace(found, best=found.base), {}, {}, scaling)
    reasons = {one.name: one.reason for one in left}
    assert set(reasons) == {"a", "b"}
    assert "with the others in the model" in reasons["a"]


def sentences() -> list[str]:
    """Of all checks, passed and failed, and of a candidate that is not named."""
    bad = evaluation(100.0 * np.eye(3), np.tile([[9.0, 9.0, 90.0], [-9.0, -9.0, -90.0]], (12, 1)))
    off = model("one", theta=[0.0, 50.0, -40.0], seen=bad, prior=[1.0, 1.0, 1e3])
    worse = evaluation(np.eye(1), scale=1.2)
    wrong = evidence(off, later=worse, ratio=3.0, quiet=worse)
    checks: list[Check] = [check for case in (evidence(SURE), wrong) for checker in CHECKS for check in checker(case)]
    assert {check.name for check in checks if not check.passed} == {check.name for check in checks}
    left = rejected(a=(1, 60.0), b=(1, 3.0)).values()
    return [*(check.sentence for check in checks), *(check.name for check in checks), *(one.reason for one in left)]


def test_sentences_use_the_words_of_the_field_and_are_short() -> None:
    for sentence in sentences():
        assert not re.search(rf"\b({RETIRED})\b", sentence, re.IGNORECASE), sentence
        assert len(sentence.split()) <= 25
