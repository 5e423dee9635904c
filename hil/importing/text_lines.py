"""The text of a file, plain or gzipped, in pieces of whole lines: decoded strictly, each line ended by a line feed."""

import codecs
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from hil.errors import InputError

_PIECE_BYTES, _BEGINNING = 1 << 22, 1 << 16
_GZIP_MAGIC = b"\x1f\x8b"
_LONGEST_LINE = 1 << 22
_UNPACKED_BYTES, _RATIO = 1 << 28, 200
"""Beyond so many bytes, what is gzipped may be so many times its size: text of numbers is some ten times."""
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def pieces(path: Path, encoding: str) -> Iterator[str]:
    """The text at `path`.  A byte order mark goes before `encoding`.

    Raises InputError for what cannot be opened, is damaged, or is no text in this encoding, with the line and the key.
    """
    zipped = _is_zipped(path)
    with _opened(path, zipped) as file:
        beginning = _read(path, file, 4, 0)
        encoding = next((name for mark, name in _MARKS if beginning.startswith(mark)), encoding)
        decoder = codecs.getincrementaldecoder("utf-8-sig" if encoding == "utf-8" else encoding)()
        lines, kept, held, size = 0, "", beginning, 0
        most = max(_UNPACKED_BYTES, _RATIO * path.stat().st_size)
        while True:
            data = _read(path, file, _PIECE_BYTES, lines)
            size += len(data)
            if size > most and zipped:
                raise InputError(f"{path}: unpacks to more than {_RATIO} times its size; unpack and check it")
            try:
                text = kept + decoder.decode(held + data, final=not data)
            except (UnicodeError, LookupError) as error:
                raise InputError(_undecoded(path, encoding, error, lines + kept.count("\n"), held + data)) from None
            if "\0" in text:
                at = lines + text[: text.index("\0")].count("\n")
                raise InputError(
                    f"{path}: not {encoding} text at line {at + 1}; {_encoding_meant(held + data, encoding)}"
                )
            held = b""
            if data and text.endswith("\r"):  # of CRLF perhaps: the line feed is in what comes
                text, kept = text[:-1], "\r"
            else:
                kept = ""
            text = text.replace("\r\n", "\n").replace("\r", "\n")
            end = text.rfind("\n") + 1 if data else len(text)
            text, kept = text[:end], text[end:] + kept
            if len(kept) > _LONGEST_LINE:
                at = lines + text.count("\n") + 1
                raise InputError(
                    f"{path}:{at}: a line of more than {_LONGEST_LINE >> 20} MB is no row; give a file of lines"
                )
            if text:
                yield text
                lines += text.count("\n")
            if not data:
                return


def beginning_of(path: Path, encoding: str) -> str:
    """The first whole lines of a text, or what there is of them."""
    text = next(pieces(path, encoding), "")
    return text if len(text) <= _BEGINNING else text[: text.rfind("\n", 0, _BEGINNING) + 1] or text


def _is_zipped(path: Path) -> bool:
    try:
        with path.open("rb") as raw:
            return raw.read(len(_GZIP_MAGIC)) == _GZIP_MAGIC
    except OSError as error:
        reason = (error.strerror or "unreadable").lower()
        raise InputError(f"{path}: cannot be read ({reason}); give a CSV file, plain or gzipped") from None


def _opened(path: Path, zipped: bool) -> IO[bytes]:
    return gzip.open(path) if zipped else path.open("rb")  # type: ignore[return-value]


def _read(path: Path, file: IO[bytes], size: int, lines: int) -> bytes:
    try:
        return file.read(size)
    except (OSError, EOFError, zlib.error):
        raise InputError(
            f"{path}: damaged or cut gzip data at or after line {lines + 1}; fetch the file again"
        ) from None


def _undecoded(path: Path, encoding: str, error: Exception, lines: int, data: bytes) -> str:
    at = getattr(error, "start", 0)
    if isinstance(getattr(error, "object", None), bytes):
        lines += error.object[:at].count(b"\n")  # type: ignore[attr-defined]
    named = "UTF-8" if encoding == "utf-8" else encoding
    return f"{path}: not {named} text at line {lines + 1}; {_encoding_meant(data, encoding)}"


def _encoding_meant(data: bytes, encoding: str) -> str:
    """The remedy, by the bytes themselves."""
    sample = data[:4096]
    zeros = [sample[start::4].count(0) > 0.9 * len(sample[start::4]) for start in range(4)]
    for name, pattern in (("utf-32-le", [False, True, True, True]), ("utf-32-be", [True, True, True, False])):
        if len(sample) >= 8 and zeros == pattern and encoding != name:
            return f'set encoding = "{name}" in a --map'
    for name, odd in (("utf-16-le", sample[1::2]), ("utf-16-be", sample[::2])):
        if encoding != name and len(odd) > 1 and odd.count(0) > 0.9 * len(odd):
            return f'set encoding = "{name}" in a --map'
    if encoding != "cp1252" and not any(byte < 9 or 13 < byte < 32 for byte in sample):
        return 'set its encoding in a --map, as encoding = "cp1252"'
    return "give CSV, plain or gzipped"
