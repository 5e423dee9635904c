"""A delimited text as a source of columns: a line is a row, every line is accounted for."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.mapping import LONGEST_COMMENT, Name, RecordMap
from hil.importing.source import Selection, Table, Values, Wanted, among, position
from hil.importing.text_cells import Cells, NotCells, extra_cells, remedy_for, shown
from hil.importing.text_lines import pieces
from hil.toml.reading import toml_value

_EXACT = 15
"""Digits that a float has for certain."""


class TextSource:
    """The text at `path`, written as `mapping` says; `header` (names) and the line on which its rows begin are read."""

    kind = "a text"

    def __init__(self, path: Path, mapping: RecordMap) -> None:
        self.path, self.called, self._mapping = path, str(path), mapping
        self._cells = Cells(mapping)
        self.header_line, self._rows_from, cells = self._head()
        self.names: Sequence[str] = cells if mapping.header else [str(place) for place in range(1, len(cells) + 1)]
        self.width = len(cells)
        self.first_cells = cells

    @property
    def is_mapped(self) -> bool:
        return self._mapping.columns is not None or bool(self._mapping.model_fields_set - {"hold"})

    def locate(self, name: Name) -> int:
        """The position of a column; the error says what the file's own structure asks for."""
        try:
            return position(name, self.names, self.called)
        except InputError as error:
            if isinstance(name, str) and name in self.names:
                raise
            asked = self.advice("")
            if asked:
                raise InputError(f"{str(error).split(';')[0]}; {self._one_cell()}{asked}") from None
            raise

    def read(self, wanted: Sequence[Wanted], selection: Selection) -> Table:
        """Columns as float64; a time whose cells are dates, or have more digits than that, as texts."""
        self._require_units(wanted)
        as_text = [one.is_time and self._is_text(one.at) for one in wanted]
        read = _Reading(self, self._cells, wanted, as_text, selection)
        for line, text in self._pieces():
            read.take(line, text)
        return read.table()

    def place(self, row: int, column: str) -> str:
        return f"{self.path}:{row}: column {column}"

    def header_again(self, cells: Sequence[str]) -> str | None:
        """What to do about a line that is the header once more; None where it is none."""
        if not self._mapping.header or [cell.strip() for cell in cells[: self.width]] != list(self.names):
            return None
        begins = toml_value(self._cells.delimiter.join(self.names)[:LONGEST_COMMENT].rstrip())
        return (
            f"the header stands here again; set comment = {begins}, header = false, and give columns by position: "
            "lines that begin so are left out"
        )

    def advice(self, ordinary: str) -> str:
        """What the structure of the file asks for, where the map says otherwise."""
        from hil.importing.structure import asked_for

        return asked_for(self.path, self._mapping) or ordinary

    def texts(self, index: int) -> Iterator[tuple[int, str]]:
        """Line and text of a column's cells."""
        for line, text in self._pieces():
            for number, content in enumerate(text.split("\n"), line):
                if not self._cells.is_left_out(content):
                    cells = self.cut(number, content)
                    if index < len(cells):
                        yield number, cells[index].strip()

    def cut(self, line: int, content: str) -> list[str]:
        """The cells of a line. Raises InputError for a quote that is not closed on it."""
        try:
            return self._cells.of(content)
        except NotCells as error:
            raise InputError(f"{self.path}:{line}: {error}") from None

    def _require_units(self, wanted: Sequence[Wanted]) -> None:
        """Refuse a row of units that is one of numbers; 1 is the unit of what has none."""
        if self._units is None:
            return
        line, content = self._units
        cells = self.cut(line, content)
        for one in wanted:
            cell = cells[one.at].strip() if one.at < len(cells) else ""
            if cell != "1" and self._is_number(cell):
                raise InputError(
                    f"{self.path}:{line}: units_row: column {one.called} reads {shown(cell)}, a number; "
                    "leave units_row out, or correct skip_lines"
                )

    def _one_cell(self) -> str:
        if self.width == 1:
            return "its first line is one cell; "
        return "its first line holds numbers; " if all(map(self._is_number, self.first_cells)) else ""

    def _is_number(self, cell: str) -> bool:
        try:
            self._cells.number(cell)
        except ValueError:
            return False
        return True

    def _head(self) -> tuple[int, int, list[str]]:
        """The line of the header (or of the first row), that on which rows begin, and the cells of the first."""
        found: list[tuple[int, str]] = []
        needed = 1 + self._mapping.units_row
        for line, content in self._lines():
            if line > self._mapping.skip_lines and not self._cells.is_left_out(content):
                found.append((line, content))
                if len(found) == needed:
                    break
        if not found:
            raise InputError(f"{self.path}: empty; expected a header line and rows of numbers")
        line, content = found[0]
        self._units = found[-1] if self._mapping.units_row and len(found) == needed else None
        try:
            cells = self._cells.names(content)
        except NotCells as error:
            raise InputError(f"{self.path}:{line}: {self.advice(str(error))}") from None
        return line, (found[-1][0] + 1 if self._mapping.header else line), cells

    def _lines(self) -> Iterator[tuple[int, str]]:
        line = 1
        for text in pieces(self.path, self._mapping.encoding):
            for content in text.split("\n") if not text.endswith("\n") else text[:-1].split("\n"):
                yield line, content
                line += 1

    def _pieces(self) -> Iterator[tuple[int, str]]:
        """Pieces of rows, each with the number of its first line."""
        line = 1
        for text in pieces(self.path, self._mapping.encoding):
            count = text.count("\n")
            skipped = min(self._rows_from - line, count + 1) if line < self._rows_from else 0
            rest = text
            for _ in range(skipped):
                rest = rest.partition("\n")[2]
            if rest:
                yield line + skipped, rest
            line += count

    def _is_text(self, index: int) -> bool:
        """Whether the cells of a time are no numbers, or have more digits than a float: by the first row."""
        _, cell = next(self.texts(index), (0, ""))
        digits = self._cells.digits(cell)
        try:
            float(digits)
        except ValueError:
            return any(letter.isdigit() for letter in digits) and any(letter in digits for letter in "-:")
        return "_" not in digits and sum(letter.isdigit() for letter in digits.lower().partition("e")[0]) > _EXACT


