"""Reading record files: their blocks found and checked, their columns read when asked for, whole or in part.

Nothing is computed from a file before all of it was checked, and no more of it is in memory than was asked for.
"""

import json
import math
import os
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from crc32c import crc32c

from hil.errors import InputError
from hil.records.layout import HEADER_KEY, VERSION
from hil.records.seal import (
    END_OF_STREAM,
    PREFIX,
    BrokenBlockError,
    checked_head,
    head_length,
    is_sealed,
    lengths_of,
    note_span,
)
from hil.wire.regular_file import require_regular

_PIECE_ROWS = 1 << 18
"""Rows that are read together where a record is gone through from one end to the other."""
LAST_TICK = 1 << 62
"""Beyond every tick there is."""
_BEGIN = 1 << 18
"""Bytes in which a header and the first block end."""


class Block(NamedTuple):
    """Where a block lies in its file: first byte, byte after it, its rows, and where each column begins."""

    start: int
    stop: int
    first_row: int
    rows: int
    columns: tuple[int, ...]


@dataclass(frozen=True)
class Scan:
    """What a file was found to hold. `damage` says in words which block is not what was written, "" when none is."""

    path: Path
    header: Mapping[str, Any]
    dtypes: Mapping[str, np.dtype[Any]]
    blocks: tuple[Block, ...]
    complete: bool
    damage: str
    opening: int
    """Bytes of the header."""

    @property
    def rows(self) -> int:
        """Rows of the blocks before any damage."""
        return self.blocks[-1].first_row + self.blocks[-1].rows if self.blocks else 0

    @property
    def size(self) -> int:
        """Bytes up to the end of the last whole block."""
        return self.blocks[-1].stop if self.blocks else self.opening


class StoredColumns(Mapping[str, npt.NDArray[Any]]):
    """Rows [start, stop) of a checked file, by column; each is read anew when asked for, and is the reader's own."""

    def __init__(self, scan: Scan, start: int, stop: int) -> None:
        self._scan = scan
        self._firsts = [block.first_row for block in scan.blocks]
        self._start, self._stop = start, stop

    @property
    def rows(self) -> int:
        return self._stop - self._start

    def part(self, start: int, stop: int) -> "StoredColumns":
        """Rows [start, stop) of these, by the rules of slices."""
        start, stop, _ = slice(start, stop).indices(self.rows)
        part = StoredColumns.__new__(StoredColumns)
        part._scan, part._firsts = self._scan, self._firsts
        part._start, part._stop = self._start + start, self._start + max(start, stop)
        return part

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        dtype = self._scan.dtypes[name]
        values = np.empty(self.rows, dtype)
        room, filled = values.view(np.uint8).data, 0
        column, blocks = list(self._scan.dtypes).index(name), self._scan.blocks
        first = max(bisect_right(self._firsts, self._start) - 1, 0)
        with opened(self._scan.path, "record") as file:
            number = file.fileno()
            for block in range(first, len(blocks)):
                at = blocks[block]
                row = max(self._start, at.first_row)
                if row >= self._stop:
                    break
                size = (min(at.first_row + at.rows, self._stop) - row) * dtype.itemsize
                place = at.start + at.columns[column] + (row - at.first_row) * dtype.itemsize if size else 0
                if size and os.preadv(number, [room[filled : filled + size]], place) != size:
                    raise InputError(f"{self._scan.path}: became shorter while it was read; give a finished record")
                filled += size
        return values

    def __contains__(self, name: object) -> bool:
        return name in self._scan.dtypes  # Mapping's own would read the column

    def __iter__(self) -> Iterator[str]:
        return iter(self._scan.dtypes)

    def __len__(self) -> int:
        return len(self._scan.dtypes)


Columns = Mapping[str, npt.NDArray[Any]]
"""Columns of equal length by name: arrays, or those of a file."""


def rows_of(columns: Columns) -> int:
    return columns.rows if isinstance(columns, StoredColumns) else next(iter(columns.values())).size


def part_of(columns: Columns, start: int, stop: int) -> Columns:
    """Rows [start, stop); of a file, nothing is read yet."""
    if isinstance(columns, StoredColumns):
        return columns.part(start, stop)
    return {name: values[start:stop] for name, values in columns.items()}


def pieces_of(columns: Columns, rows: int = _PIECE_ROWS) -> Iterator[tuple[int, Columns]]:
    """One part after another, each with the number of its first row; of a file, each is read once."""
    for start in range(0, rows_of(columns), rows):
        yield start, part_of(columns, start, start + rows)


