"""A log of everything on a CAN link while something else runs, in a format that CAN tools read.

It listens beside the link, in this process, as any other node of the bus would: nothing of it stands in the way of the
loop.  python-can chooses the format by the file's name.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can

from hil.wire.can_adapter import open_bus
from hil.wire.errors import LinkError
from hil.wire.links import parse_can

FORMATS = (".log", ".blf", ".asc")
"""candump, Vector's binary format, Vector's text format."""

_TAIL_S = 0.2  # for the last frames to come through


@contextmanager
def wire_log(path: Path, url: str) -> Iterator[None]:
    """Log the frames of the CAN link `url` into `path` for the length of the block.

    Raises:
        LinkError: not a CAN link, not one of FORMATS, the file cannot be written, or the adapter serves only one
            program.
    """
    kind, _, rest = url.partition(":")
    if kind != "can":
        raise LinkError(f"wire log: {url} has no CAN frames to log; use a link can:…")
    if path.suffix not in FORMATS:
        raise LinkError(f"wire log: {path}: expected a name that ends in {', '.join(FORMATS)}")
    where = parse_can(rest)
    bus = open_bus(f"wire log: {url}", where.interface or "socketcan", where.channel, where.options)
    try:
        try:
            log = can.Logger(path)
        except OSError as error:
            raise LinkError(f"wire log: {path}: {error.strerror}; give another file") from None
        notifier = can.Notifier(bus, [log], timeout=0.1)
        try:
            yield
        finally:
            time.sleep(_TAIL_S)
            notifier.stop()
    finally:
        bus.shutdown()