class _Reading:
    """Rows read so far, of piece after piece."""

    def __init__(
        self, source: TextSource, cells: Cells, wanted: Sequence[Wanted], as_text: Sequence[bool], selection: Selection
    ) -> None:
        self._source, self._cells, self._wanted, self._as_text = source, cells, wanted, as_text
        self._selection = selection
        self._start: int = 0
        self._stop: int | None = None
        if selection.rows is not None:
            self._start, self._stop = selection.rows
        self._count = 0
        self._columns: list[list[Values]] = [[] for _ in wanted]
        self._lines: list[npt.NDArray[np.int64]] = []
        self._of = 0

    def take(self, line: int, text: str) -> None:
        """The rows of a piece whose first line has this number."""
        made = None if self._is_special(text) else plain_columns(
            text, [one.at for one in self._wanted], width=self._source.width,
            delimiter=self._cells.delimiter, decimal=self._cells.decimal,
        )  # fmt: skip
        if made is None:
            self._strictly(line, text)
            return
        rows = slice(
            max(self._start - self._count, 0), None if self._stop is None else max(self._stop - self._count, 0)
        )
        lines = np.arange(line, line + len(made[0]))
        self._count += lines.size
        self._of += lines.size
        if lines[rows].size:
            self._lines.append(lines[rows])
            for kept, values in zip(self._columns, made, strict=True):
                kept.append(values[rows])

    def table(self) -> Table:
        """All of them. Raises InputError where there are none."""
        if not self._lines:
            told = f"no rows of numbers{among(self._selection)}"
            raise InputError(f"{self._source.path}: {told}; {self._source.advice('give a file that holds a record')}")
        return Table([np.concatenate(parts) for parts in self._columns], np.concatenate(self._lines), self._of)

    def _is_special(self, text: str) -> bool:
        cells, selection = self._cells, self._selection
        return bool(
            any(self._as_text) or any(one.thousands for one in self._wanted)
            or selection.where or selection.missing or cells.delimiter == " "
            or (cells.quote and cells.quote in text) or (cells.comment and cells.comment in text)
        )  # fmt: skip

    def _strictly(self, first: int, text: str) -> None:
        rows: list[list[str]] = []
        lines: list[int] = []
        where, width = self._selection.where, self._source.width
        contents = text.split("\n")
        ends = not contents[-1]
        before = width
        for line, content in enumerate(contents[:-1] if ends else contents, first):
            if self._cells.is_left_out(content):
                continue
            cells = self._cut(line, content)
            self._of += 1
            if len(cells) < width and len(cells) < before and not ends and line == first + len(contents) - 1:
                raise InputError(
                    f"{self._source.path}:{line}: {len(cells)} cells where the first line has {width}, and no line "
                    "end: the file is cut; remove its last line"
                )
            before = len(cells)
            if where and not all(index < len(cells) and cells[index].strip() == sign for index, sign in where.items()):
                continue
            if self._start <= self._count and (self._stop is None or self._count < self._stop):
                rows.append(cells)
                lines.append(line)
            self._count += 1
        if not rows:
            return
        self._lines.append(np.array(lines))
        for kept, one, textual in zip(self._columns, self._wanted, self._as_text, strict=True):
            kept.append(self._column(rows, lines, one, textual))

    def _cut(self, line: int, content: str) -> list[str]:
        cells = self._source.cut(line, content)
        width = self._source.width
        if extra_cells(cells, width) or len(cells) <= max((one.at for one in self._wanted), default=0):
            problem = f"{len(cells)} cells where the first line has {width}"
            raise InputError(f"{self._source.path}:{line}: {problem}; {self._source.advice('mend the row')}")
        return cells

    def _column(self, rows: list[list[str]], lines: list[int], one: Wanted, textual: bool) -> Values:
        if textual:
            made = [self._cells.digits(cells[one.at], one.thousands) for cells in rows]
            return np.array(["" if self._cells.is_missing(cell) else cell for cell in made], dtype=object)
        number, values = self._cells.number, np.empty(len(rows))
        for row, cells in enumerate(rows):
            try:
                values[row] = number(cells[one.at], one.thousands)
            except ValueError as error:
                place = self._source.place(lines[row], one.called)
                if (again := self._source.header_again(cells)) is not None:
                    raise InputError(f"{place}: {again}") from None
                ordinary = remedy_for(cells[one.at], mapped=self._source.is_mapped)
                raise InputError(f"{place}: {error}; {self._source.advice(ordinary)}") from None
        return values


