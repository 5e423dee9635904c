"""A link on a socket that carries whole frames: what CAN and UDP have in common.

There is no hang-up on such a medium: a peer that leaves is only silent.  What is noticed is the loss of the interface.
"""

import errno
import os
import select
import socket
import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from hil.wire.errors import LinkClosed
from hil.wire.frame_format import FrameFormat
from hil.wire.link import Claim

BATCH = 256
"""Datagrams taken in one call at most."""

Source = Any
"""Address of a sender; what it is made of depends on the family of the socket."""

_FULL = (errno.ENOBUFS, errno.EAGAIN)
_ROOM_S = 50e-6  # a full queue of an interface cannot be waited for, only tried again
_WORDS = {
    errno.ENETDOWN: "the interface is down",
    errno.ENODEV: "the interface is gone",
    errno.ENXIO: "the interface is gone",
    errno.ENETUNREACH: "there is no way to this network",
}


class DatagramLink(ABC):
    """A non-blocking socket and what `Link` asks for; `_out` and `_in` translate between frames and datagrams.

    Attributes:
        drop_when_full: as `BoardLink`.
        dropped_bytes: what was lost that way.
    """

    def __init__(self, wire: socket.socket, name: str, form: FrameFormat, claim: Claim, advice: str) -> None:
        wire.setblocking(False)
        ask_for_stamps(wire)
        self.name = name
        self.url = name
        self.format = form
        self.advice = advice
        self.arrived_ns = 0
        self.drop_when_full = False
        self.dropped_bytes = 0
        self._wire = wire
        self._watch = [wire]
        self._claim = claim

    def fileno(self) -> int:
        return self._wire.fileno()

    def send(self, data: bytes) -> None:
        """Send every frame in `data`, waiting for room or, with `drop_when_full`, losing what finds none. Raises
        LinkClosed."""
        while (taken := self.offer(data)) < len(data):
            data = data[taken:]
            if self.drop_when_full:
                self.dropped_bytes += len(data)
                return
            time.sleep(_ROOM_S)

    def offer(self, data: bytes | memoryview) -> int:
        """Send the frames that find room now; how many bytes of `data` that was. Raises LinkClosed."""
        taken = 0
        for datagram, size in self._out(bytes(data)):
            try:
                self._put(datagram)
            except OSError as error:
                if error.errno in _FULL:
                    break
                raise self.closed(error.errno or 0) from None
            taken += size
        return taken

    def receive(self, timeout_s: float | None) -> bytes:
        """All frames that have arrived, BATCH at most; b"" if none came within `timeout_s` seconds (None: wait for
        ever). Raises LinkClosed."""
        if self._wire.fileno() < 0:
            raise LinkClosed(f"{self.name}: the link is closed")
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            if timeout_s != 0.0 and not select.select(self._watch, (), (), timeout_s)[0]:
                return b""
            if data := self._take():
                return data
            # What came was somebody else's: it must not pass for the peer's silence.
            if deadline is not None:
                timeout_s = deadline - time.monotonic()
                if timeout_s <= 0.0:
                    return b""

    def _take(self) -> bytes:
        """All frames that have arrived, BATCH datagrams at most."""
        frames: list[bytes] = []
        stamp: list[tuple[int, int, bytes]] = []
        try:
            for _ in range(BATCH):
                datagram, ancillary, _, source = self._wire.recvmsg(65536, ANCILLARY_SIZE)
                frame = self._in(datagram, source)
                if frame is not None:
                    frames.append(frame)
                    stamp = ancillary
        except BlockingIOError:
            pass
        except LinkClosed:  # of `_in`, which says why
            raise
        except OSError as error:
            if not frames:
                raise self.closed(error.errno or 0) from None
        if not frames:
            return b""
        self.arrived_ns = stamp_ns(stamp)
        return b"".join(frames)

    def await_host(self) -> None:
        """Be ready for another host: what the last one left unread is dropped. Hosts come and go unseen."""
        with suppress(LinkClosed):
            while self.receive(0.0):
                pass

    def close(self) -> None:
        self._wire.close()
        self._claim.release()

    @abstractmethod
    def _put(self, datagram: bytes) -> None:
        """Send one datagram or raise OSError."""

    @abstractmethod
    def _out(self, data: bytes) -> list[tuple[bytes, int]]:
        """The datagrams of one or several frames, and how much of `data` each stands for."""

    @abstractmethod
    def _in(self, datagram: bytes, source: Source) -> bytes | None:
        """The frame in a datagram, None if it is to be dropped. `source` is where it came from, as the socket says."""

    def closed(self, number: int) -> LinkClosed:
        """What it means that the socket cannot be used, by errno."""
        what = "the link is closed" if number == errno.EBADF else _WORDS.get(number, os.strerror(number))
        return LinkClosed(f"{self.name}: {what}")


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
