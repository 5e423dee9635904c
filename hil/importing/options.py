"""What may be asked of an import beside the file: one declaration, from which every caller takes its options.

`hil import`, `hil.import_record`, the record of a test and the service's requests are made of it, and what
`hil.replay`, `hil.trace` and `hil.compare` take for records that are arrays.
"""

from pathlib import Path
from typing import Annotated, Literal

from typing_extensions import TypedDict

from hil.options import Called, Help


class ImportOptions(TypedDict, total=False):
    """How a record is to be understood that is no capture yet: a file of another format, or arrays."""

    mapping: Annotated[
        Path | str | None,
        Called("map", "m"),
        Help("Map of columns, units and rate for other layouts; a file or an example."),
    ]
    hold: Annotated[
        Literal["zoh", "foh", "bandlimited"] | None,
        Help("What the drive did between samples.  [default: the map's, or zoh]"),
    ]
    nonuniform: Annotated[bool, Help("Accept uneven time steps and gaps.")]
    demodulated: Annotated[
        str | None,
        Help("Streams of a lock-in, X and Y of two channels: their carrier in Hz, or the column that has it."),
    ]


class LocalImportOptions(ImportOptions, total=False):
    """And what names a file of the machine on which it is done."""

    out: Annotated[
        Path | str | None, Called("out", "o"), Help("Capture to write.  [default: the file's name with .arrow]")
    ]
    dbc: Annotated[
        Path | str | None,
        Help("Of a log of CAN frames (candump, BLF, ASC, MF4, TRC): its DBC, or the name of a gyro that is known."),
    ]
    reference: Annotated[str | None, Help("Of a log with several rates: the one that is true.")]
    replace: Annotated[bool, Help("Overwrite an existing file.")]
