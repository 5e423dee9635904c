"""Effects that a check rejects are taken out again, one after another (docs/reference/trace.md, checks)."""

from collections.abc import Collection
from types import SimpleNamespace
from typing import Any

import pytest

from estimator.diagnosis import Verdict
from estimator.trace import trace as room
from estimator.trace.likelihood import Check
from estimator.trace.verdict import Judged

GAINS = {"a": 900.0, "b": 50.0, "c": 400.0}


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What is judged in the end, where effects of each model are rejected, and the models that leave something."""

    def run(rejected: dict[str, Collection[str]], left: Collection[str] = ()) -> Judged:
        nothing: Any = None

        def of(model: Any) -> Judged:
            without = {name: model.replace(name, "") for name in model}
            fitted = SimpleNamespace(name=model, gain_over=lambda less: GAINS[(set(model) - set(less)).pop()])
            checks = [Check("held out", name not in rejected.get(model, ()), f"of {name}", name) for name in model]
            checks.append(Check("noise floor", model not in left, "the floor"))
            evidence: Any = SimpleNamespace(model=fitted, without=without)
            return Judged(evidence, checks, nothing, None, {})

        monkeypatch.setattr(room, "settle", lambda of, model: model)
        monkeypatch.setattr(room, "finished", lambda of, model: model)
        chosen: Any = SimpleNamespace(of=None, before="", after="abc")
        return room.judge(chosen, of)

    return run


def test_what_passes_stays_as_it_was_chosen(judged: Any) -> None:
    found = judged({})
    assert (found.named, found.verdict, found.failed) == (["a", "b", "c"], Verdict.EXPLAINED, {})


def test_the_rejected_effect_that_gains_least_goes_first(judged: Any) -> None:
    found = judged({"abc": "bc"})
    assert (found.named, found.verdict) == (["a", "c"], Verdict.EXPLAINED)
    assert found.failed["b"].sentence == "of b"
    assert found.failed["b"].model.name == "abc"


def test_without_its_last_effect_a_model_that_leaves_nothing_is_adequate(judged: Any) -> None:
    """A coefficient that chance made; it may be as large as it was fitted."""
    found = judged({"abc": "abc", "ac": "ac", "a": "a"})
    assert (found.named, found.verdict, set(found.failed)) == ([], Verdict.ADEQUATE, {"a", "b", "c"})


def test_where_nothing_stands_the_model_as_chosen_is_the_best_candidate(judged: Any) -> None:
    found = judged({"abc": "b", "ac": "ac", "a": "a"}, left=[""])
    assert (found.named, found.verdict, found.failed) == (["a", "b", "c"], Verdict.UNEXPLAINED, {})


def test_what_is_left_beside_the_rest_leaves_it_a_part(judged: Any) -> None:
    found = judged({"abc": "b"}, left=["ac"])
    assert (found.named, found.verdict) == (["a", "c"], Verdict.PARTLY)
