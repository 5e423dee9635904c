"""A log of everything on a CAN link while something else runs, in a format that CAN tools read.

It listens beside the link, in this process, as any other node of the bus would: nothing of it stands in the way of the
loop.  python-can chooses the format by the file's name.
"""

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
from can.interfaces.socketcan import SocketcanBus

from hil.wire.can_adapter import open_bus
from hil.wire.errors import LinkError
from hil.wire.link_name import CanAdapter, CanInterface, parse_link

FORMATS = (".log", ".blf", ".asc")
"""candump, Vector's binary format, Vector's text format."""

_SO_RCVBUFFORCE, _SO_MEMINFO = 33, 55  # Linux
_MEMINFO = struct.Struct("=9I")  # the last one counts what found no room
_BUFFER = 1 << 26  # bytes to hold while a file or a processor is busy; less where this is not permitted
_QUIET_S = 0.2  # without a frame: everything has come through
_PATIENCE_S = 60.0  # with a bus that does not fall quiet


class WireLog:
    """A log while it is being written; `lost` frames are missing from it because they came too fast."""

    def __init__(self, bus: can.BusABC) -> None:
        self.lost = 0
        self._newest_s = time.monotonic()
        self._wire = bus.socket if isinstance(bus, SocketcanBus) else None
        if self._wire is not None:
            try:
                self._wire.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER)
            except PermissionError:
                self._wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)

    def hear(self, _: can.Message) -> None:
        self._newest_s = time.monotonic()

    def finish(self) -> None:
        """Write what waits still, and see what the kernel could not keep for us."""
        end = time.monotonic()
        while self._newest_s > time.monotonic() - _QUIET_S and time.monotonic() < end + _PATIENCE_S:
            time.sleep(_QUIET_S)
        if self._wire is not None:
            memory = self._wire.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
            self.lost = int(_MEMINFO.unpack(memory)[-1])


@contextmanager
def wire_log(path: Path, url: str) -> Iterator[WireLog]:
    """Log the frames of the CAN link `url` into `path` for the length of the block.

    Raises:
        LinkError: not a CAN link, not one of FORMATS, the file cannot be written, or the adapter serves only one
            program.
    """
    link = parse_link(url)
    if not isinstance(link, CanInterface | CanAdapter):
        raise LinkError(f"wire log: {url} has no CAN frames to log; use a link can:…")
    if path.suffix not in FORMATS:
        raise LinkError(f"wire log: {path}: expected a name that ends in {', '.join(FORMATS)}")
    bus = open_bus(f"wire log: {url}", link)
    try:
        try:
            log = can.Logger(path)
        except OSError as error:
            raise LinkError(f"wire log: {path}: {error.strerror}; give another file") from None
        listening = WireLog(bus)
        notifier = can.Notifier(bus, [log, listening.hear], timeout=0.1)
        try:
            yield listening
        finally:
            listening.finish()
            notifier.stop()
    finally:
        bus.shutdown()
