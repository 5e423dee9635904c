"""Append-only Arrow IPC streams that survive being cut anywhere, and show it when a bit of them was changed.

A file is a header with an empty block, then blocks of rows, then an empty block that says "end". Each block carries
its number, the number of its first row and its checksums (`hil.records.seal`), and is written in one piece, so that
after `kill -9` every whole block is readable, and a cut between two blocks cannot be mistaken for the end.
`hil.records.blocks` reads them.
"""

import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from crc32c import crc32c

from hil.records.layout import HEADER_KEY, Layout
from hil.records.seal import lengths_of, note_text, seal


class BlockWriter:
    """Writes rows to `path`, a new file, in blocks of `layout.block_rows`.

    The bytes depend on the rows only, not on how they were grouped when handed over. As a context manager it
    ends the file with the end marker, or without it when the body raised. Raises OSError with the file's name when it
    cannot be written; what it holds then ends with its last whole block.
    """

    dropped = 0

    def __init__(self, path: Path, layout: Layout) -> None:
        self.layout = layout
        self._path = path
        self._schema = schema_of(layout)
        self._rows = np.zeros(layout.block_rows, layout.dtype)
        # NumPy copies rows of a packed dtype field by field; as bytes they go in one piece.
        self._bytes = self._rows.view(np.uint8).reshape(self._rows.size, layout.dtype.itemsize)
        self._filled = 0
        self._written = 0
        self._blocks = 0
        self._before = 0  # head checksum of the last block
        self._size = 0
        self._torn: OSError | None = None
        self._made = io.BytesIO()
        self._stream = pa.ipc.new_stream(self._made, self._schema)
        self._file = path.open("wb", buffering=0)  # a written block is the kernel's
        try:
            self._number_and_write([])  # Arrow writes the header with the first block: let that be now
        except BaseException:
            self._file.close()
            raise

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
        """Write what is left and the end marker, wait until the disk has it, and close. May be called again."""
        self._end(well=True)

    def abandon(self) -> None:
        """Write what is left and close the file without the end marker: the record was interrupted."""
        self._end(well=False)

    def _end(self, *, well: bool) -> None:
        if self._file.closed:
            return
        try:
            self._write_block()
            if well:
                self._write([], {"end": True, "rows": self._written})
                self._stream.close()
                self._put_down(self._taken())
            os.fsync(self._file.fileno())
        except OSError as error:
            raise self._named(error) from None
        finally:
            self._file.close()

    def _write_block(self) -> None:
        if not self._filled:
            return
        columns = [np.ascontiguousarray(self._rows[name][: self._filled]) for name in self._schema.names]
        self._number_and_write(columns)
        self._written += self._filled
        self._filled = 0

    def _number_and_write(self, columns: list[npt.NDArray[Any]]) -> None:
        rows = columns[0].size if columns else 0
        self._write(columns, {"block": self._blocks, "first_row": self._written, "rows": rows})
        self._blocks += 1

    def _write(self, columns: list[npt.NDArray[Any]], note: dict[str, object]) -> None:
        kinds = self._schema.types
        arrays = [
            _filled(column, kind) for column, kind in zip(columns or [np.empty(0)] * len(kinds), kinds, strict=True)
        ]
        batch = pa.RecordBatch.from_arrays(arrays, schema=self._schema)
        self._stream.write_batch(batch, custom_metadata={HEADER_KEY: note_text(note)})
        made = self._taken()
        header = bytearray()
        if not self._size:  # the header came along
            header, made = made[: lengths_of(made).head], made[lengths_of(made).head :]
        sealed = seal(made, crc32c(header) if header else self._before)
        self._put_down(header + made)
        self._before = sealed  # a block that could not be written may be tried again, after the one that is there

    def _taken(self) -> bytearray:
        made = bytearray(self._made.getbuffer())
        self._made.seek(0)
        self._made.truncate()
        return made

    def _put_down(self, data: bytearray) -> None:
        """All of it or, where the disk has no room, nothing."""
        if self._torn is not None:
            raise self._torn
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) or 0 :]
        except OSError as error:
            named = self._named(error)
            try:
                self._file.truncate(self._size)
                self._file.seek(self._size)
            except OSError:  # what lies there is no whole block: nothing may follow it
                self._torn = named
            raise named from None
        self._size += len(data)

    def _named(self, error: OSError) -> OSError:
        return OSError(error.errno, error.strerror, str(self._path))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end(well=kind is None)


def write_counted(path: Path, layout: Layout, rows: Iterable[Sequence[float]]) -> None:
    """A whole record of rows whose ticks count from 0: of each the values in the order of the layout, without tick."""
    with BlockWriter(path, layout) as writer:
        for tick, row in enumerate(rows):
            writer.put(tick, *row)


def schema_of(layout: Layout) -> Any:
    """The layout as an Arrow schema, its header in the metadata."""
    fields = [(column.name, pa.from_numpy_dtype(np.dtype(f"<{column.type}"))) for column in layout.columns]
    plain = pa.schema(fields)
    return pa.schema(fields, metadata={HEADER_KEY: layout.header_json(head_lengths(plain))})


def _filled(column: npt.NDArray[Any], kind: Any) -> Any:
    """A column as Arrow's array, by its bytes: what takes numbers loads pandas first, where that is installed."""
    return pa.Array.from_buffers(kind, column.size, [None, pa.py_buffer(column)])


def head_lengths(schema: Any) -> list[int]:
    """Lengths of the heads of an empty block and of one with rows: no others are in a file of this schema."""
    found = []
    for rows in (0, 1):
        made = io.BytesIO()
        with pa.ipc.new_stream(made, schema) as stream:
            arrays = [_filled(np.zeros(rows, f"V{kind.bit_width // 8}"), kind) for kind in schema.types]
            stream.write_batch(
                pa.RecordBatch.from_arrays(arrays, schema=schema), custom_metadata={HEADER_KEY: note_text({})}
            )
        data = made.getvalue()
        found.append(lengths_of(data[lengths_of(data).head :]).head)
    return found
