"""What the structure of a text asks for, as keys of a map: lines before the table, marks, names, units."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from hil.errors import InputError
from hil.importing.mapping import OF_TEXT, RecordMap
from hil.importing.text_cells import Cells, NotCells, with_e
from hil.importing.text_lines import beginning_of
from hil.toml.reading import toml_value

_DELIMITERS = (",", ";", "\t", "|", " ")
_COMMENTS = ("#", "%", "//", "!", "*", "'", ";")
_SHARE = 0.9
"""Of its lines, so many cells of a column of numbers are numbers."""
_FEWEST = 2
_DATE = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d.*)?|\d\d:\d\d:\d\d.*")
_UNIT_WORDS = {
    *("s", "sec", "second", "seconds", "ms", "us", "ns", "min", "h", "hz", "sequence", "counts", "count", "lsb"),
    *("v", "volt", "volts", "mv", "uv", "µv", "a", "ma", "n", "mn", "m", "mm", "um", "µm", "nm", "px", "g", "mg"),
    *("m/s", "mm/s", "m/s^2", "m/s²", "rad", "deg", "°", "rad/s", "deg/s", "°/s", "dps", "mdps", "rpm", "db", "dbv"),
    *("c", "degc", "°c", "k", "%", "-", "none", "1"),
}


class Structure(NamedTuple):
    """Keys of a map that a text asks for, where they are not as without a map, and the names of its columns."""

    keys: dict[str, object]
    names: Sequence[str]

    def words(self, given: RecordMap) -> str:
        """What to do to the map `given`, so that it says all that; nothing where it does."""
        differing = {}
        for key in OF_TEXT:
            wanted = self.keys.get(key, RecordMap.model_fields[key].default)
            said = getattr(given, key)
            if wanted != said and not (key == "decimal" and {wanted, said} <= {None, "."}):
                differing[key] = wanted
        if not differing:
            return ""
        verb = "set" if given.columns is not None or given.model_fields_set - {"hold"} else "give a --map with"
        told = [f"{key} = {toml_value(value)}" for key, value in differing.items() if value is not None]
        without = [key for key, value in differing.items() if value is None]
        said = " and ".join(
            [f"{verb} {', '.join(told)}"] * bool(told) + [f"leave {', '.join(without)} out"] * bool(without)
        )
        if self.keys.get("header", True):
            return f"{said}; its columns are then {', '.join(self.names)}"
        return f"{said}; give its {len(self.names)} columns by position"


def asked_for(path: Path, given: RecordMap) -> str:
    """The keys that would read the text at `path`, where `given` has others; empty where it has these, or nothing is
    found out.
    """
    found = structure_of(path, given)
    return "" if found is None else found.words(given)


def structure_of(path: Path, given: RecordMap) -> Structure | None:
    """The structure of a text: the one by which most cells of its table are numbers."""
    try:
        text = beginning_of(path, given.encoding)
    except InputError:
        return None
    lines = text.split("\n")[:-1] if text.endswith("\n") else text.split("\n")
    best: tuple[float, Structure] | None = None
    for delimiter in _DELIMITERS:
        for decimal in (".", ","):
            if decimal == delimiter:
                continue
            found = _by(lines, delimiter, decimal, given)
            if found is not None and (best is None or found[0] > best[0]):
                best = found
    return None if best is None else best[1]


def _by(lines: Sequence[str], delimiter: str, decimal: str, given: RecordMap) -> tuple[float, Structure] | None:
    """How well a table is read if it is written so, and its structure."""
    keys: dict[str, object] = {}
    marked = _comments_in(lines)
    numbered = [(at, line) for at, line in enumerate(lines) if line.strip()]
    rows = [
        (at, _cells(line, delimiter, given))
        for at, line in numbered
        if not (marked and line.lstrip().startswith(marked))
    ]
    if len(rows) < _FEWEST:
        return None
    tail = rows[len(rows) // 2 :]
    width = max(len(cells) for _, cells in tail)
    filled = [index for index in range(width) if _share(tail, index, decimal) >= _SHARE]
    if not filled or not any(
        _is_number(cells[index], decimal) for _, cells in tail for index in filled if index < len(cells)
    ):
        return None
    first = len(rows)
    while first and _is_row(rows[first - 1][1], filled, decimal):
        first -= 1
    if len(rows) - first < _FEWEST or any(
        all(index < len(cells) and _is_datum(cells[index], decimal) for index in filled) for _, cells in rows[:first]
    ):
        return None  # a row that is one cannot be before the table
    table = [cell for _, cells in rows[first:] for cell in cells if cell]
    data = sum(_is_datum(cell, decimal) for cell in table)
    score = data * data / len(table)  # numbers, and the share of cells that are
    # of the lines before, the last is a header, or the one before that and a line of units
    before = [(at, _cells(line, delimiter, given)) for at, line in numbered if at < rows[first][0]]
    enough = max(filled) + 1
    comment_within = marked is not None and any(
        line.lstrip().startswith(marked) for at, line in numbered if at > rows[first][0]
    )
    heads = [(at, cells) for at, cells in before if len(cells) >= enough]
    if comment_within:
        heads = [(at, cells) for at, cells in heads if not lines[at].lstrip().startswith(marked or "\0")]
    names: Sequence[str]
    if heads and heads[-1][0] == before[-1][0] and _all_words(heads[-1][1][:enough], decimal):
        head = heads[-1]
        if len(heads) > 1 and heads[-2][0] == before[-2][0] and _are_units(head[1][:enough]):
            head = heads[-2]
            keys["units_row"] = True
        names = head[1]
        skipped = head[0]
    else:
        keys["header"] = False
        names = [str(place) for place in range(1, width + 1)]
        skipped = rows[first][0]
    early = [line for at, line in numbered if at < skipped]
    if _leaves_out(given, numbered, skipped, marked if comment_within else None):
        keys |= {key: value for key in ("skip_lines", "comment") if (value := getattr(given, key))}
    elif (
        marked
        and all(line.lstrip().startswith(marked) for line in early)
        and (comment_within or (early and "header" in keys))
    ):
        keys["comment"] = marked
    elif early:
        keys["skip_lines"] = skipped
    elif comment_within:
        keys["comment"] = marked
    if delimiter != ",":
        keys["delimiter"] = delimiter
    if decimal != ".":
        keys["decimal"] = decimal
    if given.encoding != "utf-8":
        keys["encoding"] = given.encoding
    if given.quote != '"':
        keys["quote"] = given.quote
    return score, Structure(keys, names)


def _leaves_out(given: RecordMap, numbered: Sequence[tuple[int, str]], head: int, marked: str | None) -> bool:
    """Whether a map leaves out the lines before line `head`, and after it those that begin with `marked`, no other."""
    cells = Cells(given)
    kept = [(at, line) for at, line in numbered if at >= given.skip_lines and not cells.is_left_out(line)]
    right = [(at, line) for at, line in numbered if at >= head and not (marked and line.lstrip().startswith(marked))]
    return kept == right


def _comments_in(lines: Sequence[str]) -> str | None:
    """The mark that comments begin with, where there are any."""
    return next((mark for mark in _COMMENTS if any(line.lstrip().startswith(mark) for line in lines)), None)


def _cells(line: str, delimiter: str, given: RecordMap) -> list[str]:
    how = given.model_copy(update={"delimiter": delimiter, "decimal": None})
    try:
        return Cells(how).names(line)
    except NotCells:
        return [cell.strip() for cell in line.split(delimiter)]


def _share(rows: Sequence[tuple[int, Sequence[str]]], index: int, decimal: str) -> float:
    return sum(index < len(cells) and _is_datum(cells[index], decimal) for _, cells in rows) / len(rows)


def _is_row(cells: Sequence[str], filled: Sequence[int], decimal: str) -> bool:
    data = [index < len(cells) and _is_datum(cells[index], decimal) for index in filled]
    return 2 * sum(data) >= len(filled) and data[0]


def _all_words(cells: Sequence[str], decimal: str) -> bool:
    return not any(_is_datum(cell, decimal) for cell in cells)


def _are_units(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are units: known ones, in brackets, or none; one at least."""
    plain = [cell.strip().strip("()[]").strip().casefold() for cell in cells]
    bracketed = [cell.strip()[:1] in "([" and cell.strip()[-1:] in ")]" for cell in cells if cell.strip()]
    return any(plain) and (
        all(not unit or unit in _UNIT_WORDS for unit in plain) or (bool(bracketed) and all(bracketed))
    )


def _is_datum(cell: str, decimal: str) -> bool:
    return _is_number(cell, decimal) or _DATE.fullmatch(cell.strip()) is not None


def _is_number(cell: str, decimal: str) -> bool:
    text = cell.strip().strip('"')
    if decimal == ",":
        if "." in text:
            return False
        text = text.replace(",", ".")
    if "_" in text or not text.isascii():
        return False
    try:
        float(with_e(text))
    except ValueError:
        return False
    return True
