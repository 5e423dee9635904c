"""Effects of one's own from the outside: declared in a bench file or brought by a package; nothing here is touched."""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from estimator.observer import Observer
from hil.bench import Bench, load_bench, override
from hil.bench.examples import directory, find
from hil.bench.template import template, values_of
from hil.errors import InputError
from hil.inputs.declared import device_of, observer_settings_of
from hil.inputs.own_effects import own_effects, packaged
from tests.cli.conftest import Hil, in_lockstep

PACKAGE = directory() / "cubic-coupling"
CUSTOM = {"quintic": {"force_x": "-k5 * x * r**4", "coefficients": {"k5": {"unit": "1/(m⁴·s²)", "start": 1e20}}}}
LINES = """
[effects.custom.quintic]
title = "Stiffness of fifth order along the radius"
force_x = "-k5 * x * r**4"
force_y = "-k5 * y * r**4"
coefficients.k5 = { unit = "1/(m⁴·s²)", start = 1e20, plausible = 1e21 }
"""
Install = Callable[[str, str, str], None]


def dist_info(site: Path, distribution: str, name: str, target: str) -> None:
    """What pip would leave of a package with one effect, in the folder `site`."""
    folder = site / f"{distribution.replace('-', '_')}-1.0.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0.0\n")
    (folder / "entry_points.txt").write_text(f"[hil.effects]\n{name} = {target}\n")


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """`install(distribution, entry point, source)`: a package whose one module has the effect as MINE."""

    def put(distribution: str, name: str, source: str) -> None:
        site, module = tmp_path / f"site-{distribution}", distribution.replace("-", "_")
        dist_info(site, distribution, name, f"{module}:MINE")
        (site / f"{module}.py").write_text(source)
        monkeypatch.syspath_prepend(str(site))
        monkeypatch.delitem(sys.modules, module, raising=False)

    return put


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The example package as installed in place, its entry points from its own pyproject.toml; its site folder."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ((name, target),) = project["entry-points"]["hil.effects"].items()
    site = tmp_path / "site"
    dist_info(site, project["name"], name, target)
    monkeypatch.syspath_prepend(str(PACKAGE))
    monkeypatch.syspath_prepend(str(site))
    return site


def bench(**effects: object) -> Bench:
    return override(load_bench(find("bench", "s-slow")), {"effects": effects}, "test")


@pytest.mark.slow
def test_the_example_package_is_short_and_whole(example: Path) -> None:
    lines = (PACKAGE / "cubic_coupling.py").read_text(encoding="utf-8").splitlines()
    assert len([line for line in lines if line.strip()]) <= 15
    (name,) = packaged().effects
    assert (name, packaged().broken) == ("cubic_coupling", {})
    named = bench(cubic_coupling={"c31": 1e12})
    observer = Observer(device_of(named), observer_settings_of(named))
    assert observer.names[-1] == "c31"
    assert observer.state[-1] == pytest.approx(1e12)
    assert "cubic_coupling" not in Observer(device_of(bench()), observer_settings_of(bench())).names  # not carried
    assert [effect.name for effect in device_of(bench()).own] == ["cubic_coupling"]  # but a candidate


def test_nothing_is_installed_by_itself() -> None:
    assert packaged().effects == {}


DECLARED = """
from estimator.custom import Coefficient, Declaration
MINE = Declaration("{name}", ("{law}", ""), coefficients={{"q": Coefficient("{unit}")}})
"""
BROKEN = {
    "no module": ("import nowhere_at_all\nMINE = 1\n", "ModuleNotFoundError"),
    "no Python": ("MINE = (\n", "SyntaxError"),
    "leaves": ("raise SystemExit(3)\n", "SystemExit"),
    "fails": ("MINE = 1 / 0\n", "ZeroDivisionError"),
    "many lines": ("raise ValueError('one\\ntwo\\x1b[31m')\n", "ValueError: one two"),
    "lacks it": ("YOURS = 1\n", "AttributeError"),
    "no effect": ("MINE = 3\n", "is a int, not a Declaration"),
    "another name": (
        DECLARED.format(name="other", law="-q*x", unit="1/s²"),
        "called 'other'",
    ),
    "bad law": (
        DECLARED.format(name="mine", law="x.real", unit="1"),
        "more than arithmetic",
    ),
    "bad unit": (
        DECLARED.format(name="mine", law="-q*x", unit="1"),
        "the unit of q should be 1/s²",
    ),
    "unknown symbol": (
        "import sympy as sp\nfrom estimator.effects.declaration import *\nq, z = sp.symbols('q z')\n"
        "MINE = Effect('mine', 'Mine', (Coefficient(q, 'q', 0.05),), 's', '', Compensation.CANCEL, force=(q * z, q))\n",
        "z is no state, drive, coefficient or signal",
    ),
}


