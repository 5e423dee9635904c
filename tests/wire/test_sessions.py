"""docs/security.md, rules 4 to 14, on the two ends of a session without a socket: who is heard, and what changes by it.

The datagrams are what docs/wire.md (Keyed datagrams) says; a tag is made here by `hashlib` alone.
"""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from hil.wire import keyed
from hil.wire.keyed import (
    LEFT,
    OPEN,
    OPEN_HEAD,
    PEER_S,
    TAG_SIZE,
    Heard,
    Incoming,
    KeyedBoard,
    KeyedHost,
    Outgoing,
    Peer,
    PlainBoard,
    PlainHost,
    is_hello,
)
from hil.wire.messages import Arm, Hello, Message
from hil.wire.stream import Transmitter

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))


def framed(message: Message) -> bytes:
    return Transmitter().encode(message, 0)


HELLO, ARM = framed(Hello(3, 0xDEADBEEF)), framed(Arm())


def counted() -> Callable[[], bytes]:
    """Nonces that nobody has used before."""
    state = [0]

    def nonce() -> bytes:
        state[0] += 1
        return state[0].to_bytes(16, "little")

    return nonce


class Both:
    """A host and a board, in session once `begin` was called. Datagrams go by hand."""

    def __init__(self, host_key: bytes = KEY) -> None:
        self.host, self.board = KeyedHost(host_key, counted()), KeyedBoard(KEY, counted())

    def called(self) -> bytes:
        """CALL of a HELLO."""
        call = self.host.seal(HELLO)
        assert call is not None
        return call

    def challenge(self, call: bytes, *, taken: bool = False) -> bytes:
        return self.board.heard(call, from_peer=False, taken=taken).reply

    def begin(self) -> Heard:
        """What OPEN brings the board."""
        opening = self.host.heard(self.challenge(self.called())).reply
        return self.board.heard(opening, from_peer=False, taken=False)

    def to_board(self, datagram: bytes | None, *, from_peer: bool = True) -> Heard:
        assert datagram is not None
        return self.board.heard(datagram, from_peer=from_peer, taken=not from_peer)


def in_session() -> Both:
    both = Both()
    assert both.begin() == (HELLO, b"", True)
    return both


def tagged(key: bytes, body: bytes) -> bytes:
    return body + hashlib.blake2s(body, key=key, digest_size=16).digest()


def test_a_session_brings_the_hello_and_carries_both_ways() -> None:
    both = in_session()
    for frame in (ARM, b"\0second\0"):
        assert both.to_board(both.host.seal(frame)) == (frame, b"", False)
        assert both.host.heard(both.board.seal(frame) or b"") == (frame, b"", False)
    assert (both.board.refused, both.host.refused) == (0, 0)


def test_without_a_session_nothing_is_said() -> None:
    both = Both()
    assert both.host.seal(ARM) is None
    assert both.host.leave() is None
    assert both.board.seal(ARM) is None
    both.called()
    assert both.host.seal(ARM) is None  # a call is not a session


def test_another_key_opens_nothing_and_gets_no_answer() -> None:
    both = Both(OTHER_KEY)
    assert both.challenge(both.called()) == b""
    assert both.board.refused == 1


@pytest.mark.parametrize("direction", ["host", "board"])
def test_what_is_not_newer_does_nothing(direction: str) -> None:
    """Rule 10: a receiver takes what is larger than all it has taken."""
    both = in_session()
    send = both.host.seal if direction == "host" else both.board.seal
    hear = both.to_board if direction == "host" else (lambda datagram: both.host.heard(datagram))
    end = both.board if direction == "host" else both.host
    sent = [send(bytes([k + 1])) for k in range(4)]
    assert hear(sent[0]).frame == b"\1"
    assert hear(sent[2]).frame == b"\3"  # that one was lost is no reason not to take the next
    for old in (sent[0], sent[1], sent[2]):
        assert hear(old).frame is None
    assert end.refused == 3
    assert hear(sent[3]).frame == b"\4"


def test_what_is_dropped_is_counted_by_its_kind() -> None:
    sender, receiver = Outgoing(KEY), Incoming(KEY)
    first, second = sender.seal(b"a") or b"", sender.seal(b"b") or b""
    for number, forged in enumerate((b"", first[:24], b"\xc3" + first[1:], first[:-1] + b"x"), 1):
        assert receiver.open(forged) is None
        assert (receiver.forged, receiver.replayed) == (number, 0)
    assert receiver.open(second) == b"b"
    for number in (1, 2):
        assert receiver.open(first) is None
        assert (receiver.forged, receiver.replayed) == (4, number)


