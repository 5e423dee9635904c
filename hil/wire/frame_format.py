"""How messages become bytes on a link: on a byte stream (`serial_format`) or in CAN frames (`can_format`)."""

from typing import Literal, NamedTuple, Protocol

Sender = Literal[0, 1]
HOST: Sender = 0
BOARD: Sender = 1
"""The ends of a link, numbered as in a CAN identifier."""

UNSEQUENCED = -1
"""In place of a sequence number: the frame has none, and no tick. Only SAFE may."""


class Frame(NamedTuple):
    """One frame as it came off the wire: `type` u8, `seq` u16 or UNSEQUENCED, `tick` u32 (low bits), payload not yet
    understood."""

    type: int
    seq: int
    tick: int
    payload: bytes


class FrameDecoder(Protocol):
    """Takes what a link delivers apart into frames. Never raises on what it reads, and counts what it drops."""

    @property
    def bad(self) -> int:
        """Whatever was dropped as broken."""
        ...

    def feed(self, data: bytes) -> list[Frame]:
        """The intact frames that `data` completes, in order."""
        ...


class FrameFormat(Protocol):
    """Makes frames, and decoders for those of the other end. `seq` is u16; ticks may be of any width.

    Attributes:
        sealed: whether frames bring a checksum of their own; where not, the medium drops damaged ones.
    """

    sealed: bool

    def encode(self, type_: int, seq: int, tick: int, payload: bytes) -> tuple[bytes, int]:
        """Bytes for the link, and how many sequence numbers they take.

        Raises:
            ProtocolError: the payload is longer than the spec allows.
        """
        ...

    def cut(self, data: bytes) -> tuple[list[bytes], bytes]:
        """The whole frames in a stretch of what goes over the link, nobody having looked into them, and the rest."""
        ...

    def kind(self, frame: bytes) -> int | None:
        """Message type of one frame, None if it cannot be read."""
        ...

    def decoder(self) -> FrameDecoder:
        """A decoder for what the other end sends."""
        ...
