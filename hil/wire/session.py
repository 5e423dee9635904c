"""Who a UDP link listens to: one peer per session. A session begins with the host's HELLO.

On loopback without a key the peer is an address, which no other program of the machine can have; with a key
(`hil.wire.keyed`) it is the holder of the key.
"""

import time
from typing import NamedTuple

from hil.wire.codec import type_of
from hil.wire.messages import Hello
from hil.wire.serial_format import SERIAL

PEER_S = 1.0
"""So long a board keeps to a host that is silent, while another one asks for it."""

LEFT = b""
"""In place of a frame: the host leaves, and the board is free for another one."""

Address = tuple[str, int]

_HELLO = type_of(Hello)


class Heard(NamedTuple):
    """What a datagram brought: the `frame` in it (LEFT if the host leaves, None if it was dropped), the `reply` to send
    back to where it came from, and whether a session `opened` with it."""

    frame: bytes | None
    reply: bytes = b""
    opened: bool = False


def is_hello(frame: bytes) -> bool:
    """Whether a datagram is a HELLO, intact."""
    return frame[2:3] == bytes((_HELLO,)) and SERIAL.kind(frame) == _HELLO  # the type is never stuffed: it is not 0


class Peer:
    """The host that a board listens to.

    Attributes:
        address: its IP address and port; None before the first one, and after it has left.
    """

    def __init__(self) -> None:
        self.address: Address | None = None
        self._heard_s = 0.0

    def taken(self, source: Address) -> bool:
        """Whether somebody else has the board."""
        return self.address not in (None, source) and time.monotonic() < self._heard_s + PEER_S

    def heard(self, source: Address) -> None:
        """The peer, from now on if it was not before, has said something."""
        self.address = source
        self._heard_s = time.monotonic()

    def leave(self) -> None:
        """The board is free."""
        self.address = None


class PlainHost:
    """The host's end without a key: the holder of the board's address is the board.

    Attributes:
        refused: datagrams of others, dropped.
        busy: never known.
    """

    busy = False

    def __init__(self) -> None:
        self.refused = 0

    def seal(self, frame: bytes) -> bytes:
        """The datagram for a frame."""
        return frame

    def leave(self) -> bytes:
        """The datagram that ends the session."""
        return LEFT

    def heard(self, datagram: bytes) -> Heard:
        """What a datagram of the board's address brings."""
        return Heard(datagram or None)


class PlainBoard:
    """The board's end without a key: HELLO makes an address the peer's, and only the peer is heard.

    Attributes:
        refused: datagrams of others, dropped.
    """

    def __init__(self) -> None:
        self.refused = 0

    def seal(self, frame: bytes) -> bytes:
        """The datagram for a frame."""
        return frame

    def heard(self, datagram: bytes, *, from_peer: bool, taken: bool) -> Heard:
        """What a datagram brings; arguments as `KeyedBoard.heard`."""
        if from_peer:
            return Heard(datagram)
        if taken or not is_hello(datagram):
            self.refused += 1
            return Heard(None)
        return Heard(datagram, opened=True)