def between(columns: Columns, first_tick: int, last_tick: int) -> Columns:
    """The rows of ticks first_tick … last_tick, of columns whose ticks ascend."""
    return part_of(columns, _row_of(columns, first_tick), _row_of(columns, last_tick + 1))


def first_tick_since(t_s: float, tick_rate_Hz: float) -> int:
    """The first tick whose bench time, as a float, is `t_s` or later."""
    first = math.floor(t_s * tick_rate_Hz) - 1
    while first / tick_rate_Hz < t_s:
        first += 1
    return first


def _row_of(columns: Columns, tick: int) -> int:
    if not isinstance(columns, StoredColumns):
        return int(np.searchsorted(columns["tick"], tick))
    low, high = 0, columns.rows
    while low < high:
        middle = (low + high) // 2
        if columns.part(middle, middle + 1)["tick"][0] < tick:
            low = middle + 1
        else:
            high = middle
    return low


@dataclass(frozen=True)
class Blocks:
    """What was read from one file: columns (n,), the header, and whether the end marker was there."""

    columns: Columns
    header: Mapping[str, Any]
    complete: bool

    @property
    def rows(self) -> int:
        return rows_of(self.columns)


def read_blocks(path: Path, kind: str) -> Blocks:
    """Every whole block of a record file of the given kind, checked.

    A file cut anywhere after its first block gives the blocks before the cut and `complete` False. Raises InputError
    when it cannot be opened, is no Arrow stream of this bench with checksums, is of another kind or a newer version, or
    when a checksum differs.
    """
    scan = scan_blocks(path, kind)
    if scan.damage:
        rest = f"hil check --repair keeps the {scan.rows} rows before it" if scan.blocks else "restore the file"
        raise InputError(f"{path}: {scan.damage}; {rest}")
    return Blocks(StoredColumns(scan, 0, scan.rows), scan.header, scan.complete)


def scan_blocks(path: Path, kind: str | None) -> Scan:
    """Find and check the blocks of a record file, of any kind where None is given; raises InputError as `read_blocks`
    does, but not for damage."""
    with opened(path, kind or "record") as file:
        size = os.fstat(file.fileno()).st_size
        opening = read_opening(path, file, kind)
        blocks, complete, damage = _Passage(file, size, opening.data, opening.heads).blocks()
        if not blocks and not damage:
            raise InputError(f"{path}: no {_called(kind)}: cut inside its header; give a {kind or 'record'} file")
    return Scan(path, opening.header, opening.dtypes, tuple(blocks), complete, damage, len(opening.data))


class Opening(NamedTuple):
    """How a record file begins: its bytes, what the header says, the columns, and the lengths that heads of its blocks
    have."""

    data: bytes
    header: Mapping[str, Any]
    dtypes: Mapping[str, np.dtype[Any]]
    heads: tuple[int, ...]


def read_opening(path: Path, file: BufferedReader, kind: str | None) -> Opening:
    """The opening of a record file of the given kind, of any where None is given. Raises InputError as `read_blocks`
    does."""
    data = _opening(file, os.fstat(file.fileno()).st_size)
    _require_whole(path, file, data)
    try:
        schema = pa.ipc.read_schema(pa.py_buffer(data))
    except (pa.ArrowException, OSError, ValueError):
        raise InputError(
            f"{path}: no {_called(kind)}: not an Arrow stream, or cut inside its header; give a {kind or 'record'} file"
        ) from None
    header = _header(path, kind, schema)
    return Opening(data, header, _dtypes(path, schema), _heads(path, header))


class GrowingFile:
    """A record file that is being written: its rows as they come, each whole block once.

    Raises InputError as `read_blocks` does, of damage too; there is no such object before the file has its header.
    """

    def __init__(self, path: Path, kind: str) -> None:
        scan = scan_blocks(path, kind)
        self.header = scan.header
        self._path, self._dtypes, self._opening = path, scan.dtypes, scan.opening
        self._file = path.open("rb")
        self._passage = _Passage(self._file, 0, self._file.read(scan.opening), _heads(path, scan.header))
        self._taken = 0  # blocks
        self._rows = 0
        self.complete = False

    def news(self) -> Columns:
        """The rows that were written since this was last asked, none where no block was."""
        self._passage.grown(os.fstat(self._file.fileno()).st_size)
        if self.complete:
            return self._part([], self._rows)
        blocks, self.complete, damage = self._passage.blocks()
        if damage:
            raise InputError(f"{self._path}: {damage}; restore the file")
        new = blocks[self._taken :]
        self._taken = len(blocks)
        return self._part(new, sum(block.rows for block in new) + self._rows)

    def close(self) -> None:
        self._file.close()

    def _part(self, blocks: list[Block], stop: int) -> Columns:
        scan = Scan(self._path, self.header, self._dtypes, tuple(blocks), self.complete, "", self._opening)
        start, self._rows = self._rows, stop
        return StoredColumns(scan, start, stop)