@pytest.mark.moderate
@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_package_is_one_line_that_names_it(install: Install, kind: str) -> None:
    source, says = BROKEN[kind]
    install(f"pack-{kind.replace(' ', '')}", "mine", source)
    (line,) = packaged().broken.values()
    assert line.startswith(f"effect 'mine' of package pack-{kind.replace(' ', '')} 1.0.0: ")
    assert says in line
    assert line.isprintable()
    assert own_effects(bench(), device_of(bench())) == ()  # left out where nobody asks for it
    with pytest.raises(InputError, match="effect 'mine' of package"):
        device_of(bench(mine={}))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[effects.cubic_stifness]", r"[effects.cubic_stifness]: no such effect; did you mean cubic_stiffness?"),
        ("[effects.septik]", r"[effects.septik]: no such effect; did you mean septic?"),
        ("[effects.cubic_coupling]", r"[effects.cubic_coupling]: no such effect; did you mean "),
        (
            "[effects.cubic_stiffness]\nk3xx = 1e12",
            r"[effects.cubic_stiffness] k3xx: no such coefficient; did you mean k3x?",
        ),
        ("[effects.septic]\nk5 = 1.0", r"[effects.septic] k5: no such coefficient; known: k7, v_rest"),
        (
            '[effects."interference:2"]\nomgea = 1.0',
            r'[effects."interference:2"] omgea: no such coefficient; did you mean omega?',
        ),
        ('[effects."interference:2"]\nomega = 1.0', ""),
        ("[effects.septic]\nk7 = 1.0", ""),
    ],
)
def test_a_misspelt_effect_is_told_when_the_bench_file_is_read(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "odd.bench.toml"
    septic = '[effects.custom.septic]\nforce_x = "-k7 * x**7"\ncoefficients.k7.unit = "1/(m^6 s^2)"\n'
    file.write_text(f"{find('bench', 's-slow').read_text(encoding='utf-8')}\n{septic}\n{text}\n", encoding="utf-8")
    if not says:
        assert load_bench(file).effects.named
        return
    with pytest.raises(InputError) as error:
        load_bench(file)
    assert str(error.value).startswith(f"{file}: {says}")


def test_an_effect_of_a_package_is_known_by_its_name(example: Path) -> None:
    assert bench(cubic_coupling={"c31": 1e12}).effects.named


@pytest.mark.moderate
def test_a_package_may_say_it_in_sympy(install: Install) -> None:
    source = (
        "import sympy as sp\nfrom estimator.effects.declaration import Coefficient, Effect, Compensation\n"
        "from estimator.model.gyro import x, y\nq = sp.Symbol('q')\n"
        "MINE = Effect('mine', 'Mine', (Coefficient(q, 'q', 0.05, -2, -2),), 's', 's', Compensation.CANCEL,\n"
        "              force=(-q * x**3, -q * y**3))\n"
    )
    install("in-sympy", "mine", source)
    named = bench(mine={"q": 1e12})
    assert Observer(device_of(named), observer_settings_of(named)).names[-1] == "q"


@pytest.mark.parametrize(
    ("effects", "says"),
    [
        ({"custom": {"cubic_stiffness": CUSTOM["quintic"]}}, "the catalogue has an effect 'cubic_stiffness' already"),
        (
            {"custom": {"mine": {"force_x": "-k3x * x", "coefficients": {"k3x": {"unit": "1/s²"}}}}},
            "coefficients.k3x: effect 'cubic_stiffness' has one of that name",
        ),
        ({"custom": {"cubic_coupling": CUSTOM["quintic"]}, "cubic_coupling": {}}, None),
        (
            {"custom": {"mine": {"force_x": "-kxx * x", "coefficients": {"kxx": {"unit": "1/s²"}}}}},
            "coefficients.kxx: the base model has a constant of that name",
        ),
    ],
)
def test_names_are_taken_once(example: Path, effects: dict[str, object], says: str | None) -> None:
    if says is None:  # the bench file's own goes before a package's
        assert [effect.coefficients[0].name for effect in device_of(bench(**effects)).own] == ["k5"]
        return
    with pytest.raises(InputError, match=r"\[effects.custom.\w+\]") as error:
        device_of(bench(**effects))
    assert says in str(error.value)


def test_a_bench_file_carries_what_it_declares() -> None:
    declared = bench(custom=CUSTOM)
    assert observer_settings_of(declared).effects == {"quintic": {"k5": 1e20}}
    aside = {"quintic": {**CUSTOM["quintic"], "carried": False}}
    assert observer_settings_of(bench(custom=aside)).effects == {}
    assert [effect.name for effect in device_of(bench(custom=aside)).own] == ["quintic"]
    found = bench(custom=aside, quintic={"k5": 2e20})  # as hil trace --add writes it
    assert observer_settings_of(found).effects == {"quintic": {"k5": 2e20}}


def test_a_bench_file_is_written_as_it_was_read(tmp_path: Path) -> None:
    path = tmp_path / "mine.bench.toml"
    path.write_text(find("bench", "s-slow").read_text(encoding="utf-8") + LINES, encoding="utf-8")
    declared = load_bench(path)
    path.write_text(template(values_of(declared), "again"), encoding="utf-8")
    assert load_bench(path) == declared
    assert Bench.model_validate_json(declared.model_dump_json(), strict=False) == declared


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (
            "force_x = \"__import__('os').system('touch owned')\"",
            "[effects.custom.quintic] force_x: ''' at character 12",
        ),
        ('force_x = "-k5 * x"', "the unit of k5 should be 1/s², not 1/(m⁴·s²)"),
        ('force_x = "-k5 * x.real"', "'x.real' is more than arithmetic"),
        ('force_x = "9**9**9 * k5"', "exponent '9**9': no number"),
        (f'force_x = "{"x" * 1_000_000}"', "1000000 characters; a law has at most 500"),
        ('forse_x = "-k5 * x * r**4"', "[effects.custom.quintic] forse_x: unknown key; did you mean force_x?"),
    ],
)
def test_a_law_that_is_none_is_one_line(hil: Hil, tmp_path: Path, line: str, says: str) -> None:
    laws = LINES.replace('force_x = "-k5 * x * r**4"', line).replace('force_y = "-k5 * y * r**4"\n', "")
    source = find("bench", "s-slow").read_text(encoding="utf-8") + laws
    (tmp_path / "mine.bench.toml").write_text(source, encoding="utf-8")
    code, out, err = hil("run", "mine.bench.toml", "--link", "inproc:s-slow")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert err.startswith("hil: mine.bench.toml: ")
    assert says in err
    assert {path.name for path in tmp_path.iterdir()} == {"mine.bench.toml"}


