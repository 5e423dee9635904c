"""What a page repeats is what the code has: what a calibration assumes, what tracing goes by, which variables of the
environment are read.
"""

import ast
import math
import re
from pathlib import Path

import pytest

from estimator.trace import checks, likelihood, search
from estimator.trace.likelihood import TIE
from estimator.trace.verdict import MOST
from hil.bench.calibration import ASSUMED, Assumed, Calibration
from tests.test_doc_links import ROOMS

TREE = Path(__file__).parents[1]
DOCS = TREE / "docs"
EXPLANATION = (DOCS / "explanation.md").read_text(encoding="utf-8")


def of_page(one: Assumed) -> str:
    if one.unit == "s":
        return f"{1e3 * one.value:g} mrad of the resonance"
    return f"{1e2 * one.value:g} %" if one.value >= 1e-3 else f"{1e6 * one.value:g} ppm"


def of_key(one: Assumed) -> str:
    if one.unit == "s":
        return of_page(one)
    return f"{one.value:g}".replace("e-0", "e-")


def test_the_explanation_lists_what_a_calibration_assumes_and_why() -> None:
    rows = [f"| {name.replace('_', ' ')} | {of_page(one)} | {one.why} |" for name, one in ASSUMED.items()]
    head = "| constant | assumed, standard | because |\n|---|---|---|\n"
    assert head + "\n".join(rows) + "\n\n" in EXPLANATION


@pytest.mark.parametrize("name", ASSUMED)
def test_a_key_of_the_calibration_says_what_is_assumed_without_it(name: str) -> None:
    one = ASSUMED[name]
    key = Calibration.model_fields[f"{name}_u{'_s' if one.unit == 's' else ''}"]
    assert " ".join((key.description or "").split()).endswith(f"without it {of_key(one)} is assumed")


def test_pages_repeat_what_the_tracer_decides_by_as_it_is() -> None:
    """Search and checks, each with its threshold."""
    assert f"2 ln(kinds / {power(likelihood.RARE)})" in EXPLANATION
    assert (
        f"The {('', 'one', 'two', 'three', 'four', 'five', 'six')[search.SHORTLIST]} kinds with the largest gains"
        in EXPLANATION
    )
    assert f"comes within {TIE:g}, odds" in " ".join(EXPLANATION.split())
    table = (DOCS / "reference" / "trace.md").read_text(encoding="utf-8")
    assert f"less than {likelihood.AT_FLOOR:g} × the noise floor" in table
    assert f"more than {checks.PRIOR:g} standard deviations from what the bench file declares" in table
    assert f"negative by more than {search.FORBIDDEN:.3g} standard deviations" in table
    assert f"less than {100.0 * checks.DISTURBANCE:g} % of the innovation's power" in table
    assert f"one of {power(1.0 / likelihood.RARE)} records" in table
    assert MOST == 0.5
    assert "more than half of the residual's power above the noise floor" in " ".join(table.split())


def power(of_ten: float) -> str:
    """Such a number, as pages have it."""
    exponent = round(math.log10(of_ten))
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


_VARIABLE = re.compile(r"(?:GYROHIL|HIL)_[A-Z_]+")


def variables_read(source: str) -> set[str]:
    """Names in `environ[NAME]`, `environ.get(NAME, …)` and `NAME in environ`; NAME may be a constant of the module."""
    tree = ast.parse(source)
    constants = {
        target.id: statement.value.value
        for statement in tree.body
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant)
        for target in statement.targets
        if isinstance(target, ast.Name)
    }
    asked: list[ast.expr] = []
    for node in ast.walk(tree):
        match node:
            case ast.Subscript(value=ast.Attribute(attr="environ"), slice=name, ctx=ast.Load()):
                asked.append(name)
            case ast.Call(func=ast.Attribute(value=ast.Attribute(attr="environ"), attr="get"), args=[name, *_]):
                asked.append(name)
            case ast.Compare(left=name, comparators=[ast.Attribute(attr="environ")]):
                asked.append(name)
    names = [constants.get(one.id) if isinstance(one, ast.Name) else getattr(one, "value", None) for one in asked]
    return {name for name in names if isinstance(name, str) and _VARIABLE.fullmatch(name)}


def test_a_variable_is_read_by_its_name_or_by_a_constant() -> None:
    source = """
NAME = "HIL_A"
a = os.environ[NAME], os.environ.get("GYROHIL_B", ""), "HIL_C" not in os.environ, os.environ["HOME"]
os.environ["HIL_SET"] = "HIL_OTHER"
"""
    assert variables_read(source) == {"HIL_A", "GYROHIL_B", "HIL_C"}


@pytest.mark.moderate
def test_the_page_of_environment_variables_lists_those_that_are_read() -> None:
    read = set()
    for room in ROOMS:
        for module in (TREE / room).rglob("*.py"):
            source = module.read_text(encoding="utf-8")
            if "environ" in source and "HIL_" in source:
                read |= variables_read(source)
    listed = re.findall(
        r"^\| `(\w+)` \|", (DOCS / "reference" / "environment.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert sorted(listed) == sorted(read)
