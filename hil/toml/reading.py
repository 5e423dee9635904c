"""Read a TOML file into a pydantic model; every mistake is one line that names file, key and remedy.

pydantic reports several errors at once, each as a paragraph.  A user mends one key at a time, so only the
first is shown, with a count of the others: ``file: [section] key: what is wrong; what was expected``.
"""

import ast
import difflib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError

from hil.errors import InputError
from hil.options import chosen, declared, keywords_of
from hil.wire.regular_file import what_instead
from hil.wire.toml_bounds import MOST_BYTES, beyond

Model = TypeVar("Model", bound=BaseModel)

_TWICE = re.compile(r"Cannot (?:declare (\(.+\)) twice|overwrite a value) \((at .+?)(?:, column \d+)?\)")
_MOST, _NEAREST = 25, 5
"""Of a longer list than the keys of a table have, so many are told."""
_EXPECTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "path_type": "a path",
    "tuple_type": "a list of numbers",
    "model_type": "a table",
    "dict_type": "a table",
    "finite_number": "a finite number",
}


def read_toml(path: Path, model: type[Model]) -> Model:
    """The file at ``path`` as an instance of ``model``; `InputError` names the place and the remedy."""
    return parse_table(read_table(path), model, str(path))


def read_table(path: Path) -> dict[str, Any]:
    """The file at ``path`` as plain tables; `InputError` when it is not TOML."""
    try:
        if kind := what_instead(path):
            raise InputError(f"{path}: is {kind}; give a TOML file")
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: {(error.strerror or 'cannot be read').lower()}") from None
    return table_of(raw, str(path))


def table_of(raw: bytes, source: str) -> dict[str, Any]:
    """TOML text as plain tables, `InputError` when it is none, or beyond any file of a bench; `source` is the name that
    stands before the error.
    """
    if len(raw) > MOST_BYTES:
        raise InputError(f"{source}: longer than {MOST_BYTES >> 20} MB, which no such file is; give a TOML file")
    try:
        text = raw.decode("utf-8-sig")  # editors put a byte order mark before
        if said := beyond(text):
            raise InputError(f"{source}: not TOML that can be used: {said}")
        return tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise InputError(f"{source}: byte {error.start} is not UTF-8; a TOML file is UTF-8 text") from None
    except RecursionError:
        raise InputError(f"{source}: not TOML that can be used: nested too deeply; write it flat") from None
    except ValueError as error:  # tomllib's own, and Python's of a number with thousands of digits
        raise InputError(f"{source}: not TOML: {_in_words(str(error))}") from None


def _in_words(error: str) -> str:
    """What tomllib says of a table or a key that is there twice, as one says it; all else as it is."""
    if found := _TWICE.fullmatch(error):
        table = ".".join(toml_key(part) for part in ast.literal_eval(found[1])) if found[1] else ""
        what, remedy = (f"[{table}]", "put its keys into one") if table else ("a key or a table", "take one out")
        return f"{what} is declared twice ({found[2]}); {remedy}"
    return error


def parse_table(table: Mapping[str, Any], model: type[Model], source: str) -> Model:
    """``table`` checked against ``model``; ``source`` is the name that stands before each error.

    Numbers and arrays of NumPy, which a program may have put there, are taken as Python's.
    """
    try:
        return model.model_validate(_plain(table))
    except ValidationError as error:
        raise InputError(f"{source}: {one_line(error, model)}") from None
    except RecursionError:
        raise InputError(f"{source}: nested too deeply; write it flat") from None


def checked(options: type, given: Mapping[str, Any]) -> dict[str, Any]:
    """`hil.options.chosen`, each held against its declaration; `InputError` names the first that is something else."""
    found = chosen(options, given)
    for one in keywords_of(options):
        try:
            if found[one.name] != one.default:
                found[one.name] = TypeAdapter(declared(one)).validate_python(_plain(found[one.name]))
        except ValidationError as error:
            said = _said_of(error.errors(include_url=False)[0])
            raise InputError(f"--{one.called.name.replace('_', '-')}: {said}") from None
    return found


