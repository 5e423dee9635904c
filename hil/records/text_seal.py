"""The checksum that a text file of a run carries: of the file itself, the digits of the checksum being zero.

    # sealed: CRC-32C 5f0c1a2b          first line of a TOML file, before what it covers
    "seal": "CRC-32C 5f0c1a2b"          first key of a JSON file

So a cut, a changed bit and an edited figure show, as they do in the records (`hil.records.seal`).  A checksum is no
signature: it finds accidents and thoughtless edits, not a forger.
"""

import re

from crc32c import crc32c

from hil.errors import InputError

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
