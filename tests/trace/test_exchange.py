"""A candidate in place of an effect, against least squares of both models."""

import numpy as np
import pytest

from estimator.trace.exchange import Exchange, exchange_test
from estimator.trace.fit import FittedModel
from tests.trace.linear import Linear, fitted, made
from tests.trace.plain import Array

N = 2000


def drawn(seed: int) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    series = {
        "one": rng.standard_normal((N, 1)),
        "two": rng.standard_normal((N, 2)),
        "far": rng.standard_normal((N, 1)),
    }
    series["mixed"] = series["one"] + series["two"] @ np.array([[0.5], [0.3]]) + 0.4 * rng.standard_normal((N, 1))
    series["same"] = 3.0 * series["one"]
    return series


def squares(of: Linear, *names: str) -> tuple[float, Array]:
    """What least squares with these effects leaves, and its parameters."""
    used = np.column_stack([of.base, *(of.columns[name] for name in names)])
    theta, *_ = np.linalg.lstsq(used, of.y, rcond=None)
    return float(np.sum((of.y - used @ theta) ** 2)), np.array(theta, dtype=np.float64)


def exchanges(of: Linear, model: FittedModel, *candidates: str) -> dict[str, dict[str, Exchange]]:
    names = list(model.model.effects)
    tests = exchange_test(of, model, {key: {} for key in candidates}, names)
    return {name: {one.name: one for one in tests[name]} for name in names}


@pytest.mark.parametrize(("name", "other"), [("one", "two"), ("two", "one")])
@pytest.mark.parametrize("candidate", ["far", "mixed"])
def test_loss_size_and_parameters_are_those_of_least_squares(name: str, other: str, candidate: str) -> None:
    of = made(drawn(1), {"one": [0.3], "two": [0.2, -0.1]})
    model = fitted(of, "one", "two")
    found = exchanges(of, model, "far", "mixed")[name][candidate]
    best, _ = squares(of, "one", "two")
    left, theta = squares(of, other, candidate)
    assert found.loss == pytest.approx(N * np.log(left / best), rel=1e-4)
    kept = [k for k, owner in enumerate(model.layout.owner) if owner != name]
    assert found.theta[kept] == pytest.approx(theta[: len(kept)], abs=1e-5)
    assert found.size == pytest.approx(theta[len(kept) :], abs=1e-5)
    used = np.column_stack([of.base, of.columns[other], of.columns[candidate]])
    spread = np.sqrt(best / N * np.diagonal(np.linalg.inv(used.T @ used)))
    assert found.deviation == pytest.approx(spread[len(kept) :], rel=1e-3)


def test_the_smallest_loss_is_first_and_that_of_the_same_effect_is_none() -> None:
    of = made(drawn(1), {"one": [0.3], "two": [0.2, -0.1]})
    found = exchange_test(of, fitted(of, "one", "two"), {"far": {}, "same": {}, "mixed": {}}, ["one"])["one"]
    assert [one.name for one in found] == ["same", "mixed", "far"]
    assert found[0].loss == pytest.approx(0.0, abs=1e-3)
    assert found[0].size == pytest.approx(fitted(of, "one", "two").model.theta[2:3] / 3.0, rel=1e-4)
    assert found[0].likeness == pytest.approx(1.0)


def test_likeness_is_the_canonical_correlation_beside_all_others() -> None:
    of = made(drawn(1), {"one": [0.3], "two": [0.2, -0.1]})
    found = exchanges(of, fitted(of, "one", "two"), "far", "mixed")
    for name, other in (("one", "two"), ("two", "one")):
        beside = np.column_stack([of.base, of.columns[other]])
        for candidate in ("far", "mixed"):
            x, y = (
                np.linalg.qr(one - beside @ np.linalg.lstsq(beside, one, rcond=None)[0])[0]
                for one in (of.columns[name], of.columns[candidate])
            )
            assert found[name][candidate].likeness == pytest.approx(np.linalg.svd(x.T @ y)[1][0], abs=1e-6)


def test_what_was_found_first_but_is_not_it_loses_less_than_nothing() -> None:
    """The candidate explains more than what it takes the place of."""
    of = made(drawn(1), {"one": [0.3]})
    model = fitted(of, "mixed")
    found = exchanges(of, model, "one")["mixed"]["one"]
    assert found.loss == pytest.approx(N * np.log(squares(of, "one")[0] / squares(of, "mixed")[0]), rel=1e-4)
    assert found.loss < -10.0