Floats = npt.NDArray[np.float64]


def plain_columns(
    text: str, columns: Sequence[int], *, width: int, delimiter: str, decimal: str = "."
) -> list[Floats] | None:
    """The columns of a piece of whole lines; None, so that the strict way is taken, unless every line is a row of
    `width` cells and every cell asked for a finite number.

    Arrow gets a copy of the piece in memory of its own.  A thread of Arrow's may outlive a piece that it refused; one
    that reads from a file object of Python's, whose interpreter is ending, aborts the program.
    """
    import pyarrow as pa
    import pyarrow.csv as pa_csv

    if not columns or max(columns) >= width:
        return None
    data = text.encode()
    lines = data.count(b"\n") + (not data.endswith(b"\n"))
    buffer = pa.allocate_buffer(len(data))
    np.frombuffer(buffer, np.uint8)[:] = np.frombuffer(data, np.uint8)
    names = [str(index) for index in range(width)]
    wanted = [names[index] for index in dict.fromkeys(columns)]
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(buffer),
            pa_csv.ReadOptions(use_threads=False, block_size=max(len(data) + 1, 1 << 10), column_names=names),
            pa_csv.ParseOptions(delimiter=delimiter, quote_char=False),
            pa_csv.ConvertOptions(
                column_types=dict.fromkeys(wanted, pa.float64()),
                include_columns=wanted,
                null_values=[],
                decimal_point=decimal,
            ),
        )
    except (pa.ArrowException, ValueError, TypeError):
        return None
    if table.num_rows != lines:
        return None
    read = {name: table.column(name).to_numpy() for name in wanted}
    if not all(np.isfinite(values).all() for values in read.values()):
        return None
    return [read[names[index]] for index in columns]
