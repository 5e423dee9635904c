"""Whether a path leads to a file that ends: a pipe is waited for, a device has no end, and a file of the kernel's own
(/proc/kmsg) has no length and may be waited for too."""

import errno
import os
import stat
from pathlib import Path

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a directory",
}
_OF_KERNEL = "made by the kernel as it is read"


def what_instead(path: Path) -> str | None:
    """What stands at `path`, behind all links, where that is no regular file. Raises OSError where nothing does."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        return _KINDS.get(stat.S_IFMT(found.st_mode), "no file")
    if found.st_blocks == 0 and os.statvfs(path).f_blocks == 0:  # /proc, /sys: nothing is stored there
        return _OF_KERNEL
    return None


def require_regular(path: Path) -> None:
    """OSError that says what stands at `path` where that is no regular file, before it is opened."""
    if (what := what_instead(path)) is not None:
        raise OSError(errno.EINVAL, f"is {what}", str(path))
