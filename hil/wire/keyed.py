"""Keyed datagrams: host and board prove to each other that they hold the same key, frame by frame.

A session begins with CALL and CHALLENGE, in which both contribute a nonce nobody has used before, and OPEN, which
brings the host's HELLO. Every later frame travels in a FRAME with a counter that only grows. The tag at the end of each
is a keyed BLAKE2s (RFC 7693) over everything before it. docs/security.md says what that is worth, docs/wire.md how it
looks in bytes. No socket in here: datagrams in, datagrams out.

Who a UDP link listens to: one peer per session. A session begins with the host's HELLO.

On loopback without a key the peer is an address, which no other program of the machine can have; with a key
(`hil.wire.keyed`) it is the holder of the key.
"""

import secrets
import struct
import time
from collections.abc import Callable
from hashlib import blake2s
from hmac import compare_digest
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
        return self.address not in (None, source) and time.monotonic() < self._heard_s + PEER_S

    def heard(self, source: Address) -> None:
        """The peer, from now on if it was not before, has said something."""
        self.address = source
        self._heard_s = time.monotonic()

    def leave(self) -> None:
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
        return frame

    def leave(self) -> bytes:
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
        return frame

    def heard(self, datagram: bytes, *, from_peer: bool, taken: bool) -> Heard:
        """What a datagram brings; arguments as `KeyedBoard.heard`."""
        if from_peer:
            return Heard(datagram)
        if taken or not is_hello(datagram):
            self.refused += 1
            return Heard(None)
        return Heard(datagram, opened=True)


KEY_SIZE = 32
NONCE_SIZE = 16
TAG_SIZE = 16

CALL, CHALLENGE, OPEN, FRAME = 0xC1, 0xC2, 0xC3, 0xC4
"""First byte of a datagram. A frame without a key begins with 0."""

CALL_BODY = struct.Struct(f"<B{NONCE_SIZE}s")
CHALLENGE_BODY = struct.Struct(f"<B{NONCE_SIZE}s{NONCE_SIZE}sB")
OPEN_HEAD = struct.Struct(f"<B{NONCE_SIZE}s{NONCE_SIZE}s")
FRAME_HEAD = struct.Struct("<BQ")

LAST_COUNTER = 2**64 - 1
"""A session ends with the frame that bears it; a million frames a second get there in 584,000 years."""

_SMALLEST_FRAME = FRAME_HEAD.size + TAG_SIZE


def derived(key: bytes, label: bytes, *nonces: bytes) -> bytes:
    """The key for one purpose: BLAKE2s-256 of label and nonces, keyed with the key file's key."""
    return blake2s(label + b"".join(nonces), key=key).digest()


def tag(key: bytes, body: bytes) -> bytes:
    """BLAKE2s-128 of the body."""
    return blake2s(body, key=key, digest_size=TAG_SIZE).digest()


def tagged(key: bytes, datagram: bytes) -> bytes | None:
    """What stands before the tag, or None if the tag is another. The comparison takes the same time wherever they
    differ."""
    body = datagram[:-TAG_SIZE]
    return body if compare_digest(tag(key, body), datagram[-TAG_SIZE:]) else None


class _Keyed:
    """What both ends have of the key, and the session there is.

    Attributes:
        refused: datagrams dropped: forged, replayed, cut short, of another session, or asked for by nobody.
    """

    def __init__(self, key: bytes, nonce: Callable[[], bytes] = lambda: secrets.token_bytes(NONCE_SIZE)) -> None:
        self._key = key
        self._call_key = derived(key, b"call")
        self._challenge_key = derived(key, b"challenge")
        self._new_nonce = nonce
        self._out: Outgoing | None = None
        self._in: Incoming | None = None
        self.refused = 0


class Outgoing:
    """One direction of a session, at its sender. `counter` is that of the next frame."""

    def __init__(self, key: bytes) -> None:
        self._state = blake2s(key=key, digest_size=TAG_SIZE)  # has the key's block behind it already
        self.counter = 0

    def seal(self, frame: bytes) -> bytes | None:
        """The datagram for a frame; None once no counter is left."""
        if self.counter > LAST_COUNTER:
            return None
        body = FRAME_HEAD.pack(FRAME, self.counter) + frame
        self.counter += 1
        state = self._state.copy()
        state.update(body)
        return body + state.digest()


