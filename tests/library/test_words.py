"""What the library says of its arguments is held against their signatures: no message names one that there is not."""

import ast
import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hil
from estimator.errors import ModelError
from hil.cli.app import VERBS
from hil.errors import InputError, told_to_user
from hil.library.keywords import in_arguments_of
from hil.wire.errors import LinkError

ROOT = Path(hil.__file__).parent
FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: value for name in hil.__all__ if inspect.isfunction(value := getattr(hil, name))
}
NAMED = re.compile(r"\b([a-z_][A-Za-z0-9_]*)=(?=[\s;,)]|True|$)")
OPTION = re.compile(r"(?<!\S)--([a-z][a-z0-9-]*)")
ASKED = {"require", "path_of", "folder_of", "bench_file", "_names"}


def sources(*folders: str) -> Iterator[tuple[Path, ast.Module]]:
    """Modules of the bench, parsed."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path, ast.parse(path.read_text(encoding="utf-8"))


def texts(tree: ast.AST) -> Iterator[str]:
    """Every text in a module, with 7 for what is put in."""
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "7" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def said(function: Callable[..., Any], line: str) -> str:
    """The line as a caller of the function reads it."""
    with pytest.raises(InputError) as told, in_arguments_of(function):
        raise InputError(line)
    return str(told.value)


@pytest.fixture(scope="module")
def options() -> set[str]:
    """Of every text of the bench."""
    return {f"give --{option}" for _, tree in sources("") for text in texts(tree) for option in OPTION.findall(text)}


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_no_option_in_a_message_becomes_an_argument_that_there_is_not(name: str, options: set[str]) -> None:
    function = FUNCTIONS[name]
    known = set(inspect.signature(function).parameters)
    assert len(options) > 40
    for line in options:
        told = said(function, line)
        assert set(NAMED.findall(told)) <= known, told
        assert told == line or NAMED.search(told), told


@pytest.mark.parametrize(
    ("function", "option", "argument"),
    [
        (hil.replay, "--map", "mapping="),
        (hil.trace, "--map", "mapping="),
        (hil.compare, "--map", "mapping="),
        (hil.run, "--duration", "duration_s="),
        (hil.run, "--wire-log", "wire_log="),
        (hil.trace, "--missing-force", "missing_force="),
        (hil.replay, "--nonuniform", "nonuniform="),
        (hil.trace, "--hold-out", "hold_out="),
        (hil.trace, "--covariate", "covariate="),
        (hil.run, "--replace", "replace="),
    ],
)
def test_an_option_is_said_as_the_argument_that_does_the_same(
    function: Callable[..., Any], option: str, argument: str
) -> None:
    assert said(function, f"give {option}") == f"give {argument}"


def test_every_option_that_the_function_of_its_verb_has_too_is_found() -> None:
    found = 0
    for verb in VERBS:
        function = FUNCTIONS.get(verb.__name__)
        if function is None:
            continue
        shared = set(inspect.signature(function).parameters) & set(inspect.signature(verb).parameters)
        for argument in shared:
            assert said(function, f"give --{argument.replace('_', '-')}") == f"give {argument}="
        found += len(shared)
    assert found > 30


def test_what_the_library_names_itself_is_an_argument_of_some_function() -> None:
    known = {name for function in FUNCTIONS.values() for name in inspect.signature(function).parameters}
    named = set()
    for path, tree in (*sources("library"), *sources("running")):
        if path.parent.name == "running" and path.name != "request.py":
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Raise):
                named |= {(path.name, word) for text in texts(node) for word in NAMED.findall(text)}
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ASKED:
                first = node.args[0]
                named |= {(path.name, first.value)} if isinstance(first, ast.Constant) else set()
        if path.name == "given.py":
            named |= {(path.name, word) for text in texts(tree) for word in NAMED.findall(text)}
    words = {word for _, word in named}
    assert {"arm", "nonuniform", "mapping", "truth", "out"} <= words
    assert words <= known, sorted(words - known)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("--fraction: 2 is no share of the record", "fraction: 2 is no share of the record"),
        ("f: exists already; give another --out, or remove it", "f: exists already; give another out=, or remove it"),
        (
            "f: torn; hil check --repair keeps the rows before it",
            "f: torn; hil check --repair keeps the rows before it",
        ),
        ("a--b.toml: no such file", "a--b.toml: no such file"),
    ],
)
def test_the_command_line_prints_the_options(line: str, told: str) -> None:
    with pytest.raises(InputError) as raised, in_arguments_of(hil.trace):
        raise InputError(line)
    assert str(raised.value) == told
    assert told_to_user(raised.value) == line  # its verbs call the same functions


def test_arrays_with_a_missing_mark_are_told_the_masking_argument(tmp_path: Path) -> None:
    time = np.arange(400) / 4000.0
    values = np.where(np.arange(400) == 7, 9.9e37, np.sin(400.0 * time))
    arrays = {"t_s": time, "vx_V": values, "vy_V": np.cos(400.0 * time)}
    for verb in (hil.replay, hil.trace):
        with pytest.raises(InputError, match=r"in a map given as mapping= to have its rows as lost"):
            verb(arrays, "s-slow", out=tmp_path)


def test_what_a_user_can_mend_is_an_input_error_and_a_link_stays_one() -> None:
    with pytest.raises(InputError, match="no such thing"), in_arguments_of(hil.run):
        raise ModelError("no such thing")
    with pytest.raises(InputError, match="no such file"), in_arguments_of(hil.run):
        Path("/absent/file").read_text(encoding="utf-8")
    with pytest.raises(LinkError, match="--link"), in_arguments_of(hil.run):
        raise LinkError("--link")
    with pytest.raises(ZeroDivisionError), in_arguments_of(hil.run):
        raise ZeroDivisionError
