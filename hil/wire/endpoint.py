"""One end of a link that speaks messages."""

import time
from collections import deque

from hil.wire.frame_format import Frame
from hil.wire.link import Link
from hil.wire.messages import Message
from hil.wire.sense import Sense, SenseRow
from hil.wire.stream import Received, Receiver, Transmitter

INBOX = 1024
"""Messages kept for a later call; beyond that the oldest are forgotten."""


class Endpoint:
    """Messages over a link, with sequence numbers, unwrapped ticks and counters.

    Attributes:
        link: the link below.
        rx: receiving direction with its counters (`rx.lost`, `rx.repeated`, `rx.bad`, `rx.decoder`), and
            `rx.tick`.
        tx: sending direction.
        received_ns: monotonic clock when the last bytes came, by the kernel's stamp where the link has one, else
            right after the receive.
        sent_ns: monotonic clock right after the last `send_drive`.
    """

    __slots__ = ("_inbox", "_rows_kept", "link", "received_ns", "rx", "sent_ns", "tx")

    def __init__(self, link: Link) -> None:
        self.link = link
        self.rx = Receiver(link.format)
        self.tx = Transmitter(link.format)
        self.received_ns = 0
        self.sent_ns = 0
        self._inbox: deque[Received] = deque(maxlen=INBOX)
        self._rows_kept = False

    def send(self, message: Message, tick: int | None = None) -> None:
        """Send any message; `tick` goes into the header, by default the newest tick heard from the peer.

        Raises:
            LinkClosed: the peer hung up.
            ProtocolError: a value does not fit its field; nothing was sent.
        """
        self.link.send(self.tx.encode(message, self.rx.tick if tick is None else tick))

    def send_drive(self, ux: int, uy: int, effective_tick: int) -> None:
        """DRIVE_FORCE without detours: drive codes and the tick (any width) from which they act. Raises as
        `send`."""
        self.link.send(self.tx.encode_drive(ux, uy, effective_tick, self.rx.tick))
        self.sent_ns = time.monotonic_ns()

    def poll(self, timeout_s: float | None) -> list[Received]:
        """Messages that have arrived, in order, SENSE as whole blocks; waits up to `timeout_s` seconds (None:
        for ever) for bytes unless messages were kept from an earlier call. Bytes need not complete a message:
        the list may be empty before the time is up. Raises LinkClosed."""
        left = list(self._inbox)
        self._clear()
        return left + self.poll_new(0.0 if left else timeout_s)

    def poll_new(self, timeout_s: float | None) -> list[Received]:
        """Like `poll`, but leaves kept messages where they are: for one who waits for an answer."""
        return self.rx.feed(self._receive(timeout_s))

    def poll_frames(self, timeout_s: float | None) -> list[Frame]:
        """Like `poll`, but frames whose payload nobody has looked at, ticks unwrapped: for a peer of another
        version."""
        return self.rx.frames(self._receive(timeout_s))

    def keep(self, items: list[Received]) -> None:
        """Put messages back: the next `poll`, or `receive_rows` for samples, returns them before anything
        newer."""
        self._inbox.extend(items)
        self._rows_kept = self._rows_kept or any(isinstance(item.message, Sense) for item in items)

    def receive_rows(self, timeout_s: float | None) -> list[SenseRow]:
        """Samples that have arrived, one tuple (tick, vx, vy, ux, uy, flags) of plain integers per row; other
        messages are kept for `poll`. Waits up to `timeout_s` seconds (None: for ever) for bytes; the list may
        be empty before the time is up. Raises LinkClosed."""
        if self._rows_kept:
            kept = list(self._inbox)
            self._clear()
            return self._rows(kept)
        data = self._receive(timeout_s)
        row = self.rx.take_row(data)
        if row is not None:
            return [row]
        return self._rows(self.rx.feed(data))

    def _rows(self, items: list[Received]) -> list[SenseRow]:
        """The samples among `items`; what else there is goes to the inbox."""
        rows: list[SenseRow] = []
        for item in items:
            message = item.message
            if isinstance(message, Sense):
                flags = message.flags
                rows += [(tick, *codes, flags) for tick, codes in enumerate(message.codes.tolist(), item.tick)]
            else:
                self._inbox.append(item)
        return rows

    def restart(self) -> None:
        """Forget where the peer was in its sequence and ticks, and everything unread; counters stay."""
        self.rx.restart()
        self._clear()

    def close(self) -> None:
        """Close the link."""
        self.link.close()

    def _clear(self) -> None:
        self._inbox.clear()
        self._rows_kept = False

    def _receive(self, timeout_s: float | None) -> bytes:
        data = self.link.receive(timeout_s)
        if data:
            self.received_ns = self.link.arrived_ns or time.monotonic_ns()
        return data
