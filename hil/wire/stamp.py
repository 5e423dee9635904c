"""When a datagram or CAN frame reached this machine, by the kernel's own stamp."""

import socket
import struct
import time
from collections.abc import Sequence

_SO_TIMESTAMPNS = 35  # Linux; Python's socket module does not name it
_TIMESPEC = struct.Struct("@ll")
ANCILLARY_SIZE = socket.CMSG_SPACE(_TIMESPEC.size)


def ask_for_stamps(wire: socket.socket) -> None:
    """Have the kernel stamp whatever arrives."""
    wire.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)


def stamp_ns(ancillary: Sequence[tuple[int, int, bytes]]) -> int:
    """The stamp that came with `recvmsg`, on the monotonic clock; 0 without one."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = map(int, _TIMESPEC.unpack(data))
            # The kernel stamps in wall time; the distance to the monotonic clock is that of this moment.
            age = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
            return time.monotonic_ns() - age
    return 0