def test_an_empty_frame_is_a_frame() -> None:
    """It is what a host leaves with (rule 6): 25 bytes, and none less."""
    sender, receiver = Outgoing(KEY), Incoming(KEY)
    empty = sender.seal(b"") or b""
    assert len(empty) == 1 + 8 + 16
    assert receiver.open(empty) == b""


def test_what_is_not_taken_changes_nothing() -> None:
    """Rule 11: no counter, no session, no peer, no answer."""
    both = in_session()
    fresh = both.host.seal(ARM)
    assert fresh is not None
    far_ahead = bytearray(fresh)
    far_ahead[1:9] = (10**6).to_bytes(8, "little")
    attacks = [bytes(far_ahead), fresh[:-1], fresh + b"\0", ARM, HELLO, b"", b"\xc4", b"\xc3", b"\xc3" + bytes(64)]
    attacks += [bytes([*fresh[:k], fresh[k] ^ 1, *fresh[k + 1 :]]) for k in range(len(fresh))]
    for number, attack in enumerate(attacks, 1):
        assert both.to_board(attack) == (None, b"", False), attack
        assert both.board.refused == number
    assert both.to_board(fresh).frame == ARM


def test_the_host_believes_only_the_board() -> None:
    both = in_session()
    fresh = both.board.seal(ARM)
    assert fresh is not None
    own = both.host.seal(ARM)
    assert own is not None
    attacks = [own, ARM, b"", fresh[:-1], bytes([*fresh[:-1], fresh[-1] ^ 1]), both.board.seal(LEFT) or b""]
    for number, attack in enumerate(attacks, 1):  # rule 9: nothing can be sent back to where it came from
        assert both.host.heard(attack) == (None, b"", False)
        assert both.host.refused == number
    assert Both().host.heard(fresh) == (None, b"", False)


def test_what_comes_from_elsewhere_is_dropped_though_it_has_the_tag() -> None:
    both = in_session()
    fresh = both.host.seal(ARM)
    assert both.to_board(fresh, from_peer=False) == (None, b"", False)
    assert both.board.refused == 1
    assert both.to_board(fresh).frame == ARM


def test_nothing_of_a_session_is_worth_anything_in_the_next() -> None:
    both = in_session()
    old = [both.host.seal(ARM), both.board.seal(ARM)]
    assert both.begin().opened
    assert both.to_board(old[0]).frame is None
    assert both.host.heard(old[1] or b"").frame is None
    assert both.to_board(both.host.seal(ARM)).frame == ARM


def test_a_host_that_leaves_frees_the_board() -> None:
    both = in_session()
    left = both.host.leave()
    assert both.to_board(left) == (LEFT, b"", False)
    assert both.board.seal(ARM) is None
    assert both.to_board(left).frame is None
    assert both.to_board(both.host.seal(ARM)).frame is None


def test_an_open_works_once_and_not_while_another_has_the_board() -> None:
    """Rule 12: it keeps one nonce for the next session, which works once."""
    both = Both()
    opening = both.host.heard(both.challenge(both.called())).reply
    assert both.board.heard(opening, from_peer=False, taken=True) == (None, b"", False)
    assert both.board.heard(opening, from_peer=False, taken=False).opened
    for from_peer in (True, False):
        assert both.board.heard(opening, from_peer=from_peer, taken=False) == (None, b"", False)
    assert both.board.refused == 3


def test_calls_are_answered_and_cost_the_board_nothing() -> None:
    both = in_session()
    call = both.called()
    answers = {both.challenge(call), both.challenge(call)}
    assert len(answers) == 1
    assert b"" not in answers
    assert both.to_board(both.host.seal(ARM)).frame == ARM  # the session goes on
    for cut in (call[:-1], call + b"\0", b"\xc1"):
        assert both.challenge(cut) == b""


@pytest.mark.parametrize("more", [b"", b"\1", b"\1\2"])
def test_a_call_of_another_length_is_none(more: bytes) -> None:
    """Even from a holder of the key."""
    call_key = hashlib.blake2s(b"call", key=KEY).digest()
    board = KeyedBoard(KEY)
    body = b"\xc1" + bytes(16)
    assert board.heard(tagged(call_key, body), from_peer=False, taken=False).reply
    assert not board.heard(tagged(call_key, body[:-1] if not more else body + more), from_peer=False, taken=False).reply


def test_a_second_holder_of_the_key_waits_and_is_told() -> None:
    """Rule 14."""
    both = Both()
    busy = both.challenge(both.called(), taken=True)
    assert both.host.heard(busy) == (None, b"", False)
    assert both.host.busy
    free = both.challenge(both.called())
    assert both.host.heard(free).reply
    assert not both.host.busy


