"""The numbers that tracing goes by: each with its reason, published, and written into a diagnosis."""

import ast
import re
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import pytest

from estimator.thresholds import THRESHOLDS, values

ROOT = Path(__file__).parents[2]


def test_every_threshold_says_its_unit_and_its_reason_in_one_sentence() -> None:
    for group in fields(THRESHOLDS):
        for one in fields(getattr(THRESHOLDS, group.name)):
            assert one.metadata["unit"], one.name
            assert one.metadata["reason"].endswith("."), one.name
            assert ". " not in one.metadata["reason"], one.name


def test_no_module_of_the_residual_has_a_tuned_number_of_its_own() -> None:
    """A constant of a module that is a number, or several, is a threshold; but for the listed ones, each with why."""
    facts = {
        ("analysis", "FALSE_ALARM"),  # of findings, on which no verdict hangs, as of the four below
        ("analysis", "_SHOWN"),
        ("spectrum", "BAND"),
        ("spectrum", "_LISTED"),
        ("analysis", "_FAMILIES"),  # how many kinds of finding the module has
        ("analysis", "_SMALLEST_POWER"),  # of a text
        ("spectrum", "_CORRELATED"),  # of a Hann window, as of the one below
        ("spectrum", "LOBE"),
    }
    found = {(module, name) for module, name, _ in _numbers(ROOT / "estimator" / "residual")}
    assert found == facts


def test_each_number_of_the_tracer_has_its_reason_beside_it() -> None:
    numbers = _numbers(ROOT / "estimator" / "trace")
    assert len(numbers) > 10
    assert [(module, name) for module, name, reason in numbers if not reason] == []


def _numbers(room: Path) -> list[tuple[str, str, bool]]:
    """Constants of the modules of a room that are numbers: module, name, and whether a docstring below or a comment on
    the line or above says why."""
    found = []
    for module in sorted(room.glob("*.py")):
        text = module.read_text(encoding="utf-8")
        lines, body = text.splitlines(), ast.parse(text).body
        for statement, following in pairwise([*body, ast.Pass()]):
            if isinstance(statement, ast.Assign) and any(_number(node) for node in _parts(statement.value)):
                told = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
                beside = lines[max(statement.lineno - 2, 0) : statement.lineno]
                reason = told or "#" in beside[-1] or beside[0].lstrip().startswith("#")
                found += [(module.stem, name.id, reason) for name in statement.targets if isinstance(name, ast.Name)]
    return found


def _parts(value: ast.expr) -> list[ast.expr]:
    return list(value.elts) if isinstance(value, ast.Tuple) else [value]


def _number(value: ast.expr) -> bool:
    match value:
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=operand):
            return _number(operand)
        case ast.BinOp(left=left, right=right):
            return _number(left) and _number(right)
    return False


@pytest.mark.moderate
def test_every_threshold_is_read_somewhere() -> None:
    """By its group's name, or by that of the group which a module goes by."""
    read = set()
    for module in (ROOT / "estimator").rglob("*.py"):
        source = module.read_text(encoding="utf-8")
        read |= {f"{group}.{name}" for group, name in re.findall(r"THRESHOLDS\.(\w+)\.(\w+)", source)}
        for short, group in re.findall(r"^(\w+) = THRESHOLDS\.(\w+)$", source, re.MULTILINE):
            read |= {f"{group}.{name}" for name in re.findall(rf"\b{short}\.(\w+)", source)}
    assert {f"{group}.{name}" for group, own in values(THRESHOLDS).items() for name in own} - read == set()
