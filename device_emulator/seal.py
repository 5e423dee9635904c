"""The checksums of a truth file's blocks, as docs/reference/run-folder.md has them.

Written from that page and not shared with the bench, whose reader thereby checks both.
"""

import io
import json
from collections.abc import Mapping
from typing import Any

import pyarrow as pa
from crc32c import crc32c

NOTE_KEY = b"gyrohil"

_NOTE_BYTES = 128
_UNSEALED = b'{"head": "00000000", "body": "00000000"'
_HEAD, _BODY = slice(10, 18), slice(30, 38)  # where the digits stand in a note


class SealedStream:
    """Makes the bytes of a stream of `schema`: header and first block, then block by block, each with its checksums."""

    def __init__(self, schema: Any, header: Mapping[str, Any]) -> None:
        text = json.dumps({**header, "checksum": {"method": "CRC-32C", "heads": _head_lengths(schema)}}, sort_keys=True)
        self.schema = schema.with_metadata({NOTE_KEY: text})
        self._made = io.BytesIO()
        self._stream = pa.ipc.new_stream(self._made, self.schema)
        self._before: int | None = None
        self._blocks = self._rows = 0

    def block(self, arrays: list[Any]) -> bytes:
        """The next block of rows; the first one, which brings the header along, has none."""
        rows = len(arrays[0])
        made = self._message(arrays, {"block": self._blocks, "first_row": self._rows, "rows": rows})
        self._blocks += 1
        self._rows += rows
        return made

    def end(self) -> bytes:
        """The end marker and the end of the stream."""
        made = self._message(_empty(self.schema), {"end": True, "rows": self._rows})
        self._stream.close()
        return made + self._taken()

    def opening(self) -> bytes:
        """Header and first block."""
        return self.block(_empty(self.schema))

    def _message(self, arrays: list[Any], note: Mapping[str, Any]) -> bytes:
        _write(self._stream, self.schema, arrays, note)
        made, header = self._taken(), b""
        if self._before is None:
            header, made = made[: _head_end(made)], made[_head_end(made) :]
            self._before = crc32c(header)
        at, end = made.index(_UNSEALED), _head_end(made)
        text = bytearray(made[at : at + len(_UNSEALED)])
        text[_BODY] = b"%08x" % crc32c(made[end:])
        self._before = crc32c(made[:at] + text + made[at + len(text) : end], self._before)
        text[_HEAD] = b"%08x" % self._before
        return header + made[:at] + bytes(text) + made[at + len(text) :]

    def _taken(self) -> bytes:
        made = self._made.getvalue()
        self._made.seek(0)
        self._made.truncate()
        return made


def _write(stream: Any, schema: Any, arrays: list[Any], note: Mapping[str, Any]) -> None:
    text = json.dumps({"head": "0" * 8, "body": "0" * 8, **note}).ljust(_NOTE_BYTES)
    stream.write_batch(pa.record_batch(arrays, schema=schema), custom_metadata={NOTE_KEY: text})


def _head_lengths(schema: Any) -> list[int]:
    """How long the heads are of a block without and with rows."""
    lengths = []
    for arrays in (_empty(schema), [pa.array([0], kind) for kind in schema.types]):
        made = io.BytesIO()
        with pa.ipc.new_stream(made, schema) as stream:
            _write(stream, schema, arrays, {})
        data = made.getvalue()
        lengths.append(_head_end(data[_head_end(data) :]))
    return lengths


def _empty(schema: Any) -> list[Any]:
    return [pa.array([], kind) for kind in schema.types]


def _head_end(message: bytes) -> int:
    return 8 + int.from_bytes(message[4:8], "little")
