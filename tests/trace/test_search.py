"""The search on records that are linear in every parameter: its threshold, its ways forward and back, its groups."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.trace import ambiguity
from estimator.trace import search as search_module
from estimator.trace.ambiguity import exchanged, members
from estimator.trace.fit import at
from estimator.trace.score_test import Score
from estimator.trace.search import backward, margin, search, shortlisted, with_effect, without_effect
from tests.trace.linear import Linear, effect, fitted, made
from tests.trace.plain import Array

N = 2000


def orthogonal(**gains: tuple[int, float]) -> Linear:
    """A record to which each effect of so many coefficients brings so much of twice the log-likelihood."""
    rng = np.random.default_rng(6)
    width = 3 + sum(count for count, _ in gains.values())
    q = np.linalg.qr(rng.standard_normal((N, width)))[0] * np.sqrt(N)
    y, left = q[:, 0].copy(), float(N)
    columns, at_column = {}, 3
    for name, (count, _) in gains.items():
        columns[name], at_column = q[:, at_column : at_column + count], at_column + count
    for name, (_, gain) in reversed(gains.items()):
        more = left * np.expm1(gain / N)  # n ln((left + more)/left) is the gain
        y, left = y + columns[name][:, 0] * np.sqrt(more / N), left + more
    return Linear(y, q[:, 1:3], columns, {name: effect(name, one.shape[1]) for name, one in columns.items()})


def test_the_margin_is_bonferronis() -> None:
    """40 kinds, once in a thousand: 2 ln 40,000; by tables of logarithms 2 (4 ln 10 + 2 ln 2)."""
    assert margin(40) == pytest.approx(2 * (4 * 2.302585 + 2 * 0.693147), abs=1e-5)
    assert margin(1) == pytest.approx(2 * 3 * 2.302585, abs=1e-5)


@pytest.mark.parametrize(("beyond", "taken"), [(0.3, ["b"]), (-0.3, [])])
@pytest.mark.parametrize("coefficients", [1, 3])
def test_an_effect_is_named_where_it_gains_more_than_its_price(
    beyond: float, taken: list[str], coefficients: int
) -> None:
    """ln n for each coefficient, and 2 ln(kinds/0.001)."""
    penalty = coefficients * np.log(N) + 2.0 * np.log(3 / 1e-3)
    found = search(orthogonal(a=(1, 1.0), b=(coefficients, penalty + beyond), c=(2, 2.0)))
    assert [list(one.base.model.effects) for one in found.rounds] == [[], taken][: 1 + len(taken)]
    assert found.rounds[0].table[0].name == "b"


def test_the_search_goes_on_while_something_gains_but_names_no_fifth() -> None:
    steps: list[tuple[str, int, int]] = []
    sizes = {f"e{k}": (1, 300.0 - 20.0 * k) for k in range(6)}
    found = search(orthogonal(**sizes), lambda *step: steps.append(step))
    assert list(found.best.model.effects) == ["e0", "e1", "e2", "e3"]
    assert steps == [("effects", k, 4) for k in range(4)]
    assert found.base.model.effects == {}
    assert [len(one.table) for one in found.rounds] == [6, 5, 4, 3]


def test_candidates_are_ranked_by_what_they_gain_less_what_they_cost() -> None:
    """Three coefficients gain more than one, by less than two cost."""
    found = search(orthogonal(a=(3, 80.0), b=(1, 79.0 - 2 * np.log(N) + 4.0)))
    assert [name for name, _ in found.rounds[0].fitted] == ["b", "a"]


def test_a_superfluous_effect_is_taken_out_again_and_one_that_pays_stays() -> None:
    of = orthogonal(a=(1, 60.0), b=(1, 20.0), c=(1, 50.0))
    least = backward(of, fitted(of, "a", "b", "c"), margin(3))
    assert list(least.model.effects) == ["a", "c"]
    assert list(backward(of, least, margin(3)).model.effects) == ["a", "c"]
    assert list(backward(of, fitted(of, "b"), margin(3)).model.effects) == []
    assert list(backward(of, fitted(of, "c"), margin(3)).model.effects) == ["c"]
    declared = replace(of, effects={"b": {}})
    assert list(backward(declared, fitted(declared, "b", "a", "c"), margin(3)).model.effects) == ["b", "a", "c"]


def test_a_search_takes_a_mixture_out_when_its_parts_are_in() -> None:
    """One that is a little of each of two others is first, and of no use beside both."""
    rng = np.random.default_rng(11)
    a, b, noise = (rng.standard_normal((N, 1)) for _ in range(3))
    of = made({"a": a, "b": b, "mixed": a + 0.6 * b + 0.5 * noise}, {"a": [1.0], "b": [1.0]})
    found = search(of)
    assert list(found.rounds[1].base.model.effects) == ["mixed"]
    assert sorted(found.best.model.effects) == ["a", "b"]


def test_the_model_without_an_effect_is_the_one_that_never_had_it() -> None:
    of = orthogonal(a=(1, 60.0), b=(2, 90.0))
    less = without_effect(of, fitted(of, "a", "b"), "b")
    alone = fitted(of, "a")
    assert less.layout.names == alone.layout.names
    assert less.model.theta == pytest.approx(alone.model.theta, abs=1e-6)


def test_an_effect_starts_at_the_score_test_s_size() -> None:
    of = orthogonal(a=(1, 60.0), b=(2, 90.0))
    base = fitted(of, "a")
    size = np.array([0.21, 0.0])
    score = Score("b", 90.0, size, size, 1.0, {})
    seen: list[Array] = []

    class Seen(Linear):
        def evaluate(self, layout, model, **given):  # type: ignore[no-untyped-def]
            seen.append(model.theta)
            return super().evaluate(layout, model, **given)

    with_effect(Seen(**vars(of)), base, score)
    assert seen[0] == pytest.approx([*base.model.theta, *size])
    worse = with_effect(of, base, replace(score, size=np.array([-500.0, 900.0])))
    assert worse.objective == pytest.approx(fitted(of, "a", "b").objective, abs=0.02)


def table(*gains: tuple[str, float]) -> tuple[Score, ...]:
    none = np.zeros(1)
    return tuple(Score(name, gain, none, none, 1.0, {}) for name, gain in gains)


def test_the_shortlist_has_the_best_of_each_kind() -> None:
    found = table(("a:1", 90.0), ("a:2", 80.0), ("b", 70.0), ("c", 60.0), ("d", 50.0))
    assert [one.name for one in shortlisted(found, 10.0)] == ["a:1", "b", "c"]
    assert [one.name for one in shortlisted(found, 70.0)] == ["a:1"]
    assert shortlisted((), 0.0) == []


def test_two_equal_effects_are_one_group_and_one_beside_them_is_not() -> None:
    rng = np.random.default_rng(12)
    a, c = rng.standard_normal((N, 1)), rng.standard_normal((N, 1))
    same = a + 0.02 * rng.standard_normal((N, 1))
    of = made({"a": a, "c": c, "far": 0.6 * a + rng.standard_normal((N, 1)), "same": same}, {"a": [0.5], "c": [0.4]})
    best = search(of).best
    assert sorted({"a", "same"} & set(best.model.effects)) == [name for name in best.model.effects if name != "c"]
    best, groups = exchanged(of, best)
    assert sorted(groups) == sorted(best.model.effects)
    group = groups[next(name for name in groups if name != "c")]
    assert [member.name for member in group] == [({"a", "same"} - set(groups)).pop()]
    assert 0.0 <= group[0].deficit < 9.0
    alone = np.linalg.qr(np.hstack([of.base, of.columns["c"]]))[0]
    x, y = (one - alone @ (alone.T @ one) for one in (a, same))
    assert group[0].likeness == pytest.approx(float((x.T @ y)[0, 0] / np.linalg.norm(x) / np.linalg.norm(y)), abs=1e-4)
    assert groups["c"] == []


@pytest.mark.parametrize(
    ("gain", "lost", "fitted_at_all"),
    [(400.0, 0.085, True), (400.0, 0.105, False), (40.0, 0.215, True), (40.0, 0.235, False)],
)
def test_a_candidate_within_a_tenth_of_the_gain_or_a_tie_is_fitted(
    gain: float, lost: float, fitted_at_all: bool
) -> None:
    """A share sin² of the angle between their columns is lost."""
    of = orthogonal(a=(1, gain), b=(1, 0.0))
    of.columns["b"] = np.sqrt(lost) * of.columns["b"] + np.sqrt(1.0 - lost) * of.columns["a"]
    found = members(of, fitted(of, "a"))
    assert {name: [member.name for member in group] for name, group in found.items()} == {
        "a": ["b"] if fitted_at_all else []
    }


def test_all_candidates_that_do_the_same_are_fitted_in_place_of_an_effect() -> None:
    of = orthogonal(a=(1, 400.0), **{f"b{k}": (1, 0.0) for k in range(6)})
    for k in range(6):
        of.columns[f"b{k}"] = of.columns["a"] + 0.01 * (k + 1) * of.columns[f"b{k}"]
    assert [member.name for member in members(of, fitted(of, "a"))["a"]] == [f"b{k}" for k in range(6)]


def test_a_model_gives_way_to_one_that_stands_better_in_its_place() -> None:
    """A member that is not the one found first, but better: as where the first was fitted to a beginning only."""
    rng = np.random.default_rng(13)
    a = rng.standard_normal((N, 1))
    of = made({"a": a, "worse": a + 0.5 * rng.standard_normal((N, 1))}, {"a": [0.6]})
    best, groups = exchanged(of, fitted(of, "worse"))
    assert list(best.model.effects) == ["a"]
    assert groups == {"a": []}


def test_a_model_stays_where_another_stands_better_only_half_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two models that each look better until they are fitted took one another's place for ever."""
    rng = np.random.default_rng(13)
    a = rng.standard_normal((N, 1))
    of = made({"a": a, "worse": a + 0.5 * rng.standard_normal((N, 1))}, {"a": [0.6]})

    def spoiled(of: Linear, half: Any) -> Any:
        return at(of, half.layout, replace(half.model, theta=half.model.theta + 1.0))

    monkeypatch.setattr(ambiguity, "settle", spoiled)
    best, groups = exchanged(of, fitted(of, "worse"))
    assert list(best.model.effects) == ["worse"]
    assert [member.name for member in groups["worse"]] == ["a"]


def test_an_effect_without_which_the_motion_is_lost_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """However little it seems to gain: nothing can be said of a model that the filter cannot follow."""
    model: Any = SimpleNamespace(model=SimpleNamespace(effects={"drive_delay": {}}))
    lost = SimpleNamespace(evaluation=SimpleNamespace(sound=False))
    monkeypatch.setattr(search_module, "gain_of", lambda *_: -1.0)
    monkeypatch.setattr(search_module, "without_effect", lambda *_: model)
    monkeypatch.setattr(search_module, "settle", lambda *_: lost)
    assert backward(SimpleNamespace(effects={}), model, 10.0) is model  # type: ignore[arg-type]
