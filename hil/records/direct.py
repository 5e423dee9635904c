"""A record file opened at any row, without going through it: an hour at 100 kS/s takes as long as a second.

All blocks of a file but the last have one length, so the place of a row follows from its number. Only the blocks that
are read are checked, each by its own two checksums and by the one of the block before it.
"""

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from crc32c import crc32c

from hil.errors import InputError
from hil.records.blocks import Opening, open_record, read_opening
from hil.records.layout import HEADER_KEY
from hil.records.seal import PREFIX, BrokenBlockError, checked_head, head_length, lengths_of, stated_head
from hil.records.table import cut_record

_HEAD_BYTES = 1 << 16  # longer than any head
_FEW = 8  # blocks, among which one looks without a hint


class OnDisk(NamedTuple):
    """What is there of a record, whatever was meant to be: whole rows, those missing between them, whether its end
    marker is there.
    """

    rows: int
    lost: int
    complete: bool

    def told(self, meant: int | None = None) -> str:
        """In a few words, beside the ticks that were meant to be there where that is known."""
        if not self.rows:
            return "no whole block was recorded"
        if not self.complete:
            return cut_record(self.rows)
        there = self.rows + self.lost
        return "the record is whole" if meant is None or there >= meant else f"whole up to tick {there} of {meant}"


def on_disk(capture: Path) -> OnDisk:
    """What is there of a capture; nothing where it cannot be read."""
    try:
        with DirectRecord(capture, "capture") as record:
            if not record.rows:
                return OnDisk(0, 0, record.complete)
            between = record.tick_at(-1) - record.tick_at(0) + 1 - record.rows
            return OnDisk(record.rows, between, record.complete)
    except InputError:
        return OnDisk(0, 0, complete=False)


def cut_of(file: Path) -> str:
    """That a record was interrupted, as `Table.cut` says it; "" of a whole one and where none can be read."""
    with suppress(InputError), DirectRecord(file) as record:
        return "" if record.complete else cut_record(record.rows)
    return ""


Columns = dict[str, npt.NDArray[Any]]


