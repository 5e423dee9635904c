"""Who may load whom, seen in a fresh interpreter: import contracts do not see what an `__init__` drags in."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = {"numpy", "numba", "scipy", "sympy", "matplotlib", "pyarrow", "filterpy", "pydantic", "can"}


def loaded_after(statement: str) -> set[str]:
    """Names in `sys.modules` of a new interpreter that has run `statement`."""
    program = f"{statement}\nimport sys\nprint(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


def loaded_after_all_of(package: str) -> set[str]:
    """The same after importing a package and every module below it, but for programs (`__main__`)."""
    return loaded_after(
        f"import importlib, pkgutil, {package} as top\n"
        "for found in pkgutil.walk_packages(top.__path__, top.__name__ + '.'):\n"
        "    if not found.name.endswith('__main__'):\n"
        "        importlib.import_module(found.name)"
    )


def rooms(modules: set[str]) -> set[str]:
    """Which of the house's packages are among the modules."""
    return {name.partition(".")[0] for name in modules} & {"hil", "estimator", "device_emulator"}


@pytest.mark.long
def test_estimator_imports_neither_bench_nor_emulator() -> None:
    assert rooms(loaded_after_all_of("estimator")) == {"estimator"}


@pytest.mark.slow
def test_emulator_loads_no_estimator_and_of_the_bench_the_wire_only() -> None:
    modules = loaded_after_all_of("device_emulator")
    assert rooms(modules) == {"device_emulator", "hil"}
    assert {name for name in modules if name.startswith("hil.")} == {
        name for name in modules if name == "hil.wire" or name.startswith("hil.wire.")
    }


@pytest.mark.slow
def test_wire_imports_nothing_else_of_the_bench() -> None:
    modules = loaded_after_all_of("hil.wire")
    assert rooms(modules) == {"hil"}
    assert not [name for name in modules if name.startswith("hil.") and not name.startswith("hil.wire")]


@pytest.mark.long
def test_bench_does_not_import_the_emulator() -> None:
    assert "device_emulator" not in rooms(loaded_after_all_of("hil"))


@pytest.mark.moderate
def test_help_loads_nothing_heavy() -> None:
    assert not loaded_after("import hil.cli\nassert hil.cli.execute(['--help']) == 0") & HEAVY


ROOT = Path(__file__).parents[1]
INSIDE = {"_p", "_c", "_record", "_memory", "_intensity", "_start", "_prior", "_spread", "_table", "_motion_spread"}


@pytest.mark.slow
def test_nobody_reaches_into_an_observer() -> None:
    """What an observer keeps is its own: others ask it by its verbs, and who calls a kernel with it takes `arrays`."""
    from estimator.observer import Observer
    from estimator.settings import ObserverSettings
    from tests.estimator.device import UNLIKE

    own = vars(Observer(UNLIKE, ObserverSettings()))
    assert own.keys() >= INSIDE
    assert not own.keys() & {name.lstrip("_") for name in INSIDE}
    found = []
    for room in ("estimator", "hil", "device_emulator", "benchmarks", "tests"):
        for path in (ROOT / room).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            if path == ROOT / "estimator" / "observer.py" or not re.search(r"\bobserver\b", text, re.IGNORECASE):
                continue
            for node in ast.walk(ast.parse(text)):
                reaches = isinstance(node, ast.Attribute) and node.attr in INSIDE
                if reaches and ast.unparse(node.value) not in ("self", "cls"):
                    found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    assert not found


@pytest.mark.moderate
def test_only_who_calls_the_core_takes_the_arrays_of_an_observer() -> None:
    for room in ("estimator", "hil"):
        for path in (ROOT / room).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            if "observer.arrays" in text or "loop.arrays" in text:
                assert "from estimator.core" in text or path.parent.name == "generating", path
