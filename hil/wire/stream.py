"""Both directions of a conversation without a link: sequence numbers and ticks in, bytes out, and back again.

A board that answers `exchange(data) -> bytes` uses these two directly; `hil.wire.endpoint` adds a link.
"""

from collections.abc import Iterator
from typing import NamedTuple

from hil.wire.codec import KNOWN_TYPES, pack, type_of, unpack
from hil.wire.errors import ProtocolError
from hil.wire.frame_format import Frame, FrameFormat
from hil.wire.messages import Hello, Identity, Message, Nack, NackReason, Safe, SafeReason
from hil.wire.serial_format import SERIAL
from hil.wire.spec import SPEC

_RESTARTS = frozenset((type_of(Hello), type_of(Identity)))

REPEAT_WINDOW = 256
"""A sequence number up to this far behind the expected one is a repetition and dropped; further behind, it is
taken for a jump ahead, so that a peer that started afresh is never ignored for long."""

REPEAT_RUN = 4
"""So many frames in a row that look like repetitions, each following the one before, are none: the number ahead of them
was a stray one, and the count goes on from theirs."""

_SAFE = type_of(Safe)
_SAFE_SIZE = 1
_SAFE_OTHERWISE = bytes([SafeReason.HOST_REQUEST])


class Received(NamedTuple):
    """A message with its header: `tick` unwrapped to 64 bits, `seq` as sent (for NACK)."""

    tick: int
    seq: int
    message: Message


def unwrap(low: int, near: int) -> int:
    """The 64-bit tick closest to `near` whose low 32 bits are `low`; never negative for `near` ≥ 0.

    Takes header ticks as well as `effective_tick` and `Status.tick` back to full width.
    """
    tick = near + ((low - near + 0x80000000) & 0xFFFFFFFF) - 0x80000000
    return tick if tick >= 0 else low


class Transmitter:
    """Makes frames of messages, numbering them.

    Attributes:
        seq: sequence number of the next frame.
        types: of the last frame of each number, 0 where there was none: what a NACK may be about.
    """

    def __init__(self, form: FrameFormat = SERIAL) -> None:
        self._format = form
        self.seq = 0
        self.types = bytearray(1 << 16)

    def encode(self, message: Message, tick: int) -> bytes:
        """Frame of any message; `tick` (any width) goes into the header.

        Raises:
            ProtocolError: a value does not fit its field; no sequence number is spent.
        """
        type_ = type_of(message)
        data, spent = self._format.encode(type_, self.seq, tick, pack(message))
        if type_ != _SAFE:  # which leaves its number to the next one
            self.types[self.seq] = type_
            self.seq = (self.seq + spent) & 0xFFFF
        return data


class Receiver:
    """Takes bytes, gives messages; follows sequence numbers and ticks. Types in `foreign` are refused unread: what only
    the other end says. Optional ones that are foreign or unknown are passed over without a refusal. SAFE stands outside
    of all this: whatever its number, tick and length, it is given on.

    Attributes:
        decoder: the frame decoder with its counters.
        tick: header tick of the last frame, unwrapped to 64 bits; 0 before the first.
        lost: frames missing from the peer's sequence.
        repeated: frames dropped because their number had passed.
        undecodable: intact frames of unknown type or wrong length, dropped.
        expected: the sequence number of the next frame, None before the first.
        run: frames that look repeated, one after the other, and `run_next` the number that would continue them.
        passed_over: optional messages that this end does not know, or does not take.
        refused: the NACK for each undecodable or foreign frame of the last `feed`, for a board to send.
    """

    def __init__(self, form: FrameFormat = SERIAL, foreign: frozenset[int] = frozenset()) -> None:
        self.decoder = form.decoder()
        self._foreign = foreign
        self.tick = 0
        self.lost = 0
        self.repeated = 0
        self.undecodable = 0
        self.passed_over = 0
        self.refused: list[Nack] = []
        self.expected: int | None = None
        self.run = 0
        self.run_next = 0

    @property
    def bad(self) -> int:
        """Everything dropped as unreadable: broken frames and undecodable ones."""
        return self.decoder.bad + self.undecodable

    def restart(self) -> None:
        """Forget where the peer was: the next frame sets sequence and tick anew. Counters stay."""
        self.expected = None
        self.tick = 0

    def feed(self, data: bytes) -> list[Received]:
        """Messages that `data` completes, in order."""
        received = []
        self.refused = []
        for frame, before in self._followed(data):
            if SPEC.is_optional(frame.type) and (frame.type in self._foreign or frame.type not in KNOWN_TYPES):
                self.tick = before
                self.passed_over += 1
                continue
            if frame.type in self._foreign:
                self.refused.append(Nack(frame.type, frame.seq, NackReason.NOT_SUPPORTED))
                continue
            try:
                message = unpack(frame.type, frame.payload)
            except ProtocolError:
                self.tick = before  # of what is not understood, the tick is not believed either
                self.undecodable += 1
                reason = NackReason.BAD_LENGTH if frame.type in KNOWN_TYPES else NackReason.UNKNOWN_TYPE
                self.refused.append(Nack(frame.type, frame.seq, reason))
            else:
                received.append(Received(frame.tick, frame.seq, message))
        return received

    def frames(self, data: bytes) -> list[Frame]:
        """Frames that `data` completes, repeated ones left out, their ticks unwrapped to 64 bits."""
        return [frame for frame, _ in self._followed(data)]

    def _followed(self, data: bytes) -> Iterator[tuple[Frame, int]]:
        """Each frame of `frames`, with what `tick` was before it."""
        for frame in self.decoder.feed(data):
            before = self.tick
            if frame.type == _SAFE:
                payload = frame.payload if len(frame.payload) == _SAFE_SIZE else _SAFE_OTHERWISE
                yield Frame(_SAFE, max(frame.seq, 0), before, payload), before
                continue
            if frame.type in _RESTARTS:
                self.expected = None
            if self._follows(frame.seq):
                self.tick = unwrap(frame.tick, before)
                yield frame._replace(tick=self.tick), before

    def _follows(self, seq: int) -> bool:
        """Account for a sequence number; False if the frame has been here before."""
        if self.expected is not None and seq != self.expected:
            behind = (self.expected - seq) & 0xFFFF
            if behind > REPEAT_WINDOW:
                self.lost += (seq - self.expected) & 0xFFFF
            elif not self._moves_back(seq):
                self.repeated += 1
                return False
        self.expected = (seq + 1) & 0xFFFF
        self.run = 0
        return True

    def _moves_back(self, seq: int) -> bool:
        """Whether a frame that looks repeated is the last of a run that shows where the peer really is."""
        self.run = self.run + 1 if self.run and seq == self.run_next else 1
        self.run_next = (seq + 1) & 0xFFFF
        return self.run >= REPEAT_RUN