class DirectRecord:
    """A finished, interrupted or growing record file of `kind`, any where None is given.

    `rows` are those of whole blocks when it was opened; `complete` says whether its end marker is there, and `seal` is
    that one's checksum, which depends on everything before it, None without one. Raises
    InputError when it cannot be opened, is no record of this bench with checksums, or its blocks do not have one length
    each (`read_blocks` reads it then). As a context manager it closes the file.
    """

    def __init__(self, path: Path, kind: str | None = None) -> None:
        self.path = path
        self._file = open_record(path, kind or "record")
        try:
            self._opening: Opening = read_opening(path, self._file, kind)
            if next(iter(self.dtypes), "") != "tick":
                raise InputError(f"{path}: a record whose first column is not tick; give one that hil wrote")
            self._find_blocks(os.fstat(self._file.fileno()).st_size)
        except BaseException:
            self._file.close()
            raise

    @property
    def header(self) -> Mapping[str, Any]:
        return self._opening.header

    @property
    def dtypes(self) -> Mapping[str, np.dtype[Any]]:
        return self._opening.dtypes

    @property
    def stamp(self) -> tuple[int, int, int, int]:
        """What tells this state of the file from any other: device, inode, time of the last change, bytes."""
        found = os.fstat(self._file.fileno())
        return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size

    def read(self, names: Sequence[str], start: int, stop: int) -> Columns:
        """Rows [start, stop), by the rules of slices, of the columns `names`; every block they lie in is checked."""
        start, stop, _ = slice(start, stop).indices(self.rows)
        stop = max(start, stop)
        values = {name: np.empty(stop - start, self.dtypes[name]) for name in names}
        row = start
        while row < stop:
            block = row // self.block_rows
            first, batch = block * self.block_rows, self._checked(block)
            count = min(first + batch.num_rows, stop) - row
            for name, column in values.items():
                # pyarrow's own to_numpy would load pandas first
                stored = np.frombuffer(batch.column(name).buffers()[1], column.dtype, batch.num_rows)
                column[row - start : row - start + count] = stored[row - first : row - first + count]
            row += count
        return values

    def row_of(self, tick: int) -> int:
        """The first row at or after a tick; ticks ascend."""
        low, high = 0, self._blocks  # the first block that begins after the tick, less one, holds it
        hint = self._without_gaps(tick)  # a read of a record that is not in memory takes long: most need two
        while low < high:
            middle = min(max(hint, low), high - 1) if hint is not None else (low + high) // 2
            hint = None if hint is None or middle != hint else hint + 1
            if self._first_tick(middle) < tick:
                low = middle + 1
            else:
                high = middle
        if not low:
            return 0
        first = (low - 1) * self.block_rows
        ticks = self.read(["tick"], first, first + self.block_rows)["tick"]
        return first + int(np.searchsorted(ticks, tick))

    def tick_at(self, row: int) -> int:
        """The tick of a row; -1 is the last."""
        row = row % self.rows
        return int(self.read(["tick"], row, row + 1)["tick"][0])

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _find_blocks(self, size: int) -> None:
        """How many blocks there are, how long, and what stands behind the last of one length."""
        self._begin, self._length, self.block_rows, self._blocks, self.rows, self.complete = 0, 1, 1, 0, 0, False
        self.seal: int | None = None
        at = len(self._opening.data)
        empty = self._whole_length(at, size)
        if empty is None:
            raise InputError(f"{self.path}: no record: cut inside its header; give another file")
        self._empty_at, self._begin = at, at + empty
        length = self._whole_length(self._begin, size)
        if length is None:
            return
        batch, note = self._decoded(self._begin, length)
        if note.get("end"):
            self.complete = True
            return
        self._length, self.block_rows = length, batch.num_rows
        blocks = (size - self._begin) // length
        while blocks > 1 and self._whole_length(self._begin + (blocks - 1) * length, size) != length:
            blocks -= 1
        self._blocks, self.rows = blocks, blocks * self.block_rows
        at = self._begin + blocks * length
        while (rest := self._whole_length(at, size)) is not None:
            batch, note = self._decoded(at, rest)
            if note.get("end"):
                self.complete = True
                self.seal = stated_head(os.pread(self._file.fileno(), _HEAD_BYTES, at))
                if note.get("rows") != self.rows:
                    raise InputError(f"{self.path}: the end marker counts other rows; hil check tells more")
                return
            if self._blocks != blocks:
                raise InputError(f"{self.path}: blocks of several lengths; hil check tells more")
            self._blocks += 1
            self.rows += batch.num_rows
            at += rest

    def _whole_length(self, at: int, size: int) -> int | None:
        """Bytes of the message that begins there, None where it is not whole or none begins."""
        head = os.pread(self._file.fileno(), _HEAD_BYTES, at)
        if len(head) < PREFIX:
            return None
        try:
            lengths = lengths_of(head)
        except BrokenBlockError:
            return None
        whole = lengths.head in self._opening.heads and at + lengths.head + lengths.body <= size
        return lengths.head + lengths.body if whole else None

    def _checked(self, block: int) -> Any:
        """The rows of a block, whose checksums hold."""
        at = self._begin + block * self._length
        length = self._length
        if block == self._blocks - 1:
            found = self._whole_length(at, os.fstat(self._file.fileno()).st_size)
            if found is None:
                raise InputError(f"{self.path}: became shorter while it was read; give a finished record")
            length = found
        batch, note = self._decoded(at, length, before=self._empty_at if not block else at - self._length)
        if note.get("block") != block + 1 or note.get("first_row") != block * self.block_rows:
            raise InputError(f"{self.path}: block {block + 1} is not the one that follows; hil check tells more")
        return batch

    def _decoded(self, at: int, length: int, before: int | None = None) -> tuple[Any, dict[str, Any]]:
        """Rows and note of the message there, its checksums held against it where `before`, the place of the one before
        it, is given."""
        data = os.pread(self._file.fileno(), length, at)
        try:
            if len(data) != length:
                raise BrokenBlockError("it is cut")
            head = head_length(data[:PREFIX])
            if before is not None:
                _, body = checked_head(data[:head], stated_head(os.pread(self._file.fileno(), _HEAD_BYTES, before)))
                if crc32c(memoryview(data)[head:]) != body:
                    raise BrokenBlockError("its checksum differs")
            with pa.ipc.open_stream(pa.py_buffer(self._opening.data + data)) as reader:
                batch, metadata = reader.read_next_batch_with_custom_metadata()
            return batch, _note(metadata)
        except (BrokenBlockError, pa.ArrowException, OSError, KeyError, TypeError, ValueError, StopIteration) as error:
            told = error if isinstance(error, BrokenBlockError) else "it is no block of this record"
            raise InputError(f"{self.path}: a block at byte {at} is damaged: {told}; hil check tells more") from None

    def _without_gaps(self, tick: int) -> int | None:
        """The block that would hold a tick if none were missing."""
        if self._blocks < _FEW:
            return None
        first = self._first_tick(0)
        each = self._first_tick(1) - first
        return (tick - first) // each if each > 0 else None

    def _first_tick(self, block: int) -> int:
        """Of a block, not checked: what is then read is. The column of ticks is the first, so its body begins so."""
        at = self._begin + block * self._length
        at += head_length(os.pread(self._file.fileno(), PREFIX, self._begin))
        return int.from_bytes(os.pread(self._file.fileno(), 8, at), "little", signed=True)


def _note(metadata: Any) -> dict[str, Any]:
    return dict(json.loads(metadata[HEADER_KEY]))
