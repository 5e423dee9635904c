"""Whether a path leads to a file that ends: a pipe is waited for, a device has no end."""

import stat
from pathlib import Path

_KINDS = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFDIR: "a directory",
}


def what_instead(path: Path) -> str | None:
    """What stands at `path`, behind all links, where that is no regular file. Raises OSError where nothing does."""
    return _KINDS.get(stat.S_IFMT(path.stat().st_mode))
