"""The word for what the checks say: every combination of them."""

from itertools import product

import pytest

from estimator.diagnosis import Verdict
from estimator.trace.likelihood import Check
from estimator.trace.verdict import verdict_of

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
