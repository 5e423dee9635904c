"""A ring of rows in shared memory: one process pushes, one pops, neither ever waits for a lock.

The producer writes rows, then publishes the write index; the consumer copies rows out, then publishes the
read index. Neither index is ever written by both sides, so a row is seen whole or not at all, also when a
process is killed in the middle. When the ring is full the producer counts what it drops (real time) or waits
(lockstep).
"""

import json
import mmap
import os
import struct
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from hil.records.layout import row_struct

_MAGIC = b"GYRORING"
_PREFIX = struct.Struct("<8sqqq")  # magic, capacity in rows, offset of the rows, length of the dtype's JSON
# one cache line each, so that the two sides do not steal each other's
_WRITTEN, _READ, _DROPPED, _CLOSED, _DTYPE = 64, 128, 192, 256, 320
_PAUSE_S = 50e-6
_BEING_WRITTEN = 1024  # rows that a producer may be writing at once and has not published; a block has fewer


class Lent(NamedTuple):
    """Addresses in this process: of the first row, of the words `written`, `read` and `dropped`; and how many rows have
    been put there."""

    rows: int
    written: int
    read: int
    dropped: int
    head: int


class _Mapped:
    """A ring as it lies in memory that is mapped here."""

    def __init__(self, memory: mmap.mmap, path: Path | str = "") -> None:
        magic, capacity, offset, length = _PREFIX.unpack_from(memory)
        if magic != _MAGIC:
            raise ValueError(f"{path}: not a ring" if path else "not a ring")
        names_and_types = json.loads(memory[_DTYPE : _DTYPE + length])
        self.dtype: np.dtype[np.void] = np.dtype([tuple(entry) for entry in names_and_types])
        self.capacity: int = capacity
        self._memory = memory
        self._offset: int = offset
        # as bytes: NumPy copies rows of a packed dtype field by field
        flat = np.frombuffer(memory, np.uint8, capacity * self.dtype.itemsize, offset)
        self._rows: npt.NDArray[np.uint8] = flat.reshape(capacity, self.dtype.itemsize)
        self._words = memoryview(memory)[:_DTYPE].cast("q")
        self._fence = threading.Lock()
        self._fence.acquire()

    @property
    def closed(self) -> bool:
        """True once the producer has said that it is done."""
        return bool(self._words[_CLOSED // 8])

    def detach(self) -> None:
        if not self._memory.closed:
            self._words.release()
            del self._rows
            self._memory.close()

    def _copied(self, begin: int, end: int) -> npt.NDArray[np.void]:
        """Rows [begin, end) of all that were written, in order."""
        at, count = begin % self.capacity, end - begin
        first = min(count, self.capacity - at)
        self._order()
        rows = np.concatenate([self._rows[at : at + first], self._rows[: count - first]]).reshape(-1).view(self.dtype)
        self._order()
        return rows

    def _order(self) -> None:
        # A lock given back and taken again is the one memory fence Python has: x86 needs none, ARM does.
        self._fence.release()
        self._fence.acquire()


class Ring(_Mapped):
    """Single-producer single-consumer ring of rows of one packed structured dtype.

    Make it with `create` (producer or its parent) and open it elsewhere with `attach`. In real time the
    producer never waits: what finds no room is dropped and counted. Where it may wait (lockstep), set
    `while_full`: it is asked each time the ring is found full, and answers whether to wait on.
    """

    while_full: Callable[[], bool] | None = None

    def __init__(self, path: Path, memory: mmap.mmap) -> None:
        super().__init__(memory, path)
        self.path = path
        self._row = row_struct(self.dtype)
        self._head: int = self._words[_WRITTEN // 8]
        self._tail: int = self._words[_READ // 8]
        self._dropped = 0

    @classmethod
    def create(cls, name: str, dtype: np.dtype[np.void], capacity: int) -> Self:
        """Make a ring of `capacity` rows under `name` (a plain file name, unique on this machine).

        Raises FileExistsError when the name is taken, OSError with its path when there is no memory for it.
        """
        description = json.dumps([list(entry) for entry in dtype.descr]).encode()
        offset = -(-(_DTYPE + len(description)) // mmap.PAGESIZE) * mmap.PAGESIZE
        path = _directory() / f"gyrohil-{name}"
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            # reserve now: writing to a page that cannot be had would be a SIGBUS in the middle of the loop
            os.posix_fallocate(descriptor, 0, offset + capacity * dtype.itemsize)
            flags = mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0)  # no page is fetched in the middle of the loop
            memory = mmap.mmap(descriptor, offset + capacity * dtype.itemsize, flags)
        except OSError as error:
            path.unlink()
            raise OSError(error.errno, error.strerror, str(path)) from None
        finally:
            os.close(descriptor)
        memory[_DTYPE : _DTYPE + len(description)] = description
        _PREFIX.pack_into(memory, 0, _MAGIC, capacity, offset, len(description))
        return cls(path, memory)

    @classmethod
    def attach(cls, name: str) -> Self:
        """Open the ring called `name`. Raises FileNotFoundError when there is none."""
        path = _directory() / f"gyrohil-{name}"
        descriptor = os.open(path, os.O_RDWR)
        try:
            memory = mmap.mmap(descriptor, 0)
        finally:
            os.close(descriptor)
        return cls(path, memory)

    def put(self, *values: float) -> bool:
        """Append one row, given column by column; False (and counted) when there is no room for it."""
        head = self._head
        if head - self._tail >= self.capacity and not self.room():
            self._words[_DROPPED // 8] += 1
            return False
        self._row.pack_into(self._memory, self._offset + head % self.capacity * self._row.size, *values)
        self._publish(head + 1)
        return True

    def lend(self) -> Lent:
        """Where rows and indices are, for one who puts rows here without `put`; `advance` tells how many there were."""
        words = self._rows.ctypes.data - self._offset
        return Lent(self._rows.ctypes.data, words + _WRITTEN, words + _READ, words + _DROPPED, self._head)

    def advance(self, head: int) -> None:
        """So many rows have been put here and published in all."""
        self._head = head

    def push(self, rows: npt.NDArray[np.void]) -> int:
        """Append rows; returns how many were taken. The newest are dropped (and counted) when there is no
        room.
        """
        data = np.ascontiguousarray(rows, self.dtype).view(np.uint8).reshape(rows.size, self.dtype.itemsize)
        taken = 0
        while taken < rows.size and (room := self.room()):
            count = min(rows.size - taken, room)
            at = self._head % self.capacity
            first = min(count, self.capacity - at)
            self._rows[at : at + first] = data[taken : taken + first]
            self._rows[: count - first] = data[taken + first : taken + count]
            self._publish(self._head + count)
            taken += count
        if taken < rows.size:
            self._words[_DROPPED // 8] += rows.size - taken
        return taken

    def pop(self) -> npt.NDArray[np.void]:
        """Take out all rows there are, as a copy in order; empty when there are none."""
        written: int = self._words[_WRITTEN // 8]
        rows = self._copied(self._tail, written)
        self._tail = written
        self._words[_READ // 8] = written
        return rows

    @property
    def dropped(self) -> int:
        """Rows that found no room so far; after `detach`, until then."""
        return self._dropped if self._memory.closed else int(self._words[_DROPPED // 8])

    @property
    def read(self) -> int:
        return int(self._words[_READ // 8])

    @property
    def waiting(self) -> int:
        return int(self._words[_WRITTEN // 8]) - self.read

    def finish(self) -> None:
        """Say that no more rows will come; the consumer can tell this from a producer that was killed."""
        self._order()
        self._words[_CLOSED // 8] = 1

    def unlink(self) -> None:
        """Take the name away. Who has the ring open keeps it; the memory goes with the last of them."""
        self.path.unlink(missing_ok=True)

    def detach(self) -> None:
        if not self._memory.closed:
            self._dropped = self.dropped
        super().detach()

    def room(self) -> int:
        """Free rows; when there are none, wait for some as long as `while_full` says so."""
        while True:
            self._tail = self._words[_READ // 8]
            room = self.capacity - (self._head - self._tail)
            if room or self.while_full is None or not self.while_full():
                return room
            time.sleep(_PAUSE_S)

    def _publish(self, head: int) -> None:
        self._order()
        self._head = head
        self._words[_WRITTEN // 8] = head

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self.detach()


class Onlooker(_Mapped):
    """One more reader of a ring, unknown to both sides: it only reads, and what it is too late for is gone.

    `descriptor` may be open for reading only; it is not kept.  A row is given once, whole, or counted as lost: what the
    producer may have been writing over while it was copied is left out.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__(mmap.mmap(descriptor, 0, prot=mmap.PROT_READ))
        self.lost = 0
        self._unsafe = min(_BEING_WRITTEN, self.capacity // 4)
        self._at: int = self._words[_WRITTEN // 8]

    def look(self, at_most: int) -> npt.NDArray[np.void]:
        """The rows that were written since the last look, in order, a copy; the oldest beyond `at_most` are lost."""
        written = int(self._words[_WRITTEN // 8])
        begin = max(self._at, written - min(at_most, self.capacity - self._unsafe))
        rows = self._copied(begin, written)
        overwritten = int(self._words[_WRITTEN // 8]) + self._unsafe - self.capacity - begin
        if overwritten > 0:
            rows, begin = rows[overwritten:], min(begin + overwritten, written)
        self.lost += begin - self._at
        self._at = written
        return rows


def _directory() -> Path:
    shared = Path("/dev/shm")
    return shared if os.access(shared, os.W_OK) else Path(tempfile.gettempdir())