def test_a_call_that_is_repeated_is_the_same_call() -> None:
    """Until its CHALLENGE has come: an answer to either is one to it."""
    both = Both()
    first = both.called()
    assert both.called() == first
    assert both.host.heard(both.challenge(first)).reply
    assert both.called() != first


def test_a_challenge_that_nobody_asked_for_is_not_answered() -> None:
    both = Both()
    first = both.challenge(both.called())
    assert both.host.heard(first).reply
    assert both.host.heard(first) == (None, b"", False)  # it has had its answer
    both.called()
    assert both.host.heard(first) == (None, b"", False)  # of an earlier call
    assert both.host.refused == 2
    flipped = bytearray(both.challenge(both.called()))
    for place in range(len(flipped)):
        flipped[place] ^= 1
        assert both.host.heard(bytes(flipped)).reply == b""
        flipped[place] ^= 1
    challenge_key = hashlib.blake2s(b"challenge", key=KEY).digest()
    assert both.host.heard(tagged(challenge_key, bytes(flipped[:-17]))).reply == b""  # one byte less, well tagged
    assert both.host.heard(bytes(flipped)).reply


def test_a_hello_is_known_by_its_whole_frame() -> None:
    assert is_hello(HELLO)
    assert not is_hello(ARM)
    assert not is_hello(b"")
    for place in range(len(HELLO)):
        assert not is_hello(bytes([*HELLO[:place], HELLO[place] ^ 4, *HELLO[place + 1 :]]))


# ------------------------------------------------------------------------------------------------------ without a key


def test_without_a_key_hello_makes_the_peer_and_only_the_peer_is_heard() -> None:
    board = PlainBoard()
    assert board.heard(ARM, from_peer=False, taken=False) == (None, b"", False)
    assert board.heard(HELLO, from_peer=False, taken=True) == (None, b"", False)
    assert board.heard(ARM, from_peer=False, taken=True) == (None, b"", False)
    assert board.refused == 3
    assert board.heard(HELLO, from_peer=False, taken=False) == (HELLO, b"", True)
    assert board.heard(ARM, from_peer=True, taken=False) == (ARM, b"", False)
    assert board.heard(LEFT, from_peer=True, taken=False) == (LEFT, b"", False)
    assert board.seal(ARM) == ARM
    assert board.refused == 3


def test_without_a_key_the_host_takes_what_comes_from_the_boards_address() -> None:
    host = PlainHost()
    assert (host.seal(ARM), host.leave()) == (ARM, LEFT)
    assert host.heard(ARM) == (ARM, b"", False)
    assert host.heard(b"").frame is None
    assert (host.refused, host.busy) == (0, False)


def test_a_board_is_taken_until_its_host_leaves_or_is_silent_for_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rule 4."""
    now = [1000.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    peer, host, other = Peer(), ("127.0.0.1", 1), ("127.0.0.1", 2)
    assert PEER_S == 1.0
    assert not peer.taken(host)
    peer.heard(host)
    assert peer.taken(other)
    assert peer.taken(("127.0.0.2", 1))
    assert not peer.taken(host)
    now[0] += 0.9
    assert peer.taken(other)
    peer.heard(host)
    now[0] += 0.9
    assert peer.taken(other)
    now[0] += 0.11
    assert not peer.taken(other)
    peer.heard(other)
    assert peer.taken(host)
    peer.leave()
    assert not peer.taken(host)
    assert peer.address is None


def test_the_first_byte_of_each_keyed_datagram_is_that_of_the_page() -> None:
    """docs/wire.md, the table of datagrams: a board in another language has it from there, and not from here."""
    page = (Path(__file__).parents[2] / "docs" / "wire.md").read_text(encoding="utf-8")
    known = {"CALL": keyed.CALL, "CHALLENGE": keyed.CHALLENGE, "OPEN": keyed.OPEN, "FRAME": keyed.FRAME}
    for name, byte in known.items():
        row = next(line for line in page.splitlines() if line.startswith(f"| {name} |") and "`c" in line)
        assert int(row.split("`")[1][:2], 16) == byte


def test_an_opening_cut_short_anywhere_is_dropped_and_counted() -> None:
    """Nothing of it is read before it is known to be long enough (docs/security.md)."""
    board = KeyedBoard(KEY)
    for length in range(1, OPEN_HEAD.size + TAG_SIZE + 1):
        cut = bytes([OPEN]) + bytes(length - 1)
        assert board.heard(cut, from_peer=False, taken=False) == Heard(None)
        assert board.refused == length
