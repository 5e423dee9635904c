"""Golden vectors: frames as hex, for this project's tests and for any other implementation of the wire."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from cobs import cobs
from crc32c import crc32c

from hil.wire.can_format import FDF, HEAD, RECORD_SIZE, CanFormat
from hil.wire.codec import field_value, pack, type_of
from hil.wire.frame_format import BOARD, HOST
from hil.wire.framing import encode_frame
from hil.wire.messages import (
    Arm,
    DriveBoard,
    DriveForce,
    DriveGains,
    Estimate,
    EstimateFlags,
    FieldRead,
    FieldValue,
    Hello,
    Identity,
    Message,
    Nack,
    NackReason,
    RegisterRead,
    RegisterValue,
    RegisterWrite,
    Safe,
    SafeReason,
    State,
    Status,
    TimeSync,
    TrimOutput,
    TrimRead,
)
from hil.wire.sense import Sense
from hil.wire.spec import SPEC

CRC_CHECK_INPUT = b"123456789"
"""The customary input of CRC check values; CRC-32C gives 0xE3069283."""


def _messages() -> Iterator[tuple[str, int, int, Message]]:
    """(what is special, seq, tick, message): every message once, and the corners of those in the loop."""
    most = 2**32 - 1
    yield "", 0, 0, Hello(SPEC.protocol, SPEC.hash)
    yield "", 0, 0, Identity(
        SPEC.protocol, SPEC.hash, 0x0123456789ABCDEF, 0x010203, 4000.0, 2, 16, 16, 2.0**-15, 2.0**-14, 1, 0xD
    )  # fmt: skip
    yield "", 1, 0, RegisterRead(3)
    yield "", 2, 0, RegisterWrite(4, 80.0)
    yield "", 1, 0, RegisterValue(4, 80.0)
    yield "", 3, 0, FieldRead(0)
    yield "", 2, 0, field_value(0)
    yield "a payload that fills a CAN FD frame, so that an empty one follows", 2, 0, FieldValue(1, 200, "x" * 52)
    yield "", 4, 0, TimeSync(1_000_000_007, 0)
    yield "", 5, 0, Arm()
    yield "", 3, 0, Status(State.ARMED, SafeReason.NONE, 0, 0, 0, 0, 0, 0, 0, 0)
    yield "one 16-bit row", 4, 0, Sense(np.array([[1000, -2000, 0, 0]], np.int32), 2, 0)
    yield "one 24-bit row", 5, 1, Sense(np.array([[2**23 - 1, -(2**23), -1, 1]], np.int32), 3, 2)
    yield "eight 16-bit rows, one more than a CAN FD frame holds", 6, 2, Sense(
        np.arange(-16, 16, dtype=np.int32).reshape(8, 4), 2, 1
    )  # fmt: skip
    yield "three 16-bit rows, sequence and tick about to wrap", 0xFFFF, most, Sense(
        np.array([[0, 0, 0, 0], [32767, -32768, -1, 1], [257, 256, 255, 254]], np.int32), 2, 7, 255
    )  # fmt: skip
    yield "", 6, 0, DriveForce(12, -34, 1)
    yield "extremes", 0xFFFF, most, DriveForce(2**31 - 1, -(2**31), most)
    yield "", 7, 9, DriveGains(1, (1.0, -0.5, 0.25, 0.0, -1.0, 0.5, -0.25, 2.0), (3.0, -4.0), 10)
    yield "", 8, 100, Nack(type_of(DriveGains), 7, NackReason.NOT_SUPPORTED)
    yield "", 8, 100, Safe(SafeReason.INTERRUPTED)
    yield "", 9, 100, DriveBoard(1)
    numbers = (1e-4, -0.125, 2.5e-5, 0.25, 0.006, -0.004, 1.0, 1.602e6, 1.561e6, -1.2e4, 1.5, 1.25, 0.0625, 7.5)
    deviations = [2.0**-k for k in range(3, 17)]
    driving = EstimateFlags.VALID | EstimateFlags.DRIVING
    yield "", 10, 7, Estimate._make((7, 0x3FFF, driving, *numbers, *deviations))
    yield "", 11, 7, TrimRead(2)
    yield "", 11, 7, TrimOutput(2, 3, -2048, 2047, 2.0**-8, 0.0625, "quadrature +")
    yield "counters at their end", 9, most, Status(4, 4, most, most, most, most, most, most, most, most)


def _rejected() -> Iterator[tuple[str, str, bytes]]:
    """(defect, counter that tells, bytes between delimiters)."""
    good = encode_frame(type_of(DriveForce), 1, 2, pack(DriveForce(5, 6, 7)))[1:-1]
    place = good.index(5)  # the first byte of the payload, which COBS leaves as it is
    yield "one bit flipped", "crc_errors", good[:place] + bytes([good[place] ^ 0x10]) + good[place + 1 :]
    yield "last byte missing", "cobs_errors", good[:-1]
    yield "code byte points beyond the end", "cobs_errors", b"\x0b\x01\x02\x03"
    yield "less than a header and a checksum", "short", cobs.encode(good[:4])


def _fields(message: Message) -> dict[str, Any]:
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in message._asdict().items()
    }


def _on_can(sender: str, type_: int, seq: int, tick: int, payload: bytes) -> list[dict[str, Any]]:
    """The CAN frames of a message to or from node 0; the host's where either may send it."""
    data, _ = CanFormat(0, BOARD if sender == "board" else HOST).encode(type_, seq, tick, payload)
    frames = []
    for at in range(0, len(data), RECORD_SIZE):
        identifier, length, flags = HEAD.unpack_from(data, at)
        body = data[at + HEAD.size : at + HEAD.size + length]
        frames.append({"id": f"0x{identifier:03x}", "fd": bool(flags & FDF), "data": body.hex()})
    return frames


def vectors() -> dict[str, Any]:
    """All vectors as plain JSON data; bytes are hex, delimiters of frames included."""
    frames = []
    for note, seq, tick, message in _messages():
        name = SPEC.message_name(type_of(message))
        payload = pack(message)
        frames.append(
            {
                "name": f"{name}: {note}" if note else name,
                "message": name,
                "seq": seq,
                "tick": tick,
                "fields": _fields(message),
                "payload": payload.hex(),
                "frame": encode_frame(type_of(message), seq, tick, payload).hex(),
                "can": _on_can(SPEC.messages[name].sender, type_of(message), seq, tick, payload),
            }
        )
    return {
        "protocol": SPEC.protocol,
        "spec_hash": f"0x{SPEC.hash:08x}",
        "crc32c": {"input": CRC_CHECK_INPUT.hex(), "value": f"0x{crc32c(CRC_CHECK_INPUT):08x}"},
        "frames": frames,
        "rejected": [
            {"name": name, "counter": counter, "stream": (b"\0" + run + b"\0").hex()}
            for name, counter, run in _rejected()
        ],
    }


def render() -> str:
    """The file's text."""
    return json.dumps(vectors(), indent=1) + "\n"
