"""Key files: one line, `gyrohil-key-1` and 64 hexadecimal digits, readable by their owner only."""

import os
import re
import secrets
import stat
from pathlib import Path

from hil.wire.errors import LinkError
from hil.wire.keyed import KEY_SIZE

_FIRST = "gyrohil-key-1"
_LINE = re.compile(rf"{_FIRST} ([0-9a-fA-F]{{{2 * KEY_SIZE}}})\n?")
_LONGEST = 1024  # bytes looked at


def make_key(path: Path) -> bytes:
    """Make a key and write it into a new file, mode 0600; returns the key.

    Raises:
        LinkError: the file exists already, or cannot be written.
    """
    key = secrets.token_bytes(KEY_SIZE)
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    except FileExistsError:
        raise LinkError(f"key file {path}: exists already; give another name, a key is never overwritten") from None
    except OSError as error:
        raise LinkError(f"key file {path}: {error.strerror}; give another name") from None
    try:
        with os.fdopen(fd, "w", encoding="ascii") as file:
            os.fchmod(file.fileno(), 0o600)  # whatever the umask was
            file.write(f"{_FIRST} {key.hex()}\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        path.unlink(missing_ok=True)
        raise LinkError(f"key file {path}: {error.strerror}; nothing was left there") from None
    return key


def read_key(path: Path) -> bytes:
    """The key in a file, 32 bytes.

    Raises:
        LinkError: no such file, others may read or write it, it is somebody else's, or it holds no key. The message
            never shows what is in it.
    """
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a FIFO would make it wait
        with os.fdopen(fd, "rb") as file:
            about = os.fstat(fd)
            if not stat.S_ISREG(about.st_mode):
                raise LinkError(f"key file {path}: not a file; make one with `hil key FILE`")
            if about.st_mode & 0o077:
                mode = stat.S_IMODE(about.st_mode)
                raise LinkError(f"key file {path}: others may use it (mode {mode:04o}); chmod 600 {path}, or a new key")
            if about.st_uid not in (os.geteuid(), 0):
                raise LinkError(f"key file {path}: belongs to another user; make one of your own with `hil key FILE`")
            text = file.read(_LONGEST).decode("ascii", "replace")
    except LinkError:
        raise
    except FileNotFoundError:
        raise LinkError(f"key file {path}: no such file; make one with `hil key {path}`") from None
    except OSError as error:
        raise LinkError(f"key file {path}: {error.strerror}; name a key file of your own") from None
    found = _LINE.fullmatch(text)
    if found is None:
        raise LinkError(
            f"key file {path}: expected one line, {_FIRST} and {2 * KEY_SIZE} hexadecimal digits; "
            "make one with `hil key FILE`"
        )
    return bytes.fromhex(found[1])


def as_c(key: bytes) -> str:
    """The key as an initialised array of C."""
    rows = [", ".join(f"0x{byte:02X}" for byte in key[at : at + 8]) for at in range(0, len(key), 8)]
    return f"static const uint8_t key[{len(key)}] = {{\n" + "".join(f"    {row},\n" for row in rows) + "};\n"
