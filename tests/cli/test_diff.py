"""`hil diff`: two runs, or two traces, side by side (docs/reference/diff.md)."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import hil as library
from hil.cli.diff import _cells, _readable
from hil.comparing.diff import Figure, compare
from hil.records.atomic import write_sealed
from hil.records.diagnosis import load_diagnosis, save_diagnosis, to_model
from hil.records.result import load_result, save_result
from hil.records.runfolder import RunFolder
from tests.cli.conftest import Hil
from tests.cli.test_errors import refused
from tests.records.synthetic_run import Options, write_run
from tests.records.test_diagnosis import answer

A, B = "20260101-000000-a", "20260102-000000-b"


@pytest.fixture
def two(tmp_path: Path) -> tuple[Path, Path]:
    """Two runs of other noise; in the second the spring is harder by 100 1/s², and settle_s is another."""
    runs = tmp_path / "runs"
    write_run(runs / A, Options())
    write_run(runs / B, Options(seed=2, settle_s=0.75))
    place = RunFolder(runs / B).result_path
    result = load_result(place)
    old = result.parameters["kxx"]
    low, high = old.ci95
    moved = old.model_copy(update={"value": old.value + 100.0, "ci95": (low + 100.0, high + 100.0)})
    save_result(place, result.model_copy(update={"parameters": {**result.parameters, "kxx": moved}}))
    return runs / A, runs / B


def traced(folder: Path, *, found: bool) -> None:
    """A trace folder, with an effect or without."""
    folder.mkdir()
    save_diagnosis(folder / "diagnosis.json", to_model(answer(found=found), record="ride", bench="S-test"))


def named(figures: list[dict], name: str) -> dict:
    (found,) = [one for one in figures if one["name"] == name]
    return found


@pytest.mark.parametrize(
    ("figure", "shown"),
    [
        (Figure("noise floor", "V", 9.0e-5, 9.2e-5), ("90", "92", "+2.00", "µV")),
        (Figure("k3x", "1/(m²·s²)", 1e13, 1.001e13, 1e10, 1e10), ("10", "10.01", "0.010 ± 0.014", "10¹² 1/(m²·s²)")),
        (Figure("kxx", "1/s²", 1610721.0, 1610719.0), ("1610721", "1610719", "−2.00", "1/s²")),
        (Figure("angle error, rms", "rad", None, 5.5e-4), ("", "550", "", "µrad")),
        (Figure("turnaround p99.9", "µs", 12140.0, 7880.0), ("12140", "7880", "−4260", "µs")),
        (Figure("late", "", None, 3.0), ("", "3", "", "")),
    ],
)
def test_a_long_number_is_shown_in_a_prefix_or_a_power_of_its_unit(figure: Figure, shown: tuple[str, ...]) -> None:
    one = _readable(figure)
    assert (*_cells(one), one.unit) == shown


@pytest.mark.moderate
def test_a_difference_is_b_less_a_with_the_uncertainty_of_two_records(two: tuple[Path, Path], hil: Hil) -> None:
    code, out, _ = hil("diff", str(two[0]), str(two[1]), "--json")
    assert code == 0
    told = json.loads(out)
    assert told["kind"] == "run"
    assert told["same_record"] is False
    results = [load_result(place / "result.json") for place in two]
    for name, a in results[0].parameters.items():
        b, found = results[1].parameters[name], named(told["figures"], name)
        halves = [0.5 * (one.ci95[1] - one.ci95[0]) for one in (a, b)]
        assert found["difference"] == pytest.approx(b.value - a.value)
        assert found["uncertainty"] == pytest.approx(math.sqrt(halves[0] ** 2 + halves[1] ** 2))
        assert found["unit"] == a.unit
    assert named(told["figures"], "innovation, rms")["uncertainty"] is None


@pytest.mark.moderate
def test_the_interval_of_a_difference_holds_it_as_often_as_it_says() -> None:
    """A figure estimated twice, each time off by a normal deviate of its own."""
    rng = np.random.default_rng(7)
    sd_a, sd_b = 1.0, 3.0
    a, b = 5.0 + sd_a * rng.standard_normal(20_000), 5.0 + sd_b * rng.standard_normal(20_000)
    wide = [Figure("f", "", x, y, 1.96 * sd_a, 1.96 * sd_b).apart for x, y in zip(a, b, strict=True)]
    assert np.mean(wide) == pytest.approx(0.05, abs=4.0 * math.sqrt(0.05 * 0.95 / 20_000))


@pytest.mark.moderate
def test_of_one_record_the_uncertainty_is_the_most_it_can_be(tmp_path: Path) -> None:
    for name, change in ((A, {}), (B, {})):
        write_run(tmp_path / name, Options(**change))
    found = compare(tmp_path / A, tmp_path / B)
    assert found.same_record
    assert not found.bench
    for one in found.figures:
        assert one.difference == 0.0
        assert one.apart in (None, False)
        assert one.u_a is None or one.uncertainty == pytest.approx(2.0 * one.u_a)


@pytest.mark.moderate
def test_bench_keys_that_differ_are_told_and_no_others(two: tuple[Path, Path], hil: Hil) -> None:
    code, out, _ = hil("diff", str(two[0]), "last")
    assert code == 0
    assert out.partition("bench files\n")[2] == "  [loop] settle_s: 0.5 → 0.75\n"
    row = next(line for line in out.splitlines() if line.startswith("kxx"))
    values = [load_result(place / "result.json").parameters["kxx"].value for place in two]
    told = re.search(r" (−?\d+) ± \d+ +1/s² +apart$", row)
    assert told, row
    assert float(told[1]) == pytest.approx(values[1] - values[0], abs=0.5)
    assert out.count("apart") == sum(bool(one.apart) for one in compare(*two).figures)


@pytest.mark.moderate
def test_a_key_that_only_one_file_has(two: tuple[Path, Path], tmp_path: Path) -> None:
    bench = two[1] / "bench.toml"
    write_sealed(bench, bench.read_text(encoding="utf-8") + "\n[effects.cubic_stiffness]\nk3x = 1e12\n")
    keys = {key.name: (key.a, key.b) for key in compare(*two).bench}
    assert keys["[effects.cubic_stiffness] k3x"] == (None, 1e12)
    back = {key.name: (key.a, key.b) for key in compare(two[1], two[0]).bench}
    assert back["[effects.cubic_stiffness] k3x"] == (1e12, None)


@pytest.mark.moderate
def test_two_traces(tmp_path: Path, hil: Hil) -> None:
    for name in (A, B):
        traced(tmp_path / name, found=name == B)
    code, out, _ = hil("diff", A, B, "--json")
    assert code == 0
    told = json.loads(out)
    assert told["kind"] == "trace"
    after = load_diagnosis(tmp_path / B / "diagnosis.json")
    (effect,) = after.effects
    symbol, one = next(iter(effect.coefficients.items()))
    found = named(told["figures"], f"{effect.name}: {symbol}")
    assert (found["a"], found["b"]) == (None, one.value)
    assert found["difference"] is None
    assert named(told["figures"], "residual over floor, held out, after")["b"] == after.held_out.after.ratio
    code, out, _ = hil("diff", A, B)
    assert code == 0
    assert f"{effect.name}: {symbol}" in out


@pytest.mark.moderate
def test_a_run_and_a_trace_are_not_compared(two: tuple[Path, Path], tmp_path: Path, hil: Hil) -> None:
    trace = tmp_path / "trace"
    traced(trace, found=True)
    line = f"{trace}: a trace, but {two[0]} is a run; compare two runs, or two traces"
    assert refused(hil("diff", str(two[0]), str(trace))) == line
    assert refused(hil("diff", str(trace), str(two[0]))) == line


@pytest.mark.moderate
def test_what_has_no_figures_is_refused_in_one_line(two: tuple[Path, Path], tmp_path: Path, hil: Hil) -> None:
    assert "no run folder" in refused(hil("diff", str(two[0]), str(tmp_path / "nowhere")))
    (two[1] / "result.json").unlink()
    assert f"hil replay {two[1]}" in refused(hil("diff", str(two[0]), str(two[1])))


@pytest.mark.moderate
def test_values_that_json_has_not_do_not_stop_it(two: tuple[Path, Path], hil: Hil) -> None:
    bench = two[1] / "bench.toml"
    text = bench.read_text(encoding="utf-8").replace("[loop]", "[loop]\nodd = [inf, 2026-01-01]")
    write_sealed(bench, text)
    code, out, _ = hil("diff", str(two[0]), str(two[1]), "--json")
    assert code == 0
    assert {"key": "[loop] odd", "a": None, "b": ["inf", "2026-01-01"]} in json.loads(out)["bench"]
    assert hil("diff", str(two[0]), str(two[1]))[0] == 0


@pytest.mark.moderate
def test_the_library_takes_folders_and_runs(two: tuple[Path, Path]) -> None:
    found = library.diff(two[0], library.load(two[1]))
    assert [one.name for one in found.figures if one.apart] == [one.name for one in compare(*two).figures if one.apart]
    assert "kxx" in [one.name for one in found.figures if one.apart]
