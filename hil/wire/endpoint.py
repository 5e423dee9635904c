"""One end of a link that speaks messages."""

import time
from collections import Counter, deque
from typing import NamedTuple

from hil.wire.frame_format import Frame
from hil.wire.link import Link
from hil.wire.messages import DriveForce, Message, Nack, RegisterValue, TimeSync
from hil.wire.sense import Sense, SenseRow
from hil.wire.stream import Received, Receiver, Transmitter

INBOX = 1024
"""Messages kept for a later call; beyond that the oldest are forgotten."""


_EXCHANGES = 64  # answers to TIME_SYNC that nobody has taken yet
_ANSWERS = 64  # of registers, likewise


class Exchange(NamedTuple):
    """TIME_SYNC there and back: host clock when asked, board clock when answered, host clock at the arrival (ns), and
    the board's tick in the answer (64 bits)."""

    sent_ns: int
    board_ns: int
    received_ns: int
    tick: int


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
        refusals: how often each (type, reason) was refused by NACK, of frames that were sent.
        unsent: NACKs of frames that were not: no such type has had that number.
        forgotten: SENSE blocks that were kept for later and found no room.
        exchanges: answers to `ask_time` with their times, for the caller to take out; the oldest are forgotten.
        answers: REGISTER_VALUE and NACK with their ticks, likewise.
        rows_kept: whether samples were kept, which `receive_rows` would return at once.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self.rx = Receiver(link.format)
        self.tx = Transmitter(link.format)
        self.received_ns = 0
        self.sent_ns = 0
        self.exchanges: deque[Exchange] = deque(maxlen=_EXCHANGES)
        self.refusals: Counter[tuple[int, int]] = Counter()
        self.unsent = 0
        self.forgotten = 0
        self.answers: deque[Received] = deque(maxlen=_ANSWERS)
        self._inbox: deque[Received] = deque(maxlen=INBOX)
        self.rows_kept = False

    def send(self, message: Message, tick: int | None = None) -> None:
        """Send any message; `tick` goes into the header, by default the newest tick heard from the peer.

        Raises:
            LinkClosed: the peer hung up.
            ProtocolError: a value does not fit its field; nothing was sent.
        """
        self.link.send(self.tx.encode(message, self.rx.tick if tick is None else tick))

    def send_drive(self, ux: int, uy: int, effective_tick: int) -> None:
        """DRIVE_FORCE: drive codes and the tick (any width) from which they act. Raises as `send`."""
        self.send(DriveForce(ux, uy, effective_tick))
        self.sent_ns = time.monotonic_ns()

    def ask_time(self) -> int:
        """Send TIME_SYNC and do not wait; returns the host's time in it, by which its answer is known in `exchanges`.
        Raises as `send`."""
        now_ns = time.monotonic_ns()
        self.send(TimeSync(now_ns, 0))
        return now_ns

    def poll(self, timeout_s: float | None) -> list[Received]:
        """Messages that have arrived, in order, SENSE as whole blocks; waits up to `timeout_s` seconds (None:
        for ever) for bytes unless messages were kept from an earlier call. Bytes need not complete a message:
        the list may be empty before the time is up. Raises LinkClosed."""
        left = list(self._inbox)
        self._clear()
        return left + self.poll_new(0.0 if left else timeout_s)

    def poll_new(self, timeout_s: float | None) -> list[Received]:
        """Like `poll`, but leaves kept messages where they are: for one who waits for an answer."""
        return self._noted(self.rx.feed(self._receive(timeout_s)))

    def poll_frames(self, timeout_s: float | None) -> list[Frame]:
        """Like `poll`, but frames whose payload nobody has looked at, ticks unwrapped: for a peer of another
        version."""
        return self.rx.frames(self._receive(timeout_s))

    def keep(self, items: list[Received]) -> None:
        """Put messages back: the next `poll`, or `receive_rows` for samples, returns them before anything
        newer."""
        for item in self._inbox if len(self._inbox) + len(items) > INBOX else ():
            self.forgotten += isinstance(item.message, Sense)  # more than go, perhaps
        self._inbox.extend(items)
        self.rows_kept = self.rows_kept or any(isinstance(item.message, Sense) for item in items)

    def said(self) -> list[Message]:
        """What has come beside samples and was kept, taken out; nothing is received, samples stay."""
        if not self._inbox:
            return []
        items = list(self._inbox)
        self._clear()
        self.keep([item for item in items if isinstance(item.message, Sense)])
        return [item.message for item in items if not isinstance(item.message, Sense)]

    def blocks(self) -> list[Received]:
        """SENSE that was kept, taken out; nothing is received, other messages stay."""
        if not self.rows_kept:
            return []
        items = list(self._inbox)
        self._clear()
        self.keep([item for item in items if not isinstance(item.message, Sense)])
        return [item for item in items if isinstance(item.message, Sense)]

    def receive_rows(self, timeout_s: float | None) -> list[SenseRow]:
        """Samples that have arrived, one tuple (tick, vx, vy, ux, uy, flags) of plain integers per row; other
        messages are kept for `poll`. Waits up to `timeout_s` seconds (None: for ever) for bytes; the list may
        be empty before the time is up. Raises LinkClosed."""
        if self.rows_kept:
            kept = list(self._inbox)
            self._clear()
            return self._rows(kept)
        return self._rows(self._noted(self.rx.feed(self._receive(timeout_s))))

    def take_in(self, items: list[Received]) -> None:
        """Messages that somebody else has received and decoded: kept for `poll`, with what hangs off them."""
        self.keep(self._noted(items))

    def _noted(self, items: list[Received]) -> list[Received]:
        """The same messages; answers about the time are noted with theirs, refusals counted."""
        for item in items:
            message = item.message
            if isinstance(message, TimeSync):
                self.exchanges.append(Exchange(message.host_ns, message.board_ns, self.received_ns, item.tick))
            elif isinstance(message, Nack):
                if self.tx.types[message.of_seq] == message.of_type:
                    self.refusals[message.of_type, message.reason] += 1
                else:
                    self.unsent += 1
            if isinstance(message, RegisterValue | Nack):
                self.answers.append(item)
        return items

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
        self.link.close()

    def _clear(self) -> None:
        self._inbox.clear()
        self.rows_kept = False

    def _receive(self, timeout_s: float | None) -> bytes:
        data = self.link.receive(timeout_s)
        if data:
            self.received_ns = self.link.arrived_ns or time.monotonic_ns()
        return data
