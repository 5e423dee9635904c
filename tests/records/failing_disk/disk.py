"""The shim `failing_disk.c`, compiled and told what to do.

All processes of a run load it before the C library and map the same plan, so that their calls are counted together.
What lies below the run's folder, or is a ring in shared memory, counts; nothing in the product knows of it.
"""

import ctypes
import errno
import mmap
import os
import subprocess
from pathlib import Path
from typing import NamedTuple

_SOURCE = Path(__file__).with_name("failing_disk.c")
_LOGGED = 256

_OPEN, _WRITE, _SYNC, _TRUNCATE, _RENAME, _MAKE, _ALLOCATE, REMOVES, _MODE, _CLOSE = (1 << bit for bit in range(10))
_GROWS = _OPEN | _WRITE | _SYNC | _RENAME | _MAKE | _ALLOCATE
_ALL = (1 << 10) - 1


class Fault(NamedTuple):
    """What a disk does: `error` (0: a write takes half of its bytes), in which calls, once or from then on."""

    error: int
    which: int
    lasting: bool
    halved: bool = False


FAULTS = {
    "disk full": Fault(errno.ENOSPC, _GROWS, lasting=True, halved=True),  # a write takes what finds room, the next none
    "no room, once": Fault(errno.ENOSPC, _GROWS, lasting=False),
    "read-only": Fault(errno.EROFS, _ALL & ~(_SYNC | _CLOSE), lasting=True),
    "input/output error": Fault(errno.EIO, _ALL, lasting=True),
    "input/output error, once": Fault(errno.EIO, _ALL, lasting=False),
    "interrupted, once": Fault(errno.EINTR, _ALL & ~_CLOSE, lasting=False),
    "short write, once": Fault(0, _WRITE, lasting=False),
}
"""By name. What is interrupted or short once is to be done again, and nothing is to be told of it."""

HARMLESS = frozenset({"interrupted, once", "short write, once"})


class _Plan(ctypes.Structure):
    _fields_ = [
        ("at", ctypes.c_int64),
        ("calls", ctypes.c_int64),
        ("failed", ctypes.c_int64),
        ("rings", ctypes.c_int64),
        ("error", ctypes.c_int32),
        ("which", ctypes.c_int32),
        ("lasting", ctypes.c_int32),
        ("halved", ctypes.c_int32),
        ("below", ctypes.c_char * 1024),
        ("log", (ctypes.c_char * _LOGGED) * 512),
        ("ring", (ctypes.c_char * _LOGGED) * 64),
    ]


class Disk:
    """The plan that the processes of one run share; made in `place`, which must lie outside of `below`."""

    def __init__(self, place: Path, below: Path) -> None:
        self._library = place / "failing_disk.so"
        if not self._library.exists():
            compiler = os.environ.get("CC", "cc")
            strict = ["-O2", "-Wall", "-Wextra", "-Werror"]
            subprocess.run([compiler, "-shared", "-fPIC", *strict, "-o", self._library, _SOURCE, "-ldl"], check=True)
        self._path = place / "plan"
        self._path.write_bytes(bytes(ctypes.sizeof(_Plan)))
        with self._path.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), 0)
        self._plan = _Plan.from_buffer(self._memory)
        self._plan.below = os.fsencode(below)

    def fail(self, at: int, fault: Fault) -> None:
        """From now on: the call number `at`, counted anew, fails like that; 0 for none."""
        below = self._plan.below
        ctypes.memset(ctypes.addressof(self._plan), 0, ctypes.sizeof(_Plan))
        self._plan.below = below
        self._plan.error, self._plan.which = fault.error, fault.which
        self._plan.lasting, self._plan.halved = fault.lasting, fault.halved
        self._plan.at = at

    @property
    def environment(self) -> dict[str, str]:
        """What a process needs to find it."""
        return {"LD_PRELOAD": str(self._library), "FAILING_DISK": str(self._path)}

    @property
    def calls(self) -> int:
        """Counted since `fail`."""
        return int(self._plan.calls)

    @property
    def failed(self) -> int:
        """Made to fail since `fail`."""
        return int(self._plan.failed)

    @property
    def log(self) -> list[str]:
        """The first calls that failed; where none was to fail, all that there were."""
        return [text for entry in self._plan.log if (text := entry.value.decode("utf-8", "replace"))]

    @property
    def rings(self) -> set[Path]:
        """Rings in shared memory that were opened to be written to since `fail`, of the first 64 times."""
        return {Path(os.fsdecode(entry.value)) for entry in self._plan.ring if entry.value}
