"""The part of the wire's page that says how keyed datagrams look, with an example to compare an implementation with."""

from hil.wire.codec import type_of
from hil.wire.framing import encode_frame
from hil.wire.keyed import (
    CALL,
    CHALLENGE,
    FRAME,
    KEY_SIZE,
    LAST_COUNTER,
    NONCE_SIZE,
    OPEN,
    TAG_SIZE,
    KeyedBoard,
    KeyedHost,
    derived,
)
from hil.wire.messages import Hello, Nack, Safe
from hil.wire.session import PEER_S

_PAGE = """\
## UDP

A host sends to the group's address and port, from a port of its own; the board answers from the group's port to the
address and port that HELLO came from. One datagram holds one frame as on a serial line, delimiters included. HELLO
makes its sender the board's peer, unless another one is and has been heard within {peer_s:g} s; what others send is
dropped and counted. An empty datagram of the peer means that it leaves.

### Keyed datagrams

Off loopback ([why, and what it is worth](security.md)) all datagrams of both ends look like this; numbers are
little-endian:

| datagram | sender | bytes |
| --- | --- | --- |
| CALL | host | `{call:02x}`, host nonce ({nonce} bytes), tag |
| CHALLENGE | board | `{challenge:02x}`, host nonce, board nonce ({nonce} bytes), u8 busy, tag |
| OPEN | host | `{open:02x}`, host nonce, board nonce, HELLO as a frame, tag |
| FRAME | either | `{frame:02x}`, counter u64, one frame, or nothing when the host leaves, tag |

Busy is 1 if another host has the board, else 0. The tag is BLAKE2s (RFC 7693) of all that stands before it, {tag}
bytes long, keyed with the key of its purpose. These keys are BLAKE2s, {key} bytes long, keyed with the key file's
{key} bytes, of

| tag of | text |
| --- | --- |
| CALL | `call` |
| CHALLENGE | `challenge` |
| OPEN, and FRAME of the host | `host`, host nonce, board nonce |
| FRAME of the board | `board`, host nonce, board nonce |

Whenever the host says HELLO it sends CALL in its place, with a nonce of its own that it has never used before, and
goes on repeating that call until it is answered. The board answers every CALL whose tag is right, to where it came
from, with its present nonce, and remembers nothing. To a CHALLENGE with a right tag, its own nonce and no other host,
the host replies by OPEN, which brings the HELLO. The board takes an OPEN with its present nonce and a right tag,
unless another host has it. Then the session begins: it takes a new nonce, the sender is its peer, both counters are
0, and HELLO is answered by IDENTITY in the board's first FRAME. The session before, if there was one, is over.

Each end numbers its FRAMEs from 0, one by one, and takes one only if its counter is larger than those of all FRAMEs
it has taken in this session, its tag is right, and, at the board, it comes from the peer. 2⁶⁴ − 1 is the last. What
is not taken changes nothing and is not answered.

With the key {secret_first:02x} {secret_second:02x} … {secret_last:02x},
host nonce {host_first:02x} … {host_last:02x}, board nonce {board_first:02x} … {board_last:02x}:

| | hex |
| --- | --- |
{example}"""

SECRET = bytes(range(KEY_SIZE))
HOST_NONCE = bytes(range(0xA0, 0xA0 + NONCE_SIZE))
BOARD_NONCE = bytes(range(0xB0, 0xB0 + NONCE_SIZE))


def example() -> dict[str, bytes]:
    """Keys and datagrams of a short session, by what they are."""
    host, board = KeyedHost(SECRET, lambda: HOST_NONCE), KeyedBoard(SECRET, lambda: BOARD_NONCE)
    hello = encode_frame(type_of(Hello), 0, 0, bytes.fromhex("010002000000"))
    call = host.seal(hello) or b""
    challenge = board.heard(call, from_peer=False, taken=False).reply
    opening = host.heard(challenge).reply
    board.heard(opening, from_peer=False, taken=False)
    safe = host.seal(encode_frame(type_of(Safe), 1, 0, b"\1"))
    nack = board.seal(encode_frame(type_of(Nack), 0, 0, bytes.fromhex("02010003")))
    return {
        "key of CALL": derived(SECRET, b"call"),
        "key of CHALLENGE": derived(SECRET, b"challenge"),
        "key of the host": derived(SECRET, b"host", HOST_NONCE, BOARD_NONCE),
        "key of the board": derived(SECRET, b"board", HOST_NONCE, BOARD_NONCE),
        "CALL": call,
        "CHALLENGE": challenge,
        "OPEN with HELLO (protocol 1, spec hash 2)": opening,
        "FRAME 0 of the host, SAFE (HOST_REQUEST, sequence 1)": safe or b"",
        "FRAME 0 of the board, NACK (of type 2, sequence 1, reason 3)": nack or b"",
    }


def keyed_page() -> str:
    """The section as Markdown."""
    rows = "\n".join(f"| {what} | `{data.hex()}` |" for what, data in example().items())
    assert LAST_COUNTER == 2**64 - 1
    return _PAGE.format(
        peer_s=PEER_S,
        call=CALL,
        challenge=CHALLENGE,
        open=OPEN,
        frame=FRAME,
        nonce=NONCE_SIZE,
        tag=TAG_SIZE,
        key=KEY_SIZE,
        secret_first=SECRET[0],
        secret_second=SECRET[1],
        secret_last=SECRET[-1],
        host_first=HOST_NONCE[0],
        host_last=HOST_NONCE[-1],
        board_first=BOARD_NONCE[0],
        board_last=BOARD_NONCE[-1],
        example=rows,
    )
