"""Whether somebody works on a run folder: who does holds a lock on it, which the kernel takes away when he dies."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def occupied(folder: Path) -> Iterator[None]:
    """Hold the folder for the length of the block. Where the file system has no locks, nobody is told."""
    descriptor = None
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        fcntl.flock(descriptor, fcntl.LOCK_EX)  # others hold it for the moment in which they ask
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def is_occupied(folder: Path) -> bool:
    """Whether somebody holds it."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False
