"""`hil trace --add` where no effect accounts for what is missing: the form is declared, and carried."""

import json
import re
from pathlib import Path

import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from hil.records.diagnosis import MissingForce
from hil.tracing.addition import add_form
from tests.cli.conftest import WAIT_S, Start, finished, in_lockstep

CUBIC = {
    "form": "q³",
    "sensed": False,
    "coefficients": {
        "x": {"value": -2.0e13, "ci95": [-2.1e13, -1.9e13], "unit": "1/(m²·s²)"},
        "y": {"value": -1.0e13, "ci95": [-1.1e13, -0.9e13], "unit": "1/(m²·s²)"},
    },
    "laws": {"x": ["x**3", ""], "y": ["", "y**3"]},
}
HYSTERESIS = {"form": "hysteresis of q, reach g", "sensed": False, "coefficients": {}, "laws": {}}
CROSS = {
    "form": "p",
    "sensed": True,
    "coefficients": {"x": {"value": 0.01, "ci95": [0.009, 0.011], "unit": "1"}},
    "laws": {"x": ["y", ""]},
}


FRICTION = {
    "form": "tanh(v/v0)",
    "sensed": False,
    "coefficients": {"x": {"value": -1.8, "ci95": [-1.9, -1.7], "unit": "m/s²"}},
    "inside": {"v0": {"value": 5.9e-4, "ci95": [5.9e-4, 5.9e-4], "unit": "m/s"}},
    "laws": {"x": ["sign(vx)", ""]},
}


def missing(*terms: dict[str, object]) -> MissingForce:
    figures = dict.fromkeys(("rms_mps2", "deviation_mps2", "left", "innovation_before", "innovation_after"))
    return MissingForce.model_validate({"form": terms, "text": "a form", **figures})


def test_each_term_becomes_an_effect_of_its_own(tmp_path: Path) -> None:
    target = tmp_path / "form.bench.toml"
    written = add_form(find("bench", "s-slow"), target, missing(CUBIC, HYSTERESIS, CROSS), "runs/first")
    assert written == (["form_1", "form_2"], ["hysteresis of q, reach g"])
    own = load_bench(target).effects.custom
    assert (own["form_1"].force_x, own["form_1"].force_y) == ("c_x*(x**3)", "c_y*(y**3)")
    assert {name: (one.start, one.unit) for name, one in own["form_1"].coefficients.items()} == {
        "c_x": (-2.0e13, "1/(m²·s²)"), "c_y": (-1.0e13, "1/(m²·s²)"),
    }  # fmt: skip
    assert (own["form_2"].sense_x, own["form_2"].force_x) == ("c_x*(y)", "")
    assert "a form, no cause; traced in runs/first" in target.read_text(encoding="utf-8")


def test_a_term_that_may_as_well_be_nothing_is_not_written(tmp_path: Path) -> None:
    """The next run would carry noise."""
    target, bench = tmp_path / "form.bench.toml", find("bench", "s-slow")
    doubtful = {
        "x": {"value": 87.0, "ci95": [-913.0, 1087.0], "unit": "1/(m²·s²)"},
        "y": {"value": None, "ci95": [None, None], "unit": "1/(m²·s²)"},
    }
    assert add_form(bench, target, missing(CUBIC | {"coefficients": doubtful}), "r") == ([], [])
    assert not target.exists()
    one_sure = doubtful | {"y": {"value": -2.0, "ci95": [-3.0, -1.0], "unit": "1/(m²·s²)"}}
    mixed = missing(CUBIC | {"coefficients": doubtful}, CUBIC | {"coefficients": one_sure})
    assert add_form(bench, target, mixed, "r")[0] == ["form_1"]
    assert load_bench(target).effects.custom["form_1"].force_y == "c_y*(y**3)"


def test_friction_turns_over_at_the_speed_of_the_form(tmp_path: Path) -> None:
    target = tmp_path / "form.bench.toml"
    assert add_form(find("bench", "s-slow"), target, missing(FRICTION, CUBIC), "runs/first")[0] == ["form_1", "form_2"]
    effects = load_bench(target).effects
    assert (effects.custom["form_1"].force_x, effects.custom["form_1"].parameters) == ("c_x*(sign(vx))", {})
    assert effects.named["form_1"] == {"v_rest": 5.9e-4}


def test_a_form_with_a_memory_alone_writes_nothing(tmp_path: Path) -> None:
    target = tmp_path / "form.bench.toml"
    assert add_form(find("bench", "s-slow"), target, missing(HYSTERESIS), "r") == ([], ["hysteresis of q, reach g"])
    assert not target.exists()


def test_an_effect_of_the_catalogue_is_declared_as_one(tmp_path: Path) -> None:
    target = tmp_path / "form.bench.toml"
    named = {"form": "dry friction", "sensed": False, "laws": {}, "effect": "dry_friction",
             "coefficients": {"fx": {"value": 1.8, "ci95": [1.7, 1.9], "unit": "m/s²"}},
             "inside": {"v0": FRICTION["inside"]["v0"]}}  # fmt: skip
    assert add_form(find("bench", "s-slow"), target, missing(named, CUBIC), "r")[0] == ["dry_friction", "form_1"]
    effects = load_bench(target).effects
    assert effects.named["dry_friction"] == {"fx": 1.8, "v0": 5.9e-4}
    assert effects.custom["form_1"].force_x == "c_x*(x**3)"


@pytest.mark.long
@pytest.mark.timeout(900)
def test_what_no_effect_accounts_for_is_undone_by_its_form(start: Start, tmp_path: Path) -> None:
    """A coupling that the catalogue lacks, the gradient of c x³ y: two runs in lockstep, the second with the form."""
    text = find("scenario", "s-undeclared").read_text(encoding="utf-8")
    hidden, n = re.subn(
        r"\[\[effect\]\].*", '[[effect]]\nname = "nonlinear_coupling"\nc = 4.0e12\n', text, flags=re.DOTALL
    )
    assert n == 1
    (tmp_path / "hidden.scenario.toml").write_text(hidden, encoding="utf-8")
    bench = in_lockstep("s-undeclared", duration_s=4.0, settle_s=1.5)
    bench = bench.replace("s-undeclared.scenario", "hidden.scenario")
    (tmp_path / "plain.bench.toml").write_text(bench, encoding="utf-8")

    def ran(bench_file: str, name: str) -> float:
        truth = f"{name}.truth.arrow"
        _, _, err = finished(start("run", bench_file, "--name", name, "--truth", truth), wait_s=4 * WAIT_S)
        (folder,) = (tmp_path / "runs").glob(f"*-{name}")
        code, _, err = finished(start("score", str(folder), "--truth", truth), wait_s=4 * WAIT_S)
        assert code in (0, 1), err
        return float(json.loads((folder / "result.json").read_text(encoding="utf-8"))["angle_error_rms_rad"])

    before = ran("plain.bench.toml", "first")
    (record,) = (tmp_path / "runs").glob("*-first")
    code, _, err = finished(
        start("trace", str(record), "--bench", "plain.bench.toml", "--add", "form.bench.toml"), wait_s=8 * WAIT_S
    )
    assert code == 1, err
    assert "so the file declares its form: [effects.custom.form_1]" in err
    after = ran("form.bench.toml", "second")
    assert after < before / 5.0