class Incoming:
    """One direction of a session, at its receiver.

    Attributes:
        least: the smallest counter that is taken: one more than the last one.
        forged: datagrams whose tag was another, or that were cut short.
        replayed: datagrams whose counter was not newer.
    """

    def __init__(self, key: bytes) -> None:
        self._state = blake2s(key=key, digest_size=TAG_SIZE)
        self.least = 0
        self.forged = 0
        self.replayed = 0

    def open(self, datagram: bytes) -> bytes | None:
        """The frame in a datagram; None if it is not from the holder of the key, or not newer than the last one."""
        if len(datagram) < _SMALLEST_FRAME or datagram[0] != FRAME:
            self.forged += 1
            return None
        _, counter = FRAME_HEAD.unpack_from(datagram)
        if counter < self.least:
            self.replayed += 1
            return None
        state = self._state.copy()
        state.update(datagram[:-TAG_SIZE])
        if not compare_digest(state.digest(), datagram[-TAG_SIZE:]):
            self.forged += 1
            return None
        self.least = counter + 1
        return datagram[FRAME_HEAD.size : -TAG_SIZE]


class KeyedHost(_Keyed):
    """The host's end. Every HELLO begins a session anew: it is held back until the board's CHALLENGE has come.

    Attributes:
        busy: the board said, with its tag, that another host has it.
    """

    busy = False
    _nonce = _hello = b""

    def seal(self, frame: bytes) -> bytes | None:
        """The datagram for a frame, for HELLO a CALL; None while there is no session."""
        if is_hello(frame):
            if not self._hello:
                self._nonce = self._new_nonce()
            self._hello = frame
            body = CALL_BODY.pack(CALL, self._nonce)
            return body + tag(self._call_key, body)
        return None if self._out is None else self._out.seal(frame)

    def leave(self) -> bytes | None:
        """The datagram that ends the session, None where there is none."""
        return None if self._out is None else self._out.seal(LEFT)

    def heard(self, datagram: bytes) -> Heard:
        """What a datagram brings: a frame of the board, or a reply to send."""
        if datagram[:1] == bytes((CHALLENGE,)):
            return Heard(None, self._challenged(datagram))
        frame = None if self._in is None else self._in.open(datagram)
        if not frame:
            self.refused += 1
            return Heard(None)
        return Heard(frame)

    def _challenged(self, datagram: bytes) -> bytes:
        body = tagged(self._challenge_key, datagram)
        if body is None or len(body) != CHALLENGE_BODY.size or not self._hello:
            self.refused += 1
            return b""
        _, nonce, board_nonce, busy = CHALLENGE_BODY.unpack(body)
        if nonce != self._nonce:
            self.refused += 1
            return b""
        self.busy = bool(busy)
        if self.busy:
            return b""
        key = derived(self._key, b"host", nonce, board_nonce)
        self._out = Outgoing(key)
        self._in = Incoming(derived(self._key, b"board", nonce, board_nonce))
        opening = OPEN_HEAD.pack(OPEN, nonce, board_nonce) + self._hello
        self._hello = b""  # and with it the nonce: the next call has one of its own
        return opening + tag(key, opening)


class KeyedBoard(_Keyed):
    """The board's end. Before a session begins it keeps one nonce only, so that calls cost it no memory."""

    def __init__(self, key: bytes, nonce: Callable[[], bytes] = lambda: secrets.token_bytes(NONCE_SIZE)) -> None:
        super().__init__(key, nonce)
        self._nonce = nonce()

    def seal(self, frame: bytes) -> bytes | None:
        """The datagram for a frame; None while there is no session."""
        return None if self._out is None else self._out.seal(frame)

    def heard(self, datagram: bytes, *, from_peer: bool, taken: bool) -> Heard:
        """What a datagram brings: a frame of the host, a reply to its sender, or a new session.

        `from_peer`: it came from the address of the session. `taken`: from another one while that session lives.
        """
        kind = datagram[0] if datagram else 0
        if kind == CALL:
            return self._called(datagram, taken)
        if kind == OPEN and not taken:
            return self._opened(datagram)
        if self._in is not None and from_peer:
            frame = self._in.open(datagram)
            if frame is not None:
                if not frame:
                    self._out = self._in = None
                return Heard(frame)
        self.refused += 1
        return Heard(None)

    def _called(self, datagram: bytes, taken: bool) -> Heard:
        body = tagged(self._call_key, datagram)
        if body is None or len(body) != CALL_BODY.size:
            self.refused += 1
            return Heard(None)
        answer = CHALLENGE_BODY.pack(CHALLENGE, body[1:], self._nonce, taken)
        return Heard(None, answer + tag(self._challenge_key, answer))

    def _opened(self, datagram: bytes) -> Heard:
        if len(datagram) > OPEN_HEAD.size + TAG_SIZE:
            _, host_nonce, nonce = OPEN_HEAD.unpack_from(datagram)
            if nonce == self._nonce:
                key = derived(self._key, b"host", host_nonce, nonce)
                body = tagged(key, datagram)
                if body is not None:
                    self._in = Incoming(key)
                    self._out = Outgoing(derived(self._key, b"board", host_nonce, nonce))
                    self._nonce = self._new_nonce()  # an OPEN works once
                    return Heard(body[OPEN_HEAD.size :], opened=True)
        self.refused += 1
        return Heard(None)
