"""The gate of a campaign: a planted regression is found, chance is not taken for one."""

import json
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

import hil
from hil.errors import InputError
from hil.sweeping.baseline import GATED, changes, read_baseline, uncompared
from hil.sweeping.campaign import Campaign, Vary
from hil.sweeping.plan import Plan
from hil.toml.reading import toml_value
from tests.campaigns.small import RUNS, plan
from tests.cli.conftest import hil as called  # noqa: F401

CAMPAIGN = Campaign.model_validate(
    {"name": "gate", "scenario": "s", "bench": "b", "seeds": 8,
     "vary": [{"key": "scenario.sense.noise_V", "values": [1e-4, 3e-4, 1e-3]}]}
)  # fmt: skip


def results(generator, seeds, base, planted=1.0, lacking=0):
    """Rows of 3 cells: figures that scatter by 25 % from seed to seed, and by 6 % from program to program."""
    rows = []
    for cell, noise in enumerate((1e-4, 3e-4, 1e-3)):
        for seed in (one + 10_000 * cell for one in seeds):
            row = {"seed": seed, "noise_V": noise, "outcome": "ran"}
            for k, name in enumerate(GATED):
                common = np.random.default_rng([base, seed, k]).standard_normal()
                row[name] = float(noise * np.exp(0.25 * common + 0.06 * generator.standard_normal()))
            row["rate_error_rms_rad_s"] *= planted
            rows.append(row)
    for row in rows[:lacking]:
        row |= {"outcome": "stopped", "converged_s": None}
    return pa.Table.from_pylist(rows)


@pytest.mark.parametrize("seeds", ["shared", "fresh"])
def test_a_planted_fifth_is_found_and_twenty_sweeps_without_are_not_blamed(seeds):
    generator = np.random.default_rng(11)
    n = 8 if seeds == "shared" else 60  # without shared seeds the scatter of the seeds is in the means
    old = results(generator, range(n), 1)
    there = range(n) if seeds == "shared" else range(1000, 1000 + n)
    for _ in range(20):
        assert not any(one.worse for one in changes(results(generator, there, 1), old, CAMPAIGN))
    found = [one for one in changes(results(generator, there, 1, planted=1.2), old, CAMPAIGN) if one.worse]
    assert {one.figure for one in found} == {"rate_error_rms_rad_s"}
    overall = next(one for one in found if one.cell == "")
    assert overall.low <= 0.2 <= overall.high


def test_what_one_algorithm_loses_another_does_not_hide():
    """In all cells together there is no change, and in one of them are too few runs: those of one value tell."""
    campaign = CAMPAIGN.model_copy(
        update={"vary": (*CAMPAIGN.vary, Vary(key="bench.observer.gain", values=("ekf", "fading")))}
    )

    def of_both(generator, planted=1.0):
        tables = [
            results(generator, range(6), 1, factor).append_column("gain", pa.array([name] * 18))
            for name, factor in (("ekf", planted), ("fading", 1.0 / planted))
        ]
        return pa.concat_tables(tables)

    generator = np.random.default_rng(12)
    old = of_both(generator)
    for _ in range(20):
        assert not any(one.worse for one in changes(of_both(generator), old, campaign))
    found = [one for one in changes(of_both(generator, 1.2), old, campaign) if one.worse]
    assert [(one.figure, one.cell) for one in found] == [("rate_error_rms_rad_s", "gain ekf")]


def test_a_better_figure_and_a_change_of_rounding_are_none():
    generator = np.random.default_rng(3)
    old = results(generator, range(8), 1)
    rounded = old.set_column(
        old.column_names.index("innovation_ratio"), "innovation_ratio",
        pa.array(np.array(old["innovation_ratio"]) * (1 + 1e-9)),
    )  # fmt: skip
    assert not any(one.worse for one in changes(rounded, old, CAMPAIGN))
    assert not any(one.worse for one in changes(results(generator, range(8), 1, planted=0.5), old, CAMPAIGN))


def test_runs_that_no_longer_end_are_worse():
    generator = np.random.default_rng(4)
    old, new = results(generator, range(8), 1), results(generator, range(8), 1, lacking=16)
    assert {one.figure for one in changes(new, old, CAMPAIGN) if one.worse} == {
        "runs that ran to their end", "runs that have converged_s",
    }  # fmt: skip


