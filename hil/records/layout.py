"""What a record file holds: its columns, their units, and what its header says.

One `Layout` gives the NumPy row type that the loop fills, the ring carries and the Arrow file stores, so the
three cannot drift apart.
"""

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from hil.records.seal import METHOD

HEADER_KEY = b"gyrohil"
VERSION = 1

BENCH = "bench"
"""Clock of the record itself: ticks, or seconds counted by them."""
HOST = "host"
"""Clock of a column of nanoseconds: the host's monotonic clock."""
BOARD = "board"
"""Clock of a column of nanoseconds: the board's own."""

_STRUCT_CODES = {"i8": "q", "i4": "i", "u1": "B", "f8": "d", "f4": "f"}


class Column(NamedTuple):
    """One column: NumPy type code (`i8`, `i4`, `u1`, `f8`, `f4`), unit, SI value of one count, and for a time the clock
    it is on, `BENCH`, `HOST` or `BOARD`."""

    name: str
    type: str
    unit: str = ""
    scale: float = 1.0
    clock: str = ""


TICK = Column("tick", "i8", clock=BENCH)
"""First column of every record: the sample, unwrapped to 64 bits."""


@dataclass(frozen=True)
class Layout:
    """Columns, header and block size of one record file.

    `header` holds JSON values only; `kind`, `version`, `columns` and `checksum` are added to it by `header_json`.
    `block_rows` is the number of rows that reach the disk together.
    """

    kind: str
    columns: tuple[Column, ...]
    block_rows: int
    header: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Packed little-endian row type, fields in column order."""
        return np.dtype([(column.name, f"<{column.type}") for column in self.columns])

    @cached_property
    def row(self) -> struct.Struct:
        """The same row for `struct.pack_into`, which beats NumPy for a row at a time."""
        return row_struct(self.dtype)

    def header_json(self, heads: Sequence[int]) -> str:
        """The file header: fixed key order, so that equal runs give equal bytes; `heads` are the lengths that heads of
        its blocks have."""
        columns = {
            column.name: {"unit": column.unit, "scale": column.scale}
            | ({"clock": column.clock} if column.clock else {})
            for column in self.columns
        }
        return json.dumps(
            {
                "kind": self.kind,
                "version": VERSION,
                **self.header,
                "columns": columns,
                "checksum": {"method": METHOD, "heads": list(heads)},
            },
            ensure_ascii=False,
            allow_nan=False,
        )

    def to_json(self) -> str:
        """Everything needed to rebuild this layout in another process."""
        return json.dumps(
            {
                "kind": self.kind,
                "columns": self.columns,
                "block_rows": self.block_rows,
                "header": dict(self.header),
            }
        )

    @classmethod
    def from_json(cls, text: str) -> Self:
        parts = json.loads(text)
        columns = tuple(Column(*entry) for entry in parts["columns"])
        return cls(parts["kind"], columns, parts["block_rows"], parts["header"])


def row_struct(dtype: np.dtype[np.void]) -> struct.Struct:
    """`struct.Struct` of one packed little-endian row of `dtype`."""
    return struct.Struct("<" + "".join(_STRUCT_CODES[dtype[name].str[1:]] for name in dtype.names or ()))


def block_rows_for(tick_rate_Hz: float, seconds: float = 0.25) -> int:
    """Rows per block: a power of two near `seconds` of bench time, at least 64 and at most 65,536.

    It depends on bench time alone: where a block ends must not depend on how fast the machine was.
    """
    wanted = max(tick_rate_Hz * seconds, 1.0)
    return min(max(1 << round(math.log2(wanted)), 64), 65_536)
