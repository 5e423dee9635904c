"""Whether a MATLAB file (version 4 or 5) has all bytes that it declares: SciPy reads a cut one without a word."""

import struct
from pathlib import Path

_HEADER_5, _TAG_5, _HEADER_4 = 128, 8, 20
_BYTES_4 = (8, 4, 4, 2, 2, 1)
"""Of a number, by the third digit of a matrix's type in version 4."""


def missing_bytes(path: Path) -> int:
    """How many of the declared bytes are missing, 0 where none is."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(_HEADER_5)
        order = {b"IM": "<", b"MI": ">"}.get(head[126:128])
        at = 0 if order is None else _HEADER_5
        while at < size:
            file.seek(at)
            read = file.read(_TAG_5 if order is not None else _HEADER_4)
            length = _length_4(read) if order is None else _length_5(read, order)
            at += len(read) + length
    return max(at - size, 0)


def _length_5(tag: bytes, order: str) -> int:
    """Bytes of an element behind its tag; of a cut tag what it lacks."""
    return int(struct.unpack(f"{order}II", tag)[1]) if len(tag) == _TAG_5 else _TAG_5 - len(tag)


def _length_4(head: bytes) -> int:
    if len(head) < _HEADER_4:
        return _HEADER_4 - len(head)
    order = "<" if 0 <= struct.unpack("<i", head[:4])[0] < 10_000 else ">"
    kind, rows, columns, imaginary, name = struct.unpack(f"{order}5i", head)
    of_number = _BYTES_4[min(kind // 10 % 10, len(_BYTES_4) - 1)]
    return max(int(rows * columns * of_number * (2 if imaginary == 1 else 1) + name), 0)
