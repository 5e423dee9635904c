"""Append-only Arrow IPC streams that survive being cut anywhere.

A file is a header with an empty block, then blocks of rows, then an empty block that says "end". Each block
carries its number and the number of its first row, and reaches the kernel before the next begins, so that
after `kill -9` every whole block is readable, and a cut between two blocks cannot be mistaken for the end.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from hil.errors import InputError
from hil.records.layout import HEADER_KEY, VERSION, Layout


class BlockWriter:
    """Writes rows to `path`, a new file, in blocks of `layout.block_rows`.

    The bytes depend on the rows only, not on how they were grouped when handed over. As a context manager it
    ends the file with the end marker, or without it when the body raised.
    """

    dropped = 0

    def __init__(self, path: Path, layout: Layout) -> None:
        self.layout = layout
        self._schema = _schema(layout)
        self._rows = np.zeros(layout.block_rows, layout.dtype)
        # NumPy copies rows of a packed dtype field by field; as bytes they go in one piece.
        self._bytes = self._rows.view(np.uint8).reshape(self._rows.size, layout.dtype.itemsize)
        self._filled = 0
        self._written = 0
        self._blocks = 0
        self._file = pa.OSFile(str(path), "wb")  # unbuffered: a written block is the kernel's
        self._stream = pa.ipc.new_stream(self._file, self._schema)
        self._number_and_write([])  # Arrow writes the header with the first block: let that be now

    def put(self, *values: float) -> bool:
        """Append one row given column by column; always True (the ring's `put` can drop)."""
        self.layout.row.pack_into(self._bytes.data, self._filled * self.layout.row.size, *values)
        self._filled += 1
        if self._filled == self._rows.size:
            self._write_block()
        return True

    def push(self, rows: npt.NDArray[np.void]) -> int:
        """Append rows of `layout.dtype`; returns how many were taken: all of them."""
        size = self.layout.dtype.itemsize
        data = np.ascontiguousarray(rows, self.layout.dtype).view(np.uint8).reshape(rows.size, size)
        start = 0
        while start < rows.size:
            taken = min(rows.size - start, self._rows.size - self._filled)
            self._bytes[self._filled : self._filled + taken] = data[start : start + taken]
            self._filled += taken
            start += taken
            if self._filled == self._rows.size:
                self._write_block()
        return rows.size

    def close(self) -> None:
        """Write what is left and the end marker, and close the file. May be called again."""
        if self._file.closed:
            return
        self._write_block()
        self._write([], {"end": True, "rows": self._written})
        self._stream.close()
        self._file.close()

    def abandon(self) -> None:
        """Write what is left and close the file without the end marker: the record was interrupted."""
        if self._file.closed:
            return
        self._write_block()
        self._file.close()

    def _write_block(self) -> None:
        if not self._filled:
            return
        columns = [np.ascontiguousarray(self._rows[name][: self._filled]) for name in self._schema.names]
        self._number_and_write(columns)
        self._written += self._filled
        self._filled = 0

    def _number_and_write(self, columns: list[npt.NDArray[Any]]) -> None:
        self._write(columns, {"block": self._blocks, "first_row": self._written})
        self._blocks += 1

    def _write(self, columns: list[npt.NDArray[Any]], note: dict[str, object]) -> None:
        arrays = [pa.array(column) for column in columns] or [pa.array([], kind) for kind in self._schema.types]
        batch = pa.RecordBatch.from_arrays(arrays, schema=self._schema)
        self._stream.write_batch(batch, custom_metadata={HEADER_KEY: json.dumps(note)})

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()


@dataclass(frozen=True)
class Blocks:
    """What was read from one file: columns (n,), the header, and whether the end marker was there."""

    columns: Mapping[str, npt.NDArray[Any]]
    header: Mapping[str, Any]
    complete: bool

    @property
    def rows(self) -> int:
        """Number of rows read."""
        return next(iter(self.columns.values())).size


def read_blocks(path: Path, kind: str, *, numbered: bool = True) -> Blocks:
    """Read every whole block of a record file of the given kind.

    A file cut anywhere after its header gives the blocks before the cut and `complete` False; so does one
    whose later part is damaged. `numbered` False reads a plain Arrow stream, whose blocks carry no numbers
    and which has no end marker to miss. Raises InputError when it cannot be opened, is no Arrow stream of
    this bench, or is of another kind or a newer version.
    """
    try:
        data = path.read_bytes()  # not from the file piece by piece: a damaged length would ask for any memory
    except OSError as error:
        reason = (error.strerror or "unreadable").lower()
        raise InputError(f"{path}: cannot be read ({reason}); give an existing {kind} file") from None
    with pa.BufferReader(data) as source:
        try:
            reader = pa.ipc.open_stream(source)
        except (pa.ArrowException, OSError):
            raise InputError(
                f"{path}: no {kind} record: not an Arrow stream, or cut inside its header; give a {kind} file"
            ) from None
        header = _header(path, kind, reader.schema, numbered)
        batches, complete = _whole_blocks(reader, numbered)
        table = pa.Table.from_batches(batches, reader.schema)
        columns = {name: _own(table.column(name)) for name in table.schema.names}
    return Blocks(columns, header, complete)


def _whole_blocks(reader: Any, numbered: bool) -> tuple[list[Any], bool]:
    batches: list[Any] = []
    rows = 0
    while True:
        try:
            batch, metadata = reader.read_next_batch_with_custom_metadata()
            batch.validate(full=True)
            note = json.loads(metadata[HEADER_KEY]) if numbered else {}
        except StopIteration:
            return batches, not numbered
        except (pa.ArrowException, OSError, KeyError, TypeError, ValueError):
            return batches, False
        if note.get("end"):
            return batches, note.get("rows") == rows
        if numbered and (note.get("block") != len(batches) or note.get("first_row") != rows):
            return batches, False
        batches.append(batch)
        rows += batch.num_rows


def _header(path: Path, kind: str, schema: Any, numbered: bool) -> dict[str, Any]:
    try:
        header = dict(json.loads((schema.metadata or {})[HEADER_KEY]))
        found, version = header["kind"], header["version"]
        names = list(schema.names)
    except (KeyError, ValueError, TypeError):  # UnicodeDecodeError is a ValueError
        raise InputError(
            f"{path}: an Arrow stream without this bench's header; give a {kind} file that hil wrote"
        ) from None
    if found != kind:
        raise InputError(f"{path}: holds {found!r}, not {kind!r}; give a {kind} file")
    if version != VERSION:
        raise InputError(f"{path}: {kind} version {version}, this program reads {VERSION}; use the hil that wrote it")
    if numbered and names != list(header.get("columns", {})):
        raise InputError(f"{path}: damaged header: its columns are not those it lists; restore the file")
    return header


def _own(column: Any) -> npt.NDArray[Any]:
    """The column as an array that its reader may keep and change."""
    values: npt.NDArray[Any] = column.to_numpy()
    return values if values.flags.writeable else values.copy()


def _schema(layout: Layout) -> Any:
    fields = [(column.name, pa.from_numpy_dtype(np.dtype(f"<{column.type}"))) for column in layout.columns]
    return pa.schema(fields, metadata={HEADER_KEY: layout.header_json()})
