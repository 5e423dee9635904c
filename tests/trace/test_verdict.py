"""The word for what the checks say: every combination of them."""

from itertools import product

import numpy as np
import pytest

from estimator.diagnosis import Finding, Fit, Found, Verdict
from estimator.trace.checks import Evidence
from estimator.trace.examination import Figures
from estimator.trace.likelihood import Check
from estimator.trace.verdict import Judged, answer, verdict_of

OF_MODEL, OF_EFFECT = ("prior", "noise floor", "disturbance"), ("held out", "sign", "constancy")


@pytest.mark.parametrize(("prior", "floor", "disturbance"), list(product([True, False], repeat=3)))
def test_without_a_name_all_checks_decide(prior: bool, floor: bool, disturbance: bool) -> None:
    """A residual that is no more than noise is not adequate with a constant that the device cannot have."""
    checks = [Check(name, passed, "") for name, passed in zip(OF_MODEL, (prior, floor, disturbance), strict=True)]
    expected = Verdict.ADEQUATE if prior and floor and disturbance else Verdict.UNEXPLAINED
    assert verdict_of([], checks) is expected


@pytest.mark.parametrize("of_model", list(product([True, False], repeat=3)))
@pytest.mark.parametrize("of_effect", list(product([True, False], repeat=3)))
def test_with_a_name_all_checks_decide(of_model: tuple[bool, ...], of_effect: tuple[bool, ...]) -> None:
    """One of an effect that fails takes the name back; one of the model that fails leaves something to be named."""
    checks = [Check(name, passed, "") for name, passed in zip(OF_MODEL, of_model, strict=True)]
    checks += [Check(name, passed, "", "drag") for name, passed in zip(OF_EFFECT, of_effect, strict=True)]
    expected = Verdict.UNEXPLAINED if not all(of_effect) else Verdict.EXPLAINED if all(of_model) else Verdict.PARTLY
    assert verdict_of(["drag"], checks) is expected
    assert verdict_of(["drag"], checks[::-1]) is expected


@pytest.mark.parametrize(("share", "expected"), [(None, "partly"), (0.51, "partly"), (0.49, "unexplained")])
def test_a_part_is_more_than_half_of_the_power_above_the_floor(share: float | None, expected: str) -> None:
    found = verdict_of(["drag"], [Check("noise floor", False, "")], share)
    assert found is {"partly": Verdict.PARTLY, "unexplained": Verdict.UNEXPLAINED}[expected]


def test_no_check_at_all_is_none_that_failed() -> None:
    assert verdict_of([], []) is Verdict.ADEQUATE
    assert verdict_of(["drag"], []) is Verdict.EXPLAINED


@pytest.mark.parametrize(("check", "told"), [(True, ("after",)), (False, ())])
def test_what_an_explained_residual_still_holds_is_told(check: bool, told: tuple[str, ...]) -> None:
    """Too little for a check to fail is not nothing; of effects that are not confirmed nothing is left."""

    def figures(said: str) -> Figures:
        fit = Fit((1.0,), (1.0,), 1.0, 1.0)
        return Figures(fit, fit, (Finding("line", said, 1.0, 9.0),), np.zeros((2, 1)))

    evidence = object.__new__(Evidence)
    object.__setattr__(evidence, "without", {"drag": None})
    judged = Judged(evidence, [Check("held out", check, "", "drag")], figures("after"), 1.0, {})
    found = Found("drag", "drag", "", {}, 1.0, "")
    given = answer(judged, (figures("before"), figures("after")), (found,))
    assert tuple(one.text for one in given.left) == told
