"""The variance decomposition beside closed forms, an analysis of variance written out, and noise alone."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest

from hil.sweeping.columns import schema
from hil.sweeping.dependence import Dependence, dependence
from hil.sweeping.page import render
from hil.sweeping.plan import Plan
from tests.campaigns.small import plan, small

Floats = npt.NDArray[np.float64]
KEYS = ("scenario.sense.noise_V", "scenario.rate.rate_rad_s", "scenario.truth.temperature_K")


def drawn(points: int, kind: str = "latin_hypercube", seeds: int = 1) -> Plan:
    vary: list[dict[str, Any]] = [{"key": key, "low": 1.0, "high": 2.0} for key in KEYS]
    return plan(small(vary=vary, seeds=seeds, design={"kind": kind, "points": points}))


def found_in(made: Plan, values: Floats) -> Dependence:
    point = np.array([one.point for one in made.runs()])
    found = dependence(made, pa.table({"point": point, "y": values}), "y")
    assert found is not None
    return found


def uniform(made: Plan) -> Floats:
    """Each key of each run on −1 … 1."""
    return 2.0 * np.array([[one.values[key.rpartition(".")[2]] for key in KEYS] for one in made.runs()]) - 3.0


@pytest.mark.moderate
@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_shares_of_a_polynomial_are_those_of_the_closed_form(kind: str) -> None:
    """Of a + b u + c v + d u v + e w² with u, v, w uniform on −1 … 1 the variances are b²/3, c²/3, d²/9, 4 e²/45."""
    made = drawn(512, kind)
    u, v, w = uniform(made).T
    b, c, d, e = 1.0, -2.0, 3.0, 1.5
    y = b * u + c * v + d * u * v + e * w**2 - 20.0
    parts = {("noise_V",): b**2 / 3, ("rate_rad_s",): c**2 / 3, ("noise_V", "rate_rad_s"): d**2 / 9}
    parts[("temperature_K",)] = 4 * e**2 / 45
    found = found_in(made, y)
    shares = {one.keys: one.share for one in (*found.keys, *found.pairs)}
    for keys, variance in parts.items():
        assert shares[keys] == pytest.approx(variance / sum(parts.values()), abs=0.01), keys
    assert shares[("noise_V", "temperature_K")] < 0.003
    assert found.predicted > 0.999
    assert not found.logarithmic
    assert found.keys[0].keys == ("rate_rad_s",)
    assert found.keys[0].first is not None
    assert found.keys[0].last is not None
    assert found.keys[0].first > found.keys[0].last  # c is negative


def test_over_a_full_grid_it_is_the_analysis_of_variance() -> None:
    levels = (3, 2, 4)
    vary = [{"key": key, "low": 1.0, "high": 2.0, "levels": n} for key, n in zip(KEYS, levels, strict=True)]
    made = plan(small(vary=vary, seeds=3))
    y = np.random.default_rng(3).standard_normal(levels) + 5.0 * np.arange(3)[:, None, None] * np.arange(2)[:, None]
    found = found_in(made, np.repeat((y - 30.0).ravel(), 3))
    total = y.var()
    main = [y.mean(axis=tuple(set(range(3)) - {k})).var() for k in range(3)]
    pair = y.mean(axis=2).var() - main[0] - main[1]
    a = {one.keys: one for one in (*found.keys, *found.pairs)}
    assert a[("noise_V",)].share == pytest.approx(main[0] / total, abs=0.03)
    assert a[("noise_V", "rate_rad_s")].share == pytest.approx(pair / total, abs=0.03)
    assert found.explained == pytest.approx(1.0 - (y - sum_of_effects(y)).var() / total, abs=1e-9)


def sum_of_effects(y: Floats) -> Floats:
    """Mean, main effects and effects of pairs of a three-way table, by means."""
    pairs = [y.mean(axis=k, keepdims=True) for k in range(3)]
    mains = [y.mean(axis=tuple(set(range(3)) - {k}), keepdims=True) for k in range(3)]
    fitted: Floats = pairs[0] + pairs[1] + pairs[2] - mains[0] - mains[1] - mains[2] + y.mean()
    return fitted


@pytest.mark.moderate
def test_noise_alone_gives_no_key_and_says_that_it_predicts_nothing() -> None:
    made = drawn(128)
    named, predicted = 0, []
    for seed in range(40):
        found = found_in(made, np.random.default_rng(seed).standard_normal(128))
        named += sum(one.clear for one in found.keys)
        predicted.append(found.predicted)
    assert named <= 12  # of 120: one-sided at 2.5 %, of sums that are skewed
    assert np.median(predicted) < 0.0


@pytest.mark.moderate
def test_intervals_hold_the_true_share() -> None:
    """u + noise of the same variance: a share of one half, held by about 57 of 60 intervals."""
    made = drawn(128)
    u = uniform(made)[:, 0]
    held = 0
    for seed in range(60):
        noise = np.random.default_rng(seed).standard_normal(128) / np.sqrt(3.0)
        share = next(one for one in found_in(made, u + noise - 9.0).keys if one.keys == ("noise_V",))
        held += share.interval[0] <= 0.5 <= share.interval[1]
    assert 50 <= held <= 60


def test_what_is_positive_is_taken_by_its_logarithm() -> None:
    made = drawn(64)
    u, v, _ = uniform(made).T
    found = found_in(made, 10.0 ** (2.0 * u + v))
    assert found.logarithmic
    shares = {one.keys: one.share for one in found.keys}
    assert shares[("noise_V",)] == pytest.approx(0.8, abs=0.01)
    ends = next(one for one in found.keys if one.keys == ("noise_V",))
    assert ends.last is not None
    assert ends.first is not None
    assert ends.last / ends.first == pytest.approx(10.0 ** (2.0 * 4.0 / 3.0), rel=0.15)  # means of the outer thirds


@pytest.mark.moderate
def test_runs_of_one_point_tell_what_seeds_alone_do() -> None:
    made = drawn(64, seeds=4)
    u = uniform(made)[:, 0]
    y = u + np.random.default_rng(0).standard_normal(256) / np.sqrt(3.0) - 9.0
    found = found_in(made, y)
    assert found.between_seeds == pytest.approx(0.5, abs=0.08)


def test_missing_figures_are_counted_and_constant_ones_have_no_shares() -> None:
    made = drawn(64)
    y = uniform(made)[:, 0] - 9.0
    y[:5] = np.nan
    assert found_in(made, y).left_out == 5
    point = np.arange(64)
    assert dependence(made, pa.table({"point": point, "y": np.full(64, 3.0)}), "y") is None
    assert dependence(made, pa.table({"point": point, "y": np.full(64, np.nan)}), "y") is None
    assert dependence(plan(small(vary=[])), pa.table({"point": [0, 0], "y": [1.0, 2.0]}), "y") is None


def test_a_key_of_a_single_value_is_not_listed_and_changes_no_share() -> None:
    """The shares of the others are those of the campaign in which the key is fixed."""
    two: list[dict[str, Any]] = [{"key": KEYS[0], "values": [1.0, 2.0, 3.0]}, {"key": KEYS[1], "values": [1.0, 2.0]}]
    one = {"key": KEYS[2], "values": [300.0]}
    y = np.random.default_rng(8).standard_normal(24)
    without = found_in(plan(small(vary=two, seeds=4)), y)
    found = found_in(plan(small(vary=[two[0], one, two[1]], seeds=4)), y)
    assert found == without
    assert {key for entry in (*found.keys, *found.pairs) for key in entry.keys} == {"noise_V", "rate_rad_s"}
    assert dependence(plan(small(vary=[one], seeds=24)), pa.table({"point": np.zeros(24, int), "y": y}), "y") is None


@pytest.mark.long
def test_the_report_of_very_many_runs_stays_a_page(tmp_path: Path) -> None:
    made = drawn(20_000)
    u, v, _ = uniform(made).T
    numbers = {"angle_error_rms_rad": 10.0 ** (u + 0.2 * v), "rate_error_rms_rad_s": 10.0**v}
    of_all = {"outcome": ["ran"] * 20_000, "run": np.arange(20_000), "point": np.arange(20_000)}
    varied = {key.rpartition(".")[2]: (column + 3.0) / 2.0 for key, column in zip(KEYS, uniform(made).T, strict=True)}
    fields = schema(made.campaign)
    known = of_all | varied | numbers
    table = pa.table([pa.array(known.get(one.name, [None] * 20_000), type=one.type) for one in fields], schema=fields)
    page = render(made, tmp_path, table)
    assert len(page) < 1_500_000
    assert "20\u202f000 runs are done" in page
    assert "depends mostly on noise_V and rate_rad_s" in page
