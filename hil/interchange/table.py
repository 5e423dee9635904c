"""Read columns of numbers from a delimited text file, plain or gzipped, and say where it goes wrong."""

import csv
import gzip
import itertools
import math
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.interchange.fast_table import read_plain_columns

_CHUNK_ROWS = 16_384
_GZIP_MAGIC = b"\x1f\x8b"


@dataclass(frozen=True)
class Table:
    """Chosen columns of a file: `values` (rows, columns) and the line each row stood on."""

    values: npt.NDArray[np.float64]
    lines: npt.NDArray[np.int64]

    def part(self, start: int, stop: int | None) -> "Table":
        """Rows [start, stop)."""
        return Table(self.values[start:stop], self.lines[start:stop])


def read_header(path: Path, delimiter: str = ",", skip_lines: int = 0) -> list[str]:
    """Column names on the first line after `skip_lines`; a delimiter at its end adds no column."""
    with _text(path) as text:
        for number, cells in _rows(path, text, delimiter):
            if number > skip_lines:
                return _names(cells)
    raise InputError(f"{path}: empty; expected a header line and rows of numbers")


def read_columns(
    path: Path,
    columns: Sequence[int],
    names: Sequence[str],
    *,
    delimiter: str = ",",
    skip_lines: int = 0,
    header: bool = True,
    rows: tuple[int, int] | None = None,
    where: Mapping[int, str] | None = None,
) -> Table:
    """Read the columns with these indices; `names` are what errors call them.

    Every row must have as many cells as the first line (one empty cell more is forgiven: a delimiter at the
    end); other columns may hold anything. `where` keeps the rows whose cells, by column index, read so; `rows`
    keeps data rows [start, stop) of those, counted from 0. Raises InputError naming line and column for a cell
    that is no finite number.
    """
    start, stop = rows or (0, None)
    if not where and (plain := _plain(path, columns, delimiter, skip_lines, header)) is not None:
        kept_rows = plain.part(start, stop)
        if kept_rows.lines.size:
            return kept_rows
    values: list[npt.NDArray[np.float64]] = []
    lines: list[npt.NDArray[np.int64]] = []
    with _text(path) as text:
        numbered = ((number, cells) for number, cells in _rows(path, text, delimiter) if number > skip_lines)
        width = None
        if header:
            width = len(_names(next(numbered, (0, []))[1]))
        kept = (row for row in numbered if not where or _reads(row[1], where))
        wanted = itertools.islice(kept, start, stop)
        while chunk := list(itertools.islice(wanted, _CHUNK_ROWS)):
            width = width or len(_names(chunk[0][1]))
            _require_width(path, chunk, width)
            values.append(_numbers(path, chunk, columns, names))
            lines.append(np.array([number for number, _ in chunk]))
    if not values:
        among = "" if rows is None else f" in rows [{start}, {stop})"
        if where:
            among += " where " + ", ".join(f"column {column + 1} reads {text!r}" for column, text in where.items())
        raise InputError(f"{path}: no rows of numbers{among}; give a file that holds a record")
    return Table(np.concatenate(values), np.concatenate(lines))


def _plain(path: Path, columns: Sequence[int], delimiter: str, skip_lines: int, header: bool) -> Table | None:
    """The whole file, where it is as plain as most are: no blank line, and as many cells on each as on the first."""
    with _text(path) as text:
        first = next((row for row in _rows(path, text, delimiter) if row[0] > skip_lines), None)
    if first is None or first[0] != skip_lines + 1:
        return None
    skip = skip_lines + header
    width = len(_names(first[1]))
    values = read_plain_columns(path, columns, width=width, delimiter=delimiter, skip=skip)
    return None if values is None else Table(values, np.arange(skip + 1, skip + 1 + len(values)))


def _reads(cells: Sequence[str], where: Mapping[int, str]) -> bool:
    return all(column < len(cells) and cells[column].strip() == text for column, text in where.items())


def _names(cells: list[str]) -> list[str]:
    names = [cell.strip() for cell in cells]
    return names[:-1] if len(names) > 1 and not names[-1] else names


def _rows(path: Path, text: TextIO, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each line that is not blank."""
    reader = csv.reader(text, delimiter=delimiter)
    try:
        for cells in reader:
            if cells and (len(cells) > 1 or cells[0].strip()):
                yield reader.line_num, cells
    except csv.Error as error:
        raise InputError(f"{path}:{reader.line_num}: not delimited text ({error}); give a CSV file") from None
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: not UTF-8 text at or after line {reader.line_num + 1}; give CSV, plain or gzipped"
        ) from None
    except (OSError, EOFError, zlib.error):
        raise InputError(
            f"{path}: damaged or cut gzip data at or after line {reader.line_num + 1}; fetch the file again"
        ) from None


def _require_width(path: Path, chunk: list[tuple[int, list[str]]], width: int) -> None:
    for number, cells in chunk:
        extra = len(cells) - width
        if extra and not (extra == 1 and not cells[-1].strip()):
            problem = f"{len(cells)} cells where the first line has {width}"
            raise InputError(f"{path}:{number}: {problem}; mend the row")


def _numbers(
    path: Path, chunk: list[tuple[int, list[str]]], columns: Sequence[int], names: Sequence[str]
) -> npt.NDArray[np.float64]:
    try:
        values = np.array([[float(cells[column]) for column in columns] for _, cells in chunk])
    except ValueError:
        pass
    else:
        if np.isfinite(values).all():
            return values
    raise InputError(_first_fault(path, chunk, columns, names))


def _first_fault(path: Path, chunk: list[tuple[int, list[str]]], columns: Sequence[int], names: Sequence[str]) -> str:
    for (number, cells), (column, name) in itertools.product(chunk, zip(columns, names, strict=True)):
        cell = cells[column].strip()
        shown = cell if len(cell) <= 24 else cell[:24] + "…"
        try:
            value = float(cell)
        except ValueError:
            problem = f"{shown!r} is not a number" if cell else "the cell is empty"
            return f"{path}:{number}: column {name}: {problem}; mend or remove the row"
        if not math.isfinite(value):
            return f"{path}:{number}: column {name}: {shown!r} is not finite; mend or remove the row"
    raise AssertionError("called for a chunk without a fault")


@contextmanager
def _text(path: Path) -> Iterator[TextIO]:
    try:
        with path.open("rb") as raw:
            zipped = raw.read(len(_GZIP_MAGIC)) == _GZIP_MAGIC
    except OSError as error:
        reason = (error.strerror or "unreadable").lower()
        raise InputError(f"{path}: cannot be read ({reason}); give a CSV file, plain or gzipped") from None
    opener: Callable[..., TextIO] = gzip.open if zipped else open
    with opener(path, "rt", encoding="utf-8-sig", newline="") as text:
        yield text
