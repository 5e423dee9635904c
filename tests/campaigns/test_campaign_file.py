"""The campaign file: mistakes named by file and key, the schema, and which runs it makes."""

import json
import math
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from scipy.stats import norm, qmc

from hil.bench import examples
from hil.errors import InputError
from hil.sweeping.design import plain, put, value_at
from hil.sweeping.plan import read_plan, toml_of
from tests.campaigns.small import plan, small

DOCS = Path(__file__).parents[2] / "docs" / "reference"
NOISE: dict[str, Any] = {"key": "scenario.sense.noise_V"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"vray": []}, "[vray]: unknown key; did you mean vary?"),
        ({"design": {"kind": "grids"}}, "[design] kind: 'grids' is not one of grid, latin_hypercube, sobol"),
        ({"design": {"kind": "sobol", "points": 100}}, "points: 100 is no power of two; give 64 or 128"),
        ({"design": {"kind": "latin_hypercube"}}, "points: missing; expected: how many points"),
        ({"design": {"points": 4}}, "points: a grid has as many as its levels make"),
        ({"vary": [NOISE]}, "takes either values, or low and high, or mean and sd"),
        ({"vary": [NOISE | {"values": [1e-5], "low": 1.0}]}, "takes either values, or low and high"),
        ({"vary": [NOISE | {"low": 2.0, "high": 1.0, "levels": 2}]}, "expected low below high"),
        ({"vary": [NOISE | {"low": 0.0, "high": 1.0, "levels": 2, "scale": "log"}]}, "has no logarithm"),
        ({"vary": [NOISE | {"low": 1e-5, "high": 1e-4}]}, "a grid needs values or levels"),
        ({"vary": [NOISE | {"values": [1e-5, "a"]}]}, "expected values of one sort"),
        ({"vary": [NOISE | {"values": [1e-5, 1e-5]}]}, "a value stands there twice"),
        ({"vary": [NOISE | {"values": [1e-5]}, NOISE | {"values": [1e-4]}]}, "noise_V is another's too"),
        ({"vary": [NOISE | {"values": [1e-5], "name": "run"}]}, "run is a column of the results"),
        ({"vary": [{"key": "sense.noise_V", "values": [1.0]}]}, "expected a key of `scenario.` or of `bench.`"),
        ({"vary": [{"key": "bench.loop.settel_s", "values": [0.1]}]}, "no such key; did you mean settle_s?"),
        ({"vary": [{"key": "bench.loop.settle_s", "values": [0.1]}]}, "bench.loop.settle_s: is set twice"),
        ({"vary": [{"key": "bench.observer.memory_s", "values": [-1.0]}]}, "memory_s: -1.0 should be greater than 0"),
        ({"fixed": {"bench.loop.settle_s": 99.0}}, "settle_s: 99 s leaves nothing to score"),
        ({"scenario": "s-slw"}, "no such scenario file, and no example of that name; did you mean s-slow?"),
        ({"report": {"figure": "angle_error_rms"}}, "no column 'angle_error_rms'; did you mean angle_error_rms_rad?"),
        ({"seeds": 0}, "[seeds]: 0 should be greater than or equal to 1"),
        ({"name": "a/b"}, "'a/b' is no name of a run"),
    ],
)
def test_a_mistake_is_one_line_with_file_and_key(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as raised:
        plan(small(**changes))
    line = str(raised.value)
    assert said in line
    assert "\n" not in line
    if "scenario" not in changes:
        assert line.startswith("small.toml: ")


def test_positions_beyond_a_list_and_what_is_no_number_are_told() -> None:
    table = {"truth": {"stiffness": [1.0, 2.0]}, "name": "x"}
    put(table, "truth.stiffness[1]", 3.0, strict=False)
    put(table, "sense.noise_V", 1.0, strict=False)
    assert table == {"truth": {"stiffness": [1.0, 3.0]}, "name": "x", "sense": {"noise_V": 1.0}}
    assert value_at(table, "truth.stiffness[0]") == 1.0
    assert value_at(table, "truth.damping") is None
    for key, said in (("truth.stiffness[2]", "of a list of 2"), ("name.first", "no table"), ("a b", "no key")):
        with pytest.raises(InputError, match=said):
            put(table, key, 0.0, strict=False)
    relative = {"key": "scenario.rate.kind", "low": 1.0, "high": 2.0, "levels": 2, "relative": True}
    with pytest.raises(InputError, match="relative to a number"):
        plan(small(vary=[relative]))


@pytest.mark.moderate
def test_the_published_schema_takes_the_examples() -> None:
    validator = jsonschema.Draft202012Validator(json.loads((DOCS / "campaign.schema.json").read_text()))
    files = sorted(examples.directory().glob("*.campaign.toml"))
    assert len(files) >= 3
    for file in files:
        table = tomllib.loads(file.read_text())
        validator.validate(table)
        assert len(read_plan(file)) > 0
        assert not validator.is_valid(table | {"seeds": -1})


def test_the_example_in_the_page_is_a_campaign(tmp_path: Path) -> None:
    text = (DOCS / "campaigns.md").read_text().split("```toml\n")[1].split("```")[0]
    (tmp_path / "noise.campaign.toml").write_text(text)
    assert len(read_plan(tmp_path / "noise.campaign.toml")) == 3 * 3 * 2


def test_a_grid_is_every_combination_once_with_its_ends() -> None:
    runs = list(plan().runs())
    assert [one.run for one in runs] == list(range(8))
    found = Counter((one.values["noise_V"], round(one.values["kxx"] / 1610.7194, 9)) for one in runs)
    assert found == {(noise, factor): 2 for noise in (3e-5, 9e-4) for factor in (0.99, 1.01)}
    assert [(one.point, one.repeat) for one in runs] == [(point, repeat) for point in range(4) for repeat in range(2)]
    assert len({one.seed for one in runs}) == 8
    scale = [{"key": "scenario.sense.noise_V", "low": 1e-5, "high": 1e-3, "levels": 3, "scale": "log"}]
    values = [one.values["noise_V"] for one in plan(small(vary=scale, seeds=1)).runs()]
    assert values == pytest.approx([1e-5, 1e-4, 1e-3])
    assert (values[0], values[-1]) == (1e-5, 1e-3)


def test_a_latin_hypercube_has_one_point_in_each_of_n_slices() -> None:
    vary = [
        NOISE | {"low": 1e-5, "high": 1e-3, "scale": "log"},
        {"key": "scenario.rate.rate_rad_s", "mean": 2.0, "sd": 0.5},
    ]
    made = plan(small(vary=vary, seeds=1, design={"kind": "latin_hypercube", "points": 40}))
    values = [one.values for one in made.runs()]
    share = [math.log10(one["noise_V"] / 1e-5) / 2.0 for one in values]
    assert sorted(int(40 * one) for one in share) == list(range(40))
    normal = [norm.cdf(one["rate_rad_s"], 2.0, 0.5) for one in values]
    assert sorted(int(40 * one) for one in normal) == list(range(40))


def test_sobol_points_are_scipys() -> None:
    vary = [NOISE | {"low": 0.0, "high": 1.0}, {"key": "scenario.rate.rate_rad_s", "low": 0.0, "high": 1.0}]
    made = plan(small(vary=vary, seeds=1, seed=5, design={"kind": "sobol", "points": 16}))
    expected = qmc.Sobol(2, seed=np.random.default_rng(5)).random_base2(4)
    found = [[one.values["noise_V"], one.values["rate_rad_s"]] for one in made.runs()]
    assert np.allclose(found, expected)
    assert qmc.discrepancy(np.array(found)) < qmc.discrepancy(np.random.default_rng(0).random((16, 2)))


def test_seeds_belong_to_point_and_repetition_alone() -> None:
    few, many = plan(small(seeds=2)), plan(small(seeds=3))
    of_few = {(one.point, one.repeat): one.seed for one in few.runs()}
    of_many = {(one.point, one.repeat): one.seed for one in many.runs()}
    assert of_few == {key: of_many[key] for key in of_few}
    assert {one.seed for one in plan(small(seed=2)).runs()}.isdisjoint(of_few.values())
    assert {one.seed for one in plan(small(fixed={**small()["fixed"], "bench.loop.seed": 7})).runs()} == {7}


def test_what_is_varied_is_in_scenario_and_bench_and_nothing_else_is() -> None:
    made = plan()
    scenario, bench = made.tables(made.run(7))
    assert scenario["sense"]["noise_V"] == bench["device"]["sense"]["noise_V"] == 9e-4
    assert scenario["truth"]["stiffness_N_per_m"][0] == pytest.approx(1.01 * 1610.7194)
    assert bench["loop"]["clock"] == "lockstep"
    first, _ = made.tables(made.run(0))
    assert first["sense"]["noise_V"] == 3e-5  # the tables of one run are none of another's
    first["truth"]["stiffness_N_per_m"][0] = first["sense"]["noise_V"] = None
    scenario["truth"]["stiffness_N_per_m"][0] = scenario["sense"]["noise_V"] = None
    assert first == scenario


def test_a_table_written_as_toml_is_the_same_when_read() -> None:
    for name in examples.names("scenario"):
        table = tomllib.loads((examples.directory() / f"{name}.scenario.toml").read_text())
        table["effect"] = [
            {"name": "cubic_stiffness", "k3x": 1e13},
            {"name": "x", "list": [{"deep": 'q"'}, {"b": True}]},
        ]
        table["sense"]["feedback_ohm"] = [math.inf, 1e9]
        assert tomllib.loads(toml_of(plain(table), "A remark.")) == table
