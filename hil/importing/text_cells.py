"""Lines of delimited text as cells, and cells as numbers: strictly, and none as what it may not be."""

import csv
import math
import re
from collections.abc import Sequence
from functools import cache

from hil.importing.mapping import RecordMap
from hil.toml.reading import toml_value

_LONGEST, _LONGEST_WORD = 131_072, 24
THOUSANDS = (",", ".", "'", "\u2019", " ", "\u00a0", "\u202f")
_BLANK_CELLS = re.compile(r'"([^"]*)"(?=\s|$)|(\S+)')
_FORTRAN = re.compile(r"([+-]?(?:\d+\.\d*|\.\d+))[dD]([+-]?\d+)")
"""A number of Fortran in double precision."""
NO_NUMBERS = re.compile(r"[_\s]|[^\x00-\x7f]")


class NotCells(ValueError):
    """A line that cannot be cut into cells; the message says why, with the remedy."""


class Cells:
    """How a text's map cuts lines and reads numbers."""

    def __init__(self, mapping: RecordMap) -> None:
        self.delimiter, self.quote = mapping.delimiter, mapping.quote
        self.comment = mapping.comment
        self.decimal = mapping.decimal or "."
        missing = mapping.missing or ()
        self._missing_texts = {code.strip().casefold() for code in missing if isinstance(code, str)}
        self._missing_numbers = {code for code in missing if not isinstance(code, str)}

    def is_left_out(self, line: str) -> bool:
        return not line.strip() or (self.comment is not None and line.lstrip().startswith(self.comment))

    def of(self, line: str) -> list[str]:
        """The cells of a line, as they stand. Raises NotCells for a quote that is not closed on it."""
        quoted = bool(self.quote) and self.quote in line
        if self.delimiter == " ":
            if not quoted or self.quote != '"':
                return line.split()
            return [inner or outer for inner, outer in _BLANK_CELLS.findall(line)]
        if not quoted:
            return line.split(self.delimiter)
        reader = csv.reader([line], delimiter=self.delimiter, quotechar=self.quote, strict=True)
        try:
            cells = next(reader)
        except csv.Error as error:
            if "limit" in str(error):
                raise NotCells(f"not delimited text ({error}); give a CSV file") from None
            raise NotCells(
                f"a quote ({self.quote}) that is not closed, or stands within a cell; "
                'mend the line, or set quote = "" where quotes are letters'
            ) from None
        return cells

    def names(self, line: str) -> list[str]:
        """The cells of a header; delimiters at its end add none."""
        names = [cell.strip() for cell in self.of(line)]
        while len(names) > 1 and not names[-1]:
            names.pop()
        return names

    def number(self, cell: str, thousands: str | None = None) -> float:
        """A cell as a number, NaN where the map says it is no measurement. Raises ValueError with what is wrong."""
        text = cell.strip()
        if text.casefold() in self._missing_texts:
            return math.nan
        if not text:
            raise ValueError("the cell is empty")
        if len(text) > _LONGEST:
            raise ValueError("not delimited text (a cell is longer than a line may be)")
        plain = text
        if thousands is not None and thousands in plain:
            if not _grouped(thousands, self.decimal).fullmatch(plain):
                raise ValueError(f"{shown(text)} is not a number whose thousands stand in groups of three")
            plain = plain.replace(thousands, "")
        if self.decimal != ".":
            if "." in plain:
                raise ValueError(f"{shown(text)} is not a number with a decimal comma")
            plain = plain.replace(self.decimal, ".")
        plain = with_e(plain)
        if NO_NUMBERS.search(plain):
            raise ValueError(f"{shown(text)} is not a number")
        try:
            value = float(plain)
        except ValueError:
            raise ValueError(f"{shown(text)} is not a number") from None
        if value in self._missing_numbers:
            return math.nan
        if not math.isfinite(value):
            raise ValueError(f"{shown(text)} is not finite")
        return value

    def digits(self, cell: str, thousands: str | None = None) -> str:
        """A cell without separators of thousands and with a decimal point, to be read exactly."""
        without = cell.strip().replace(thousands or "\0", "")
        return with_e(without if self.decimal == "." else without.replace(self.decimal, "."))

    def is_missing(self, cell: str) -> bool:
        """Whether the map says so of a cell that may be a text."""
        return cell.strip().casefold() in self._missing_texts


def with_e(number: str) -> str:
    """A number as it is, its exponent after an E where Fortran has a D."""
    found = _FORTRAN.fullmatch(number)
    return number if found is None else f"{found[1]}E{found[2]}"


def remedy_for(cell: str, *, mapped: bool) -> str:
    """What may be done about a cell that is no number: groups of thousands, or words for no measurement, have a key."""
    text, where = cell.strip(), "" if mapped else " in a map given as --map"
    for mark in THOUSANDS:
        if _grouped(mark, "," if mark == "." else ".").fullmatch(text):
            return f'set thousands = "{mark}" of this column{where}, or mend the row'
    if not any(letter.isdigit() for letter in text) and len(text) <= _LONGEST_WORD:
        return f"mend or remove the row, or set missing = [{toml_value(text)}]{where} to have such rows as lost"
    return "mend or remove the row"


@cache
def _grouped(thousands: str, decimal: str) -> re.Pattern[str]:
    """Numbers whose thousands are apart; where the mark is the decimal's, without decimals."""
    rest = rf"(?:{re.escape(decimal)}\d*)?" if thousands != decimal else ""
    return re.compile(rf"[+-]?\d{{1,3}}(?:{re.escape(thousands)}\d{{3}})+{rest}")


def shown(cell: str) -> str:
    return repr(cell if len(cell) <= 24 else cell[:24] + "…")


def extra_cells(cells: Sequence[str], width: int) -> bool:
    """Whether a row has cells beyond its header that are not empty."""
    return len(cells) > width and any(cell.strip() for cell in cells[width:])
