"""The score test against least squares: Frisch and Waugh's theorem says gain and size in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from estimator.trace import score_test as room
from estimator.trace.score_test import Score, score_test
from tests.trace.linear import Linear, effect, fitted, made
from tests.trace.plain import Array

N = 2000


def columns(seed: int = 1) -> dict[str, Array]:
    rng = np.random.default_rng(seed)
    return {"one": rng.standard_normal((N, 1)), "two": rng.standard_normal((N, 2)), "far": rng.standard_normal((N, 1))}


def called(table: tuple[Score, ...], name: str) -> Score:
    (found,) = (score for score in table if score.name == name)
    return found


def left(of: Linear, a: Array) -> Array:
    """What least squares on the base columns leaves of columns."""
    return np.asarray(a - of.base @ np.linalg.lstsq(of.base, a, rcond=None)[0])


@pytest.mark.parametrize("name", ["one", "two", "far"])
def test_gain_and_size_are_those_of_least_squares(name: str) -> None:
    series = columns()
    of = made(series, {"one": [0.3], "two": [0.2, -0.1]})
    of = replace(of, base=of.base + 0.5 * series["two"])
    table = score_test(of, fitted(of), {key: {} for key in series})
    found = called(table, name)
    y, x = left(of, of.y), left(of, series[name])
    size = np.linalg.lstsq(x, y, rcond=None)[0]
    variance = y @ y / N
    assert found.size == pytest.approx(size, rel=1e-5)
    assert found.gain == pytest.approx((y @ y - np.sum((y - x @ size) ** 2)) / variance, rel=1e-5)
    assert found.deviation == pytest.approx(np.sqrt(np.diag(np.linalg.inv(x.T @ x)) * variance), rel=1e-5)
    assert [score.gain for score in table] == sorted((score.gain for score in table), reverse=True)


@pytest.mark.parametrize("truth", [[0.2, -0.3], [-0.2, 0.3], [-0.1, -0.3], [0.2, 0.1]])
def test_sizes_that_are_never_negative_are_those_of_nnls(truth: list[float]) -> None:
    series = {"two": columns()["two"] @ np.array([[1.0, 0.8], [0.0, 0.6]])}
    of = made(series, {"two": truth}, positive=True)
    (found,) = score_test(of, fitted(of), {"two": {}})
    y, x = left(of, of.y), left(of, series["two"])
    size, norm = nnls(x, y)
    assert found.size == pytest.approx(size, rel=1e-5, abs=1e-9)
    assert found.gain == pytest.approx((y @ y - norm**2) / (y @ y / N), rel=1e-5, abs=1e-9)


def test_a_prior_as_tight_as_the_record_halves_a_size() -> None:
    """Two equal sources of information about one number, of which one says 0."""
    series = columns()
    of = made(series, {"one": [0.5]})
    wide = score_test(of, fitted(of), {"one": {}})[0]
    tight = effect("one", 1, plausible=float(wide.deviation[0]))
    found = score_test(replace(of, declared={**of.declared, "one": tight}), fitted(of), {"one": {}})[0]
    assert found.size == pytest.approx(wide.size / 2, rel=1e-5)
    assert found.gain == pytest.approx(wide.gain / 2, rel=1e-5)
    assert found.deviation == pytest.approx(wide.deviation / np.sqrt(2), rel=1e-5)


def test_projecting_out_parameters_keeps_their_prior() -> None:
    """A base column that is known for certain takes nothing of an effect that is the same."""
    of = made({"one": columns()["one"]}, {"one": [0.5]})
    of = replace(of, base=np.column_stack([of.base, of.columns["one"] + 1e-3 * columns(7)["far"]]))
    model = fitted(of)
    free = score_test(of, model, {"one": {}})[0]
    model.layout.deviation[2] = 1e-6
    held = score_test(of, replace(model, model=replace(model.model, theta=model.model.theta * [1, 1, 0])), {"one": {}})
    assert abs(free.size[0]) < 5 * free.deviation[0]
    assert held[0].deviation[0] < 0.01 * free.deviation[0]


def test_inseparable_effects_have_a_gain_and_no_size() -> None:
    """Two columns that are one: the information is singular, the prior of each decides."""
    one = columns()["one"]
    of = made({"pair": np.hstack([one, one])}, {"pair": [0.5, 0.0]})
    table = score_test(of, fitted(of), {"pair": {}})
    x, y = left(of, one), left(of, of.y)
    assert table[0].gain == pytest.approx(float((x.T @ y)[0] ** 2 / (x.T @ x)[0, 0]) * N / (y @ y), rel=1e-3)


def test_scores_of_noise_scatter_by_one_and_of_a_passing_effect_by_more() -> None:
    of = made({f"e{k}": np.random.default_rng(k).standard_normal((N, 1)) for k in range(60)}, {})
    scatter = [score.scatter for score in score_test(of, fitted(of), {key: {} for key in of.columns})]
    # Of 24 parts whose mean is taken off, a chi-square of 23 over its number of parts.
    assert np.mean(scatter) == pytest.approx(23 / 24, abs=4 * np.sqrt(2 / 24 / 60))
    half = of.columns["e0"] * (np.arange(N) < N / 2)[:, None]
    found = score_test(replace(of, y=of.y + half[:, 0]), fitted(of), {"e0": {}})[0]
    assert found.scatter > 3.0
    assert found.robust == pytest.approx(found.gain / found.scatter)
    assert replace(found, scatter=0.5).robust == found.gain


def test_effects_go_into_as_many_passes_as_the_filter_has_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "MAX_EFFECTS", 9)
    of = made(
        {f"e{k}": np.random.default_rng(k).standard_normal((N, 1 + k % 2)) for k in range(20)}, {"e7": [1.0, 0.5]}
    )
    seen: list[int] = []

    class Counted(Linear):
        def evaluate(self, layout, model, *, derivatives=True, tested=None):  # type: ignore[no-untyped-def]
            seen.append(len(tested or {}))
            return super().evaluate(layout, model, derivatives=derivatives, tested=tested)

    counted, model = Counted(**vars(of)), fitted(of)
    table = score_test(counted, model, {key: {} for key in of.columns})
    assert sorted(seen) == [2, 9, 9]
    assert len(table) == 20
    for name in of.columns:
        alone = score_test(of, model, {name: {}})[0]
        found = called(table, name)
        assert found.gain == pytest.approx(alone.gain, rel=1e-9)
        assert found.size == pytest.approx(alone.size, rel=1e-9)
    assert table[0].name == "e7"


def test_nothing_to_test_gives_an_empty_table() -> None:
    of = made({}, {})
    assert score_test(of, fitted(of), {}) == ()


def test_an_effect_without_a_signature_gains_nothing() -> None:
    of = made({"silent": np.zeros((N, 1))}, {})
    found = score_test(of, fitted(of), {"silent": {}})[0]
    assert (found.gain, *found.size) == (0.0, 0.0)