class _Passage:
    def __init__(self, file: BufferedReader, size: int, opening: bytes, heads: tuple[int, ...]) -> None:
        self._file = file
        self._size = size
        self._opening = opening
        self._heads = heads
        self._at = len(opening)
        self._before = crc32c(opening)
        self._found: list[Block] = []
        self._rows = 0
        self._ahead, self._ahead_at = b"", -1
        self._usual: tuple[bytes, bytes, tuple[int, ...], int] | None = None  # of the last block, as `_decoded` has it
        self._length = 0

    def blocks(self) -> tuple[list[Block], bool, str]:
        """The whole blocks, whether the file is complete, and what is damaged, in words."""
        try:
            complete = self._go()
        except BrokenBlockError as broken:
            place = f"block {len(self._found)}, from row {self._rows} on," if self._found else "the header or block 0"
            return self._found, False, f"{place} is damaged: {broken}"
        return self._found, complete, ""

    def grown(self, size: int) -> None:
        """The file has become longer: the next `blocks` goes on where the last one ended."""
        self._size = size

    def _go(self) -> bool:
        while True:
            left = self._size - self._at
            prefix = self._read(PREFIX)
            if left < PREFIX:
                return False
            length = head_length(prefix)
            if length not in self._heads:
                raise BrokenBlockError("its length is none that a block here has")
            if left < length:
                return False
            head = self._read(length)
            before, body_sum = checked_head(head, self._before)
            message = lengths_of(head)
            if left < message.head + message.body:
                return False
            data = self._read(message.head + message.body)
            if crc32c(memoryview(data)[message.head :]) != body_sum:
                raise BrokenBlockError("its checksum differs")
            self._before = before  # only now: of a block that is cut the rest may still come
            self._length = len(data)
            if self._took(data, length):
                return self._ended()

    def _took(self, data: bytes, head: int) -> bool:
        note, columns, rows = self._decoded(data, head)
        if note.get("end"):
            if note.get("rows") != self._rows:
                raise BrokenBlockError("the end marker counts other rows")
            self._at += len(data)
            return True
        if note.get("block", len(self._found)) != len(self._found) or note.get("first_row", self._rows) != self._rows:
            raise BrokenBlockError("it is not the one that follows")
        if note.get("rows", rows) != rows:
            raise BrokenBlockError("it has other rows than it says")
        self._found.append(Block(self._at, self._at + len(data), self._rows, rows, columns))
        self._at += len(data)
        self._rows += rows
        return False

    def _decoded(self, data: bytes, head: int) -> tuple[dict[str, Any], tuple[int, ...], int]:
        """Note of a block, offset of each column in it, and its rows: of one whose head, which is checked, is that of
        the block before but for the note, those of that block.
        """
        note_at = note_span(data, head) if self._heads is not None else None
        if note_at is not None and self._usual is not None:
            before, after, offsets, rows = self._usual
            if data[: note_at.start] == before and data[note_at.stop : head] == after:
                with suppress(ValueError):
                    return dict(json.loads(data[note_at])), offsets, rows
        note, offsets, rows = self._opened(data)
        if note_at is not None:
            self._usual = data[: note_at.start], data[note_at.stop : head], offsets, rows
        return note, offsets, rows

    def _opened(self, data: bytes) -> tuple[dict[str, Any], tuple[int, ...], int]:
        together = pa.py_buffer(self._opening + data)
        start = together.address + len(self._opening)
        try:
            with pa.ipc.open_stream(together) as reader:
                batch, metadata = reader.read_next_batch_with_custom_metadata()
            batch.validate(full=True)
            note = dict(json.loads(metadata[HEADER_KEY]))
        except (pa.ArrowException, OSError, KeyError, TypeError, ValueError, StopIteration, RecursionError):
            raise BrokenBlockError("it is no block of this record") from None
        if any(column.null_count for column in batch.columns):
            raise BrokenBlockError("it has rows without a value")
        offsets = [column.buffers()[1].address - start for column in batch.columns] if batch.num_rows else []
        return note, tuple(offsets), batch.num_rows

    def _ended(self) -> bool:
        rest = self._size - self._at
        if rest > len(END_OF_STREAM) or not END_OF_STREAM.startswith(self._read(len(END_OF_STREAM))):
            raise BrokenBlockError("what follows the end marker does not belong there")
        return True

    def _read(self, count: int) -> bytes:
        """What stands next; a block as long as the last one is read at once."""
        left = max(self._size - self._at, 0)
        count = min(count, left)
        if self._ahead_at != self._at or len(self._ahead) < count:
            self._file.seek(self._at)
            self._ahead, self._ahead_at = self._file.read(min(max(count, self._length), left)), self._at
        return self._ahead if len(self._ahead) == count else self._ahead[:count]