def hil_process(folder: Path, path: list[Path], *arguments: str) -> "subprocess.CompletedProcess[str]":
    """`hil` in another process, with these folders in front of the module path."""
    where = os.pathsep.join([*map(str, path), *filter(None, [os.environ.get("PYTHONPATH")])])
    return subprocess.run(
        [sys.executable, "-m", "hil", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": where},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )


@pytest.mark.long
def test_a_run_carries_it_says_what_it_compiled_and_keeps_it(tmp_path: Path) -> None:
    # A law nobody has compiled before: its number is the process's.
    laws = LINES.replace("-k5 * x", f"-k5 * {1 + os.getpid() / 1e7} * x")
    source = in_lockstep("s-slow", duration_s=3.0, settle_s=1.0) + laws
    (tmp_path / "mine.bench.toml").write_text(source, encoding="utf-8")
    arguments = ("run", "mine.bench.toml", "--link", "inproc:s-slow", "--json")
    first = hil_process(tmp_path, [], *arguments, "--name", "first")
    second = hil_process(tmp_path, [], *arguments, "--name", "second")
    assert first.returncode in (0, 1), first.stderr
    assert "effect quintic: compiled in " in first.stderr
    assert "compiled in" not in second.stderr
    assert "k5" in json.loads(first.stdout)["parameters"]
    (folder,) = (tmp_path / "runs").glob("*-first")
    assert load_bench(folder / "bench.toml").effects == load_bench(tmp_path / "mine.bench.toml").effects
    again = hil_process(tmp_path, [], "replay", str(folder), "--bench", str(folder / "bench.toml"), "--json")
    assert again.returncode in (0, 1), again.stderr
    assert "k5" in json.loads(again.stdout)["parameters"]


@pytest.mark.long
def test_a_broken_package_stops_no_run_that_does_without(tmp_path: Path) -> None:
    dist_info(tmp_path / "site", "broken-thing", "mine", "broken_thing:MINE")
    (tmp_path / "site" / "broken_thing.py").write_text("raise RuntimeError('not here')\n")
    source = in_lockstep("s-slow", duration_s=3.0, settle_s=1.0)
    (tmp_path / "plain.bench.toml").write_text(source, encoding="utf-8")
    (tmp_path / "named.bench.toml").write_text(f"{source}\n[effects.mine]\n", encoding="utf-8")
    line = "effect 'mine' of package broken-thing 1.0.0: RuntimeError: not here; mend or uninstall it"
    arguments = ("--link", "inproc:s-slow", "--json")
    without = hil_process(tmp_path, [tmp_path / "site"], "run", "plain.bench.toml", *arguments)
    assert without.returncode in (0, 1), without.stderr
    assert f"{line}; it is left out" in without.stderr.splitlines()
    named = hil_process(tmp_path, [tmp_path / "site"], "run", "named.bench.toml", *arguments)
    assert (named.returncode, json.loads(named.stdout)["remedy"]) == (2, "mend or uninstall it")
    assert named.stderr == f"hil: {line}\n"


@pytest.mark.long
@pytest.mark.timeout(900)  # a run, a trace, another run
def test_a_trace_names_it_and_adds_it(tmp_path: Path, example: Path) -> None:
    """The board has a coupling that the catalogue lacks; a package declares it; nothing here is changed for that."""
    scenario = find("scenario", "s-undeclared").read_text(encoding="utf-8").partition("[[effect]]")[0]
    hidden = 'name = "nonlinear_coupling"\nc = 5e12\n'
    (tmp_path / "s-undeclared.scenario.toml").write_text(f"{scenario}[[effect]]\n{hidden}", encoding="utf-8")
    source = in_lockstep("s-undeclared", duration_s=5.0, settle_s=2.0)
    (tmp_path / "mine.bench.toml").write_text(source, encoding="utf-8")
    path, link = [example, PACKAGE], ("--link", "inproc:s-undeclared.scenario.toml", "--json")
    run = hil_process(tmp_path, path, "run", "mine.bench.toml", *link)
    assert run.returncode == 1, run.stderr  # the residual is beyond its limit
    before = Path("runs") / json.loads(run.stdout)["run"]
    traced = hil_process(
        tmp_path, path, "trace", str(before), "--bench", "mine.bench.toml", "--add", "new.bench.toml", "--json"
    )
    assert traced.returncode == 0, traced.stderr
    diagnosis = json.loads(traced.stdout)
    assert diagnosis["verdict"] == "explained"
    (effect,) = diagnosis["effects"]
    assert effect["name"] == "cubic_coupling"
    assert effect["coefficients"]["c31"]["value"] == pytest.approx(5e12, rel=0.03)
    assert effect["coefficients"]["c31"]["unit"] == "1/(m²·s²)"
    (folder,) = (tmp_path / "runs").glob("*-trace")
    report = (folder / "report.html").read_text(encoding="utf-8")
    assert "Coupling of the axes by a potential" in report
    assert "c31" in report
    assert diagnosis["equations"][0] == "ẍ += -3*c31*x**2*y"
    after = hil_process(tmp_path, path, "run", "new.bench.toml", *link)
    assert after.returncode == 0, after.stderr
    result = json.loads(after.stdout)
    assert result["parameters"]["c31"]["value"] == pytest.approx(5e12, rel=0.03)