def test_from_the_command_line(swept, tmp_path, called):  # noqa: F811
    """The same runs again beside themselves; then beside results that were a fifth better."""
    vary = "".join("[[vary]]\n" + "".join(f"{k} = {toml_value(v)}\n" for k, v in one.items()) for one in RUNS["vary"])
    top = "".join(f"{k} = {toml_value(v)}\n" for k, v in RUNS.items() if k not in ("vary", "fixed"))
    fixed = "[fixed]\n" + "".join(
        f'"{k}" = {toml_value(v)}\n' for k, v in RUNS["fixed"].items() if k != "scenario.rate"
    )
    rate = '"scenario.rate" = { kind = "constant", rate_rad_s = 1.0 }\n'
    (tmp_path / "small.campaign.toml").write_text(top + fixed + rate + vary)
    call = ("sweep", "small.campaign.toml", "--out", str(swept.path), "--json", "--junit", "gate.xml", "--replace")
    code, out, _ = called(*call, "--baseline", str(swept.path))
    assert (code, [one for one in json.loads(out)["baseline"] if one["worse"]]) == (0, [])
    table = parquet.read_table(swept.path / "results")
    better = [value and value / 1.2 for value in table["rate_error_rms_rad_s"].to_pylist()]
    at = table.column_names.index("rate_error_rms_rad_s")
    parquet.write_table(table.set_column(at, "rate_error_rms_rad_s", pa.array(better)), "better.parquet")
    code, out, _ = called(*call, "--baseline", "better.parquet")
    assert code == 1
    assert {one["figure"] for one in json.loads(out)["baseline"] if one["worse"]} == {"rate_error_rms_rad_s"}
    assert ElementTree.parse("gate.xml").findall(".//failure")
    _, out, _ = called(*(one for one in call if one != "--json"), "--baseline", "better.parquet")
    assert "\\n" not in out
    assert sum(line.startswith("  worse  rate_error_rms_rad_s") for line in out.splitlines()) >= 1


def test_what_the_baseline_lacks_is_told():
    """A cell, a column, a figure that was 0 or no number: a gate that looks at less says so."""
    generator = np.random.default_rng(6)
    new, old = (results(generator, range(4), 1) for _ in range(2))
    assert uncompared(new, old, CAMPAIGN) == []
    fewer = old.slice(4).drop_columns(["innovation_ratio"])
    for name, value in (("converged_s", 0.0), ("pattern_error_rms_rad", float("inf"))):
        fewer = fewer.set_column(fewer.column_names.index(name), name, pa.array([value] * len(fewer)))
    assert uncompared(new, fewer, CAMPAIGN) == [
        "1 of 3 cells: the baseline has no run at noise_V 0.0001",
        "pattern_error_rms_rad: the baseline has none",
        "innovation_ratio: the baseline has none",
        "converged_s: the baseline has none",
    ]
    assert not any(one.worse for one in changes(new, fewer, CAMPAIGN))


def test_a_baseline_without_a_common_cell_is_refused_before_the_first_run(tmp_path):
    """One cell in common is enough; the table of another campaign's values has none."""
    cells = [(noise, share) for noise in (3e-5, 9e-4) for share in (0.99, 1.01)]
    stiffness = plan().scenario["truth"]["stiffness_N_per_m"][0]
    rows = [{"seed": 1, "noise_V": noise, "kxx": share * stiffness} for noise, share in cells]
    parquet.write_table(pa.Table.from_pylist(rows[3:]), tmp_path / "one.parquet")
    assert len(read_baseline(tmp_path / "one.parquet", plan())) == 1
    parquet.write_table(pa.Table.from_pylist([row | {"noise_V": 7e-4} for row in rows]), tmp_path / "none.parquet")
    with pytest.raises(InputError, match=r"none\.parquet: no cell of this campaign"):
        hil.sweep(RUNS, out=tmp_path / "x", baseline=tmp_path / "none.parquet")
    assert not (tmp_path / "x").exists()


def test_bad_input(tmp_path):
    (tmp_path / "no.parquet").write_text("nothing")
    parquet.write_table(pa.table({"a": [1]}), tmp_path / "other.parquet")
    for name, word in (("no.parquet", "no results"), ("none.parquet", "no results"), ("other.parquet", "lacks seed")):
        with pytest.raises(InputError, match=word):
            read_baseline(tmp_path / name, Plan(CAMPAIGN, "c", "c", {}, {}))
    with pytest.raises(InputError, match="junit"):
        hil.sweep(RUNS, out=tmp_path / "x", junit=tmp_path / "a.xml")