@contextmanager
def opened(path: Path, kind: str) -> Iterator[BufferedReader]:
    """The file, open. Raises InputError where it cannot be read."""
    with open_record(path, kind) as file:
        try:
            yield file
        except OSError as error:
            raise _unreadable(path, kind, error) from None


def open_record(path: Path, kind: str) -> BufferedReader:
    """The same, to be closed. What is no file is not opened: a pipe would be waited for."""
    try:
        require_regular(path)
        return path.open("rb")
    except OSError as error:
        raise _unreadable(path, kind, error) from None


def _unreadable(path: Path, kind: str, error: OSError) -> InputError:
    reason = (error.strerror or "unreadable").lower()
    return InputError(f"{path}: cannot be read ({reason}); give an existing {kind} file")


def _called(kind: str | None) -> str:
    return f"{kind} record" if kind else "record"


def _opening(file: BufferedReader, size: int) -> bytes:
    """The bytes of the header; what they are when the file holds none is for Arrow to say."""
    try:
        length = head_length(file.read(PREFIX))
    except BrokenBlockError:
        return b""
    file.seek(0)
    return file.read(length) if length <= size else b""


def _require_whole(path: Path, file: BufferedReader, opening: bytes) -> None:
    """InputError where the first block's checksum says that the header is not the one that was written."""
    file.seek(0)
    begin = file.read(_BEGIN)
    if not is_sealed(begin):
        return
    at = len(opening)
    try:
        length = head_length(begin[at:][:PREFIX])
        if at and length > len(begin) - at:
            return  # cut inside it
        checked_head(begin[at:][:length], crc32c(opening))
    except BrokenBlockError as broken:
        raise InputError(f"{path}: block 0, with the header, is damaged: {broken}; restore the file") from None


def _header(path: Path, kind: str | None, schema: Any) -> dict[str, Any]:
    try:
        header = dict(json.loads((schema.metadata or {})[HEADER_KEY]))
        found, version = header["kind"], header["version"]
        names = list(schema.names)
    except (KeyError, ValueError, TypeError, RecursionError):  # UnicodeDecodeError is a ValueError
        raise InputError(
            f"{path}: an Arrow stream without this bench's header; give a {kind or 'record'} file that hil wrote"
        ) from None
    if kind is not None and found != kind:
        raise InputError(f"{path}: holds {found!r}, not {kind!r}; give a {kind} file")
    if version != VERSION:
        raise InputError(f"{path}: {kind} version {version}, this program reads {VERSION}; use the hil that wrote it")
    if found != "truth" and names != list(header.get("columns", {})):
        raise InputError(f"{path}: damaged header: its columns are not those it lists; restore the file")
    return header


_NUMBERS = ("i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8")


def _dtypes(path: Path, schema: Any) -> dict[str, np.dtype[Any]]:
    """What each column holds; not by `to_pandas_dtype`, with which older versions of Arrow load pandas."""
    names = {str(pa.from_numpy_dtype(kind)): np.dtype(kind) for kind in _NUMBERS}
    if len(set(schema.names)) != len(schema) or not all(str(kind) in names for kind in schema.types):
        raise InputError(f"{path}: a column is no plain number; give a file that hil wrote")
    return {field.name: names[str(field.type)] for field in schema}


def _heads(path: Path, header: Mapping[str, Any]) -> tuple[int, ...]:
    if (seal := header.get("checksum")) is None:
        raise InputError(f"{path}: a record without checksums, which this program does not read; use the hil of then")
    heads = seal.get("heads") if isinstance(seal, dict) else None
    if not isinstance(heads, list) or not all(isinstance(length, int) for length in heads):
        raise InputError(f"{path}: damaged header: what it says of checksums cannot be read; restore the file")
    return tuple(heads)
