"""Keyed datagrams of a short session, for the page of the wire and for anyone's implementation."""

from hil.wire.codec import type_of
from hil.wire.framing import encode_frame
from hil.wire.keyed import KEY_SIZE, NONCE_SIZE, KeyedBoard, KeyedHost, derived
from hil.wire.messages import Hello, Nack, Safe

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
