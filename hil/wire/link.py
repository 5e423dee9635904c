"""What every link does: bytes in, bytes out."""

from typing import Protocol


class Link(Protocol):
    """A byte stream to one peer. Implementations: serial port, pty, in-process board."""

    @property
    def name(self) -> str:
        """The link as the user knows it, for messages."""
        ...

    def fileno(self) -> int | None:
        """Descriptor to wait on, or None where there is nothing to wait for."""
        ...

    def send(self, data: bytes) -> None:
        """Hand over all of `data`, waiting for room where the link has a bounded queue. Raises LinkClosed."""
        ...

    def receive(self, timeout_s: float | None) -> bytes:
        """Bytes that have arrived, at least one; b"" if none came within `timeout_s` seconds (None: wait for
        ever). Raises LinkClosed after a hang-up."""
        ...

    def close(self) -> None:
        """Let go of the link; a second call does nothing."""
        ...
