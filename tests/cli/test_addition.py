"""A bench file with an effect added: the rest of it stays, comments and all."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from hil.bench import load_bench
from hil.bench.examples import find
from hil.boards.emulation import located
from hil.cli import execute
from hil.errors import InputError
from hil.records.diagnosis import Coefficient, Diagnosis, Effect
from hil.tracing.addition import Addition, add_effects, write_custom
from tests.cli.diagnoses import explained, save_trace

CUBIC = Addition("cubic_stiffness", "found in ride", {"k3x": (9.97e12, "± 2e10 1/(m²·s²)"), "k3y": (3e12, "")})
LINE = Addition("interference:2", "", {"lcx": (1e-9, "m"), "omega": (311.0, "rad/s")})
GAIN = Addition("sense_gain", "found in ride", {"gy": (-0.01, "")})


def test_the_rest_of_the_file_stays_as_it_is(tmp_path: Path) -> None:
    source = find("bench", "s-undeclared")
    add_effects(source, tmp_path / "new.bench.toml", [CUBIC, GAIN])
    new = (tmp_path / "new.bench.toml").read_text(encoding="utf-8")
    old = source.read_text(encoding="utf-8")
    for line in old.splitlines():
        assert line in new or line.startswith("url")
    bench = load_bench(tmp_path / "new.bench.toml")
    assert bench.effects.named == {"cubic_stiffness": {"k3x": 9.97e12, "k3y": 3e12}, "sense_gain": {"gy": -0.01}}
    apart = {"effects": None, "link": None}
    assert bench.model_copy(update=apart) == load_bench(source).model_copy(update=apart)
    assert "# ± 2e10 1/(m²·s²)" in new


def test_the_board_beside_the_old_file_is_found_from_the_new_one(tmp_path: Path) -> None:
    for name in ("old", "new"):
        (tmp_path / name).mkdir()
    board = tmp_path / "old" / "mine.scenario.toml"
    board.write_text(find("scenario", "s-slow").read_text(encoding="utf-8"), encoding="utf-8")
    text = find("bench", "s-slow").read_text(encoding="utf-8").replace("s-slow.scenario.toml", board.name)
    source, target = tmp_path / "old" / "mine.bench.toml", tmp_path / "new" / "mine.bench.toml"
    source.write_text(text, encoding="utf-8")
    add_effects(source, target, [GAIN])
    url = load_bench(target).link.url
    assert url is not None
    assert located(url, beside=target) == f"pty:{board.resolve()}"
    add_effects(source, tmp_path / "old" / "again.bench.toml", [GAIN])
    assert load_bench(tmp_path / "old" / "again.bench.toml").link.url == f"pty:{board.name}"


def test_more_can_be_added_to_what_is_there(tmp_path: Path) -> None:
    first, second = tmp_path / "first.bench.toml", tmp_path / "second.bench.toml"
    add_effects(find("bench", "s-slow"), first, [GAIN])
    add_effects(first, second, [CUBIC, LINE])
    effects = load_bench(second).effects.named
    assert set(effects) == {"sense_gain", "cubic_stiffness", "interference:2"}
    assert effects["interference:2"] == {"lcx": 1e-9, "omega": 311.0}
    with pytest.raises(InputError, match=r"\[effects.sense_gain\] is declared already"):
        add_effects(second, tmp_path / "third.bench.toml", [GAIN])
    assert not (tmp_path / "third.bench.toml").exists()


def test_a_form_that_cannot_be_added_to_is_refused(tmp_path: Path) -> None:
    text = find("bench", "s-slow").read_text(encoding="utf-8")
    source = tmp_path / "inline.bench.toml"
    source.write_text("effects = {sense_gain = {gy = 0.0}}\n" + text, encoding="utf-8")
    with pytest.raises(InputError, match="one table per effect"):
        add_effects(source, tmp_path / "new.bench.toml", [CUBIC])


QUINTIC = {"k5": (2.5e21, "1/(m⁴·s²)")}
LAWS = ("-k5 * x * r**4", "-k5 * y * r**4")


def test_a_form_is_written_as_an_effect_of_its_own(tmp_path: Path) -> None:
    old = find("bench", "s-undeclared").read_text(encoding="utf-8")
    new = write_custom(old, "quintic", LAWS, QUINTIC, title="Along the radius", remark="seen in ride")
    assert new.startswith(old.rstrip("\n"))
    (tmp_path / "new.bench.toml").write_text(new, encoding="utf-8")
    bench = load_bench(tmp_path / "new.bench.toml")
    own = bench.effects.custom["quintic"]
    assert (own.force_x, own.force_y, own.title, own.carried) == (*LAWS, "Along the radius", True)
    assert (own.coefficients["k5"].start, own.coefficients["k5"].unit) == QUINTIC["k5"]
    again = write_custom(
        new, "more", ("", "-g * vy"), {"g": (0.0, "1/s")}, sensed=("g * x * s0",), parameters={"s0": (1e-3, "s")}
    )
    (tmp_path / "new.bench.toml").write_text(again, encoding="utf-8")
    effects = load_bench(tmp_path / "new.bench.toml").effects.custom
    assert set(effects) == {"quintic", "more"}
    assert (effects["more"].force_x, effects["more"].sense_x, effects["more"].sense_y) == ("", "g * x * s0", "")
    assert effects["more"].parameters["s0"].value == 1e-3


@pytest.mark.parametrize(
    ("name", "laws", "coefficients", "complaint"),
    [
        ("quintic", ("__import__('os')", ""), QUINTIC, r"\[effects.custom.quintic\] force_x: ''' at character 12"),
        ("quintic", LAWS, {"k5": (0.0, "1/s²")}, r"the unit of k5 should be 1/\(m⁴·s²\)"),
        ("quintic]\n[link", LAWS, QUINTIC, "name: begins with a small letter"),
        ("there", LAWS, QUINTIC, r"\[effects.custom.there\] is declared already"),
        ("sense_gain", LAWS, QUINTIC, r"\[effects.custom.sense_gain\] is declared already"),
    ],
)
def test_a_form_that_is_none_is_not_written(
    name: str, laws: tuple[str, str], coefficients: dict[str, tuple[float, str]], complaint: str
) -> None:
    there = '[effects.sense_gain]\ngy = 0.0\n[effects.custom.there]\nforce_x = "-q*x"\ncoefficients.q.unit = "1/s²"\n'
    with pytest.raises(InputError, match=complaint) as error:
        write_custom(there, name, laws, coefficients)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="cannot be added"):
        write_custom("effects = {sense_gain = {gy = 0.0}}\n", "quintic", LAWS, QUINTIC)


def traced(folder: Path, diagnosis: Diagnosis, bench: str = "s-slow") -> Path:
    """The folder of a trace, as `hil trace` leaves it."""
    save_trace(folder, diagnosis)
    shutil.copy(find("bench", bench), folder / "bench.toml")
    return folder


def hardened() -> Diagnosis:
    k3x = Coefficient(value=2.0e13, ci95=(1.9e13, 2.1e13), unit="1/(m²·s²)")
    k3y = Coefficient(value=1.0e13, ci95=(0.9e13, 1.1e13), unit="1/(m²·s²)")
    effect = {"name": "cubic_stiffness", "title": "Cubic stiffness", "coefficients": {"k3x": k3x, "k3y": k3y}}
    return explained(
        effects=(Effect.model_validate({**effect, "equations": (), "evidence": 90.0, "compensation": "cancel"}),)
    )


def test_a_trace_shown_again_writes_what_it_found(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder, target = traced(tmp_path / "trace", hardened()), tmp_path / "better.bench.toml"
    assert execute(["show", str(folder), "--add", str(target)]) == 0
    out, err = capfd.readouterr()
    assert f"{target}: written; it declares cubic_stiffness" in err
    assert out.splitlines()[-1].split(maxsplit=1)[1] == f"hil replay r.arrow --bench {target}"
    assert load_bench(target).effects.named["cubic_stiffness"]["k3x"] == pytest.approx(2.0e13)
    assert execute(["show", str(folder), "--add", str(target)]) == 2  # it is there
    assert execute(["show", str(folder), "--add", str(target), "--replace"]) == 0


@pytest.mark.parametrize(
    ("said", "bench"), [({"record": "2 records: a, b"}, "s-slow"), ({}, "rate-table-crs03")], ids=["pool", "rate"]
)
def test_what_no_bench_file_can_declare_is_refused(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], said: dict[str, Any], bench: str
) -> None:
    folder = traced(tmp_path / "trace", hardened().model_copy(update=said), bench)
    assert execute(["show", str(folder), "--add", str(tmp_path / "new.bench.toml")]) == 2
    assert "copy what was found into [effects]" in capfd.readouterr().err
    assert not (tmp_path / "new.bench.toml").exists()


def test_a_run_has_found_nothing_to_add(whole_run: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert execute(["show", str(whole_run), "--add", str(tmp_path / "new.bench.toml")]) == 2
    assert "is no trace" in capfd.readouterr().err