def _plain(value: Any) -> Any:
    """`value` with NumPy's scalars and arrays as numbers and lists; known by what both have, as TOML needs no NumPy."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(map(_plain, value))
    return value.tolist() if hasattr(value, "tolist") else value


def one_line(error: ValidationError, model: type[BaseModel]) -> str:
    """The first mistake of ``error`` as one line, unknown keys first: they explain missing ones."""
    mistakes = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    text = _sentence(mistakes[0], model)
    others = len(mistakes) - 1
    return f"{text} (and {others} more)" if others else text


def near_or_all(word: str, there: Sequence[str]) -> str:
    """As `suggestion`, of the columns of a file."""
    near = difflib.get_close_matches(word, there, n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}?" if near else f"the file has: {', '.join(there)}"


def suggestion(word: str, known: Sequence[str]) -> str:
    """``did you mean …?`` for a near miss, otherwise the list of what is known, of a long one the nearest."""
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]}?"
    if len(known) > _MOST:
        nearest = difflib.get_close_matches(word, known, n=_NEAREST, cutoff=0.0)
        return f"the nearest of {len(known)} known: {', '.join(nearest)}"
    return f"known: {', '.join(known)}" if known else "none is known"


def _sentence(mistake: Any, model: type[BaseModel]) -> str:
    """One pydantic error as ``[section] key: message``."""
    *parents, last = mistake["loc"] or ("",)
    kind, value, context = mistake["type"], mistake["input"], mistake.get("ctx", {})
    table = _model_at(model, parents)
    place = _place(model, mistake["loc"])
    if kind == "value_error":  # a validator of ours: its message already begins with the key, or with [section] key
        message = str(context["error"])
        return message if message.startswith("[") else place + message
    if kind == "extra_forbidden":
        known = [] if table is None else [*table.model_fields, *_other_keys(table)]
        section = isinstance(value, dict)
        return f"{place}unknown {'section' if section else 'key'}; {suggestion(str(last), known)}"
    if kind == "missing":
        field = table.model_fields.get(str(last)) if table is not None else None
        meaning = f"; expected: {field.description}" if field is not None and field.description else ""
        return f"{place}missing{meaning}"
    return place + _said_of(mistake)


def _said_of(mistake: Any) -> str:
    """What is wrong with the value of a pydantic error, and what was expected."""
    kind, value = mistake["type"], mistake["input"]
    if kind == "literal_error":
        choices = mistake["ctx"]["expected"].replace("'", "").replace(" or ", ", ").split(", ")
        return f"{_shown(value)} is not one of {', '.join(choices)}{_near(value, choices)}"
    if kind in _EXPECTED:
        return f"expected {_EXPECTED[kind]}, not {_shown(value)}"
    return f"{_shown(value)} {str(mistake['msg']).removeprefix('Input ').removeprefix('String ')}"


def _other_keys(table: type[BaseModel]) -> list[str]:
    """Keys that a table takes in place of its fields, as a bench file's do."""
    return list(getattr(table, "other_keys", dict)())


def _near(value: Any, choices: Sequence[str]) -> str:
    near = difflib.get_close_matches(value, choices, n=1) if isinstance(value, str) else []
    return f"; did you mean {near[0]}?" if near else ""


def _shown(value: Any) -> str:
    """A value as the user may have typed it, cut to what fits a line."""
    text = {True: "true", False: "false"}[value] if isinstance(value, bool) else repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _place(model: type[BaseModel], loc: Sequence[str | int]) -> str:
    """``[device.sense] noise_V: `` from a pydantic location; list positions as ``key[1]``."""
    sections: list[str] = []
    key = ""
    for part in loc:
        if isinstance(part, int):
            key += f"[{part}]"
        elif not key and _table_at(model, [*sections, part]) is not None:
            sections.append(part)
        else:
            key = f"{key}.{part}" if key else part
    head = f"[{'.'.join(sections)}]" if sections else ""
    if not key:
        return f"{head} " if head else ""
    if not head and "." not in key:
        return f"[{key}]: "
    return f"{head} {key}: ".lstrip()


def _model_at(model: type[BaseModel], loc: Sequence[str | int]) -> type[BaseModel] | None:
    """The nested model class that a location leads to, or None where it leaves the models."""
    table = _table_at(model, loc)
    return table if _is_model(table) else None


def _table_at(model: type[BaseModel], loc: Sequence[str | int]) -> Any:
    """The model class, or the dictionary of them, that a location leads to; None where it leaves both."""
    table: Any = model
    for part in loc:
        if get_origin(table) is dict:
            inner = [get_args(table)[1]]
        else:
            field = table.model_fields.get(str(part))
            inner = [] if field is None else [field.annotation, *get_args(field.annotation)]
        table = next((one for one in inner if get_origin(one) is dict or _is_model(one)), None)
        if table is None:
            return None
    return table


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def toml_value(value: Any) -> str:
    """A scalar or a list of scalars in TOML.

    >>> toml_value([True, 1e-3, "a"])
    '[true, 0.001, "a"]'
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    return repr(value)


def toml_key(name: str) -> str:
    """A key of TOML, in quotes where it is not bare.

    >>> toml_key("interference"), toml_key("interference:2")
    ('interference', '"interference:2"')
    """
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_value(name)
