"""Each check with evidence made up for it, on either side of its threshold; and what deviations it goes by."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from estimator.trace.checks import (
    CHECKS,
    Evidence,
    constancy,
    disturbance,
    floor,
    held_out,
    outliers,
    prior,
    reference,
    sign,
)
from estimator.trace.fit import FittedModel
from estimator.trace.likelihood import BLOCKS, Check, Evaluation, Model, Noise
from estimator.written import gains
from tests.trace.linear import Linear, Parameters, effect
from tests.trace.plain import Array

ONE, MANY = effect("one", 1, plausible=1e3, positive=True), effect("many", 2, plausible=1e3)
OF = Linear(np.zeros(0), np.zeros((0, 2)), {}, {"one": ONE, "many": MANY})
PER_PART = 50.0


def evaluation(information: Array, score: Array | None = None, scale: float = 1.0, logs: float = 0.0) -> Evaluation:
    """That information over all parts, scores (parts, k), a mean square of `scale`, and a mean logarithm."""
    k = len(information)
    each = np.full(BLOCKS, PER_PART)
    return Evaluation(
        tuple(str(n) for n in range(k)), np.zeros((BLOCKS, k)) if score is None else score,
        np.tile(information / BLOCKS, (BLOCKS, 1, 1)), scale * each, logs * each, each, np.zeros((0, 1)),
        np.zeros((0, 1)),
    )  # fmt: skip


def model(*effects: str, theta: list[float], seen: Evaluation, prior: list[float]) -> FittedModel:
    """Two base parameters and effects."""
    layout = Parameters(2, {key: {} for key in effects}, OF.declared)
    layout.deviation = np.array(prior)
    return FittedModel(
        layout, Model({key: {} for key in effects}, np.array(theta), Noise((1.0,), 1.0, 0.0)), seen, 0.0, True
    )


def evidence(
    fitted: FittedModel, *, later: Evaluation | None = None, without: Evaluation | None = None, ratio: float = 1.0,
    quiet: Evaluation | None = None, disturbed: Evaluation | None = None,
) -> Evidence:  # fmt: skip
    plain = evaluation(np.eye(1))
    names = list(fitted.model.effects)
    return Evidence(
        OF, fitted, dict.fromkeys(names, fitted), later or plain, dict.fromkeys(names, without or plain), ratio,
        quiet or plain, disturbed or plain, plain, ratio,
    )  # fmt: skip


SURE = model("one", theta=[0.0, 0.0, 1.0], seen=evaluation(100.0 * np.eye(3)), prior=[1.0, 1.0, 1e3])


def only(checks: list[Check]) -> Check:
    assert len(checks) == 1
    return checks[0]


@pytest.mark.parametrize(("scale", "logs", "passed"), [(1.001, 0.0, False), (0.999, 0.0, True), (1.0, 0.0, False)])
def test_an_effect_has_to_make_the_part_held_out_more_probable(scale: float, logs: float, passed: bool) -> None:
    """Twice the gain is n ln of the ratio of mean squares."""
    check = only(held_out(evidence(SURE, later=evaluation(np.eye(1), scale=scale, logs=logs))))
    assert (check.name, check.passed, check.effect) == ("held out", passed, "one")
    gain = BLOCKS * PER_PART * np.log(1.0 / scale)
    assert gains(gain) in check.sentence


@pytest.mark.parametrize(("logs", "passed"), [(1e-3, False), (-1e-3, True)])
def test_deviations_count_in_the_part_held_out(logs: float, passed: bool) -> None:
    check = only(held_out(evidence(SURE, later=evaluation(np.eye(1), logs=logs))))
    assert check.passed is passed
    assert gains(-2 * BLOCKS * PER_PART * logs) in check.sentence


def test_a_filter_that_lost_the_part_held_out_confirms_nothing() -> None:
    lost = replace(evaluation(np.eye(1)), power=np.full(BLOCKS, np.nan))
    assert not only(held_out(evidence(SURE, later=lost))).passed


@pytest.mark.parametrize(("deviations_below", "passed"), [(3.08, True), (3.10, False), (-50.0, True)])
def test_a_coefficient_that_physics_makes_positive_may_not_be_negative(deviations_below: float, passed: bool) -> None:
    """Its deviation is a tenth."""
    at = replace(SURE, model=replace(SURE.model, theta=np.array([0.0, 0.0, -0.1 * deviations_below])))
    check = only(sign(evidence(at)))
    assert (check.name, check.passed, check.effect) == ("sign", passed, "one")
    assert ("below zero" in check.sentence) is (deviations_below > 0.0)


def test_a_coefficient_of_either_sign_has_no_check_of_its_sign() -> None:
    free = model("many", theta=[0, 0, -9.0, 9.0], seen=evaluation(100.0 * np.eye(4)), prior=[1.0, 1.0, 1e3, 1e3])
    assert sign(evidence(free)) == []


@pytest.mark.parametrize(("off", "passed"), [(4.49, True), (4.51, False), (-4.51, False), (-4.49, True)])
def test_a_constant_may_not_be_far_from_what_the_bench_declares(off: float, passed: bool) -> None:
    """A record that says the constant exactly leaves the declared deviation alone."""
    known = model(theta=[0.0, 0.2 * off], seen=evaluation(1e12 * np.eye(2)), prior=[1.0, 0.2])
    one, other = prior(evidence(known))
    assert (one.passed, other.passed, other.name, other.effect) == (True, passed, "prior", "")
    assert f"b1 is {abs(off):.3g} of its declared deviations from the declared 0" in other.sentence
    said = "0.902" if off > 0.0 else "−0.902"
    assert (f"the record says {said}" in other.sentence, "correct the bench file" in other.sentence) == (
        not passed,
    ) * 2


@pytest.mark.parametrize(("off", "passed"), [(6.3, True), (6.5, False)])
def test_a_constant_of_which_the_record_says_little_may_be_further_off(off: float, passed: bool) -> None:
    """Its own deviation as large as the declared one, less what the prior adds: 4.5 times √2 of both."""
    vague = model(theta=[0.0, 0.2 * off], seen=evaluation(np.diag([1e12, 1e-9])), prior=[1.0, 0.2])
    assert prior(evidence(vague))[1].passed is passed


def test_a_coefficient_of_an_effect_has_no_declared_value() -> None:
    assert [check.name for check in prior(evidence(SURE))] == ["prior", "prior"]


@pytest.mark.parametrize(("share", "passed"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("coefficients", [1, 2])
def test_an_effect_has_to_be_there_all_along(share: float, passed: bool, coefficients: int) -> None:
    """Scores of the parts that alternate about zero, as large as the limit has them: twice the quantile that noise
    passes once in 1,000.
    """
    name, k = ("one", 3) if coefficients == 1 else ("many", 4)
    freedom = coefficients * (BLOCKS - 1)
    ratio = share * 2.0 * chi2.isf(1e-3, freedom) / freedom
    information = 60.0 * np.eye(k)
    information[0, 2:] = information[2:, 0] = 30.0
    own = 60.0 * np.eye(coefficients) - 15.0
    root = np.linalg.cholesky(own)[:, 0]
    score = np.zeros((BLOCKS, k))
    left = np.outer(np.resize([1.0, -1.0], BLOCKS), root) * np.sqrt(coefficients * ratio / BLOCKS)
    score[:, 0] = np.linspace(-3.0, 5.0, BLOCKS)  # of a parameter beside it, half of which the effect's would show
    score[:, 2:] = left + 0.5 * score[:, :1]
    scale = 1.7
    seen = evaluation(scale * information, scale * score, scale)
    fitted = model(name, theta=[0.0] * k, seen=seen, prior=[1e9] * k)
    check = only(constancy(evidence(fitted)))
    assert (check.name, check.passed, check.effect) == ("constancy", passed, name)
    assert f"scatter by {ratio:.3g} × noise" in check.sentence


@pytest.mark.parametrize(("ratio", "passed"), [(1.099, True), (1.101, False), (0.5, True), (np.nan, False)])
def test_a_model_leaves_no_more_than_the_noise_floor(ratio: float, passed: bool) -> None:
    check = only(floor(evidence(SURE, ratio=ratio)))
    assert (check.name, check.passed, check.effect) == ("noise floor", passed, "")
    assert f"{ratio:.4g} × the noise floor" in check.sentence


@pytest.mark.parametrize(("share", "passed"), [(0.0199, True), (0.0201, False), (-0.3, True)])
@pytest.mark.parametrize("by_logs", [False, True])
def test_no_disturbance_may_explain_a_part_of_the_innovation(share: float, passed: bool, by_logs: bool) -> None:
    """By a smaller mean square, or by as much smaller variances."""
    quiet = evaluation(np.eye(1), scale=2.0)
    logs = 0.5 * np.log(1.0 - share) if by_logs else 0.0
    disturbed = evaluation(np.eye(1), scale=2.0 if by_logs else 2.0 * (1.0 - share), logs=logs)
    check = only(disturbance(evidence(SURE, quiet=quiet, disturbed=disturbed)))
    assert (check.name, check.passed, check.effect) == ("disturbance", passed, "")
    assert f"explains {share:.2%} of the innovation's power" in check.sentence


@pytest.mark.parametrize(("share", "passed"), [(0.0, True), (0.002, False)])
def test_an_error_of_a_few_samples_is_no_noise(share: float, passed: bool) -> None:
    """A five-hundredth of the samples is twenty times as large: 1.3 × by the rms, and one channel is enough."""
    rng = np.random.default_rng(5)
    left = rng.standard_normal((20_000, 2)) * [1e-4, 3e-4]
    hit = np.flatnonzero(rng.random(20_000) < share)
    left[hit, 1] = 40.0 * 3e-4
    left[7] = np.nan
    later = replace(evaluation(np.eye(1)), innovation=left, deviation=np.full((20_000, 2), [1e-4, 3e-4]))
    seen = replace(evidence(SURE, later=later), of=replace(OF, axes=2))
    check = only(outliers(seen))
    assert (check.name, check.passed, check.effect) == ("outliers", passed, "")
    said = "of 19999 samples held out, " + (f"{len(hit)} are far outside the noise" if len(hit) else "")
    assert check.sentence.startswith(said) is not passed
    assert passed or check.sentence.endswith(f"the first {hit[0]} samples behind the start of that part")
    assert outliers(evidence(SURE, later=later)) == []  # of a single axis


def test_normal_noise_has_outliers_as_seldom_as_stated() -> None:
    """Of so few samples that the floor's tenth alone would not let them through."""
    rng, failed = np.random.default_rng(6), 0
    for _ in range(300):
        left = rng.standard_normal((60, 2))
        later = replace(evaluation(np.eye(1)), innovation=left, deviation=np.ones((60, 2)))
        failed += not only(outliers(replace(evidence(SURE, later=later), of=replace(OF, axes=2)))).passed
    assert failed <= 1


