"""Files that are either whole or absent.

The checksum that a text file of a run carries: of the file itself, the digits of the checksum being zero.

    # sealed: CRC-32C 5f0c1a2b          first line of a TOML file, before what it covers
    "seal": "CRC-32C 5f0c1a2b"          first key of a JSON file

So a cut, a changed bit and an edited figure show, as they do in the records (`hil.records.seal`).  A checksum is no
signature: it finds accidents and thoughtless edits, not a forger.
"""

import errno
import fcntl
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from crc32c import crc32c

from hil.errors import InputError
from hil.records.kind import checked_name
from hil.wire.regular_file import require_regular

_MOST_BYTES = 1 << 26


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path`; on success it becomes `path`, on any error it disappears.

    A reader sees the old file or the new one, never a part of one. Raises OSError with the name of `path`.
    """
    try:
        _uninterrupted(lambda: path.parent.mkdir(parents=True, exist_ok=True))
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise _named(error, path) from None
    temporary = Path(name)
    try:
        os.close(descriptor)
        yield temporary
        _settle(temporary)
        _uninterrupted(lambda: temporary.chmod(0o666 & ~_umask()))
        _uninterrupted(lambda: temporary.replace(path))
    except OSError as error:
        raise _named(error, path) from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def read_json(path: Path) -> bytes:
    """The bytes of a file that no JSON of this bench is longer than. Raises OSError, also of a longer one and of what
    is no file.
    """
    require_regular(path)
    with path.open("rb") as file:
        text = file.read(_MOST_BYTES + 1)
    if len(text) > _MOST_BYTES:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return text


def _uninterrupted(act: Callable[[], object]) -> None:
    """Do it, again while a signal interrupts it. Python itself repeats open, write and fsync (PEP 475), not those that
    only the disk of a network or of another process interrupts.
    """
    while True:
        with suppress(InterruptedError):
            act()
            return


def _settle(path: Path) -> None:
    """Wait until the disk has the file: a rename must not overtake it."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _named(error: OSError, path: Path) -> OSError:
    """The error with the file's name, which a failed write does not know."""
    return OSError(error.errno, error.strerror, str(path))


def write_text(path: Path, text: str) -> None:
    """Write `text` (UTF-8) to `path`, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_sealed(path: Path, text: str) -> None:
    """`write_text` with a checksum in the first line, which `text_seal.require_unchanged` asks for."""
    write_text(path, sealed(text))


def require_name(name: str) -> None:
    """InputError where no run folder can be called `name`."""
    try:
        checked_name(name)
    except ValueError as error:
        raise InputError(f"--name: {error}") from None


def require_place(out: Path) -> None:
    """InputError where no run folder can be made below `out`; for what takes long before it makes one."""
    there = next(place for place in (out.absolute(), *out.absolute().parents) if place.exists())
    try:
        Path(tempfile.mkdtemp(prefix=".", dir=there)).rmdir()
    except OSError as error:
        raise _no_folder(out, error) from None


def make_run_folder(out: Path, name: str) -> Path:
    """A new folder `<time>-<name>` below `out`; a name that is taken gets a number. Raises InputError."""
    require_name(name)
    stamp = time.strftime("%Y%m%d-%H%M%S")
    for attempt in range(1000):
        folder = out / (f"{stamp}-{name}" + (f"-{attempt + 1}" if attempt else ""))
        try:
            _uninterrupted(partial(folder.mkdir, parents=True))
        except FileExistsError:
            continue
        except OSError as error:
            raise _no_folder(out, error) from None
        return folder
    raise InputError(f"{out}: a thousand runs in one second; give another --name")


def _no_folder(out: Path, error: OSError) -> InputError:
    return InputError(f"{out}: no run folder can be made there ({error.strerror}); give another --out")


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


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


UNSEALED = "CRC-32C 00000000"
"""What stands in a text that is to be sealed."""

_COMMENT = "# sealed: "
_BROKEN = re.compile(rb'\A# sealed|\A\{\s*"seal":\s*"[^"]')
_SEAL = re.compile(rb'((?:\A# sealed: |\A\{\s*"seal": ")CRC-32C )([0-9a-f]{8})')


def sealed(text: str) -> str:
    """The text of a file with its checksum: JSON has `UNSEALED` as its first value, other text gets a first line."""
    if not text.startswith("{"):
        text = f"{_COMMENT}{UNSEALED}\n" + _without_comment(text)
    data = _SEAL.sub(rb"\g<1>00000000", text.encode(), count=1)
    return _SEAL.sub(rb"\g<1>%08x" % crc32c(data), data, count=1).decode()


def is_sealed(data: bytes) -> bool:
    """Whether the bytes of a file carry a checksum."""
    return _SEAL.match(data) is not None


def require_unchanged(data: bytes, name: object, remedy: str) -> None:
    """InputError where the bytes of the file called `name` are not those that were sealed, with the remedy.

    Files of before there was a seal have none and pass.
    """
    found = _SEAL.match(data)
    if found is None:
        if _BROKEN.match(data):
            raise InputError(f"{name}: changed since it was written (its seal is broken); {remedy}")
        return
    start, end = found.span(2)
    if b"%08x" % crc32c(data[:start] + b"0" * 8 + data[end:]) != found[2]:
        raise InputError(f"{name}: changed since it was written (its checksum differs); {remedy}")


def _without_comment(text: str) -> str:
    return text.split("\n", 1)[1] if text.startswith(_COMMENT) and "\n" in text else text