def test_deviations_are_the_posterior_s_and_wider_where_estimates_scatter() -> None:
    information = np.array([[50.0, 10.0, 0.0], [10.0, 40.0, 5.0], [0.0, 5.0, 30.0]])
    widths = np.array([0.2, 0.3, 0.1])
    inverse = np.linalg.inv(information / 2.0 + np.diag(widths**-2.0))
    steady = model("one", theta=[0, 0, 0], seen=evaluation(information, None, 2.0), prior=widths.tolist())
    assert steady.covariance == pytest.approx(inverse)
    assert steady.deviations == pytest.approx(np.sqrt(np.diag(inverse)))
    score = np.random.default_rng(2).standard_normal((BLOCKS, 3)) @ np.diag([60.0, 4.0, 0.1]) + [3.0, 0.0, 0.0]
    seen = evaluation(information, score, 2.0)
    sandwich = inverse @ (np.cov(score.T / 2.0) * BLOCKS) @ inverse
    wide = model("one", theta=[0, 0, 0], seen=seen, prior=widths.tolist())
    found = wide.covariance
    assert np.diag(found) == pytest.approx(np.maximum(np.diag(sandwich), np.diag(inverse)))
    assert np.diag(sandwich)[0] > 2.0 * np.diag(inverse)[0]
    assert np.diag(sandwich)[2] < np.diag(inverse)[2]
    spread, plain = np.sqrt(np.diag(found)), np.sqrt(np.diag(inverse))
    assert found / np.outer(spread, spread) == pytest.approx(inverse / np.outer(plain, plain))


def test_every_check_is_listed_and_says_what_it_is() -> None:
    assert (held_out, sign, prior, constancy, floor, disturbance, outliers, reference) == CHECKS
    names = [check.name for checker in CHECKS for check in checker(evidence(SURE))]
    assert list(dict.fromkeys(names)) == ["held out", "sign", "prior", "constancy", "noise floor", "disturbance"]
