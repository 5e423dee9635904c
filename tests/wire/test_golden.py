"""Golden vectors: current, complete, readable in both directions, and right by an independent reading."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from hil.wire import messages
from hil.wire.codec import pack, type_of, unpack
from hil.wire.frame_format import Frame
from hil.wire.framing import Decoder, encode_frame
from hil.wire.sense import Sense
from hil.wire.spec import SPEC

from .reference import crc32c, open_frame

PATH = Path(__file__).with_name("golden.json")
VECTORS = json.loads(PATH.read_text(encoding="utf-8"))
frames = pytest.mark.parametrize("vector", VECTORS["frames"], ids=lambda vector: vector["name"])
SIZES = {"u8": 1, "u16": 2, "u32": 4, "u64": 8, "i32": 4, "f32": 4, "f64": 8}


def message_of(vector):
    if vector["message"] == "SENSE":
        return Sense(**vector["fields"] | {"codes": np.array(vector["fields"]["codes"], np.int32)})
    cls = getattr(messages, "".join(word.capitalize() for word in vector["message"].split("_")))
    fields = {name: tuple(v) if isinstance(v, list) else v for name, v in vector["fields"].items()}
    return cls(**fields)


def test_every_message_has_a_vector():
    assert {vector["message"] for vector in VECTORS["frames"]} == SPEC.messages.keys()


def test_crc_check_value():
    check = VECTORS["crc32c"]
    assert check == {"input": b"123456789".hex(), "value": "0xe3069283"}
    assert crc32c(bytes.fromhex(check["input"])) == 0xE3069283


@frames
def test_fields_to_bytes(vector):
    message = message_of(vector)
    assert pack(message).hex() == vector["payload"]
    assert encode_frame(type_of(message), vector["seq"], vector["tick"], pack(message)).hex() == vector["frame"]


@frames
def test_bytes_to_fields(vector):
    (frame,) = Decoder().feed(bytes.fromhex(vector["frame"]))
    type_ = SPEC.messages[vector["message"]].type
    assert frame == Frame(type_, vector["seq"], vector["tick"], bytes.fromhex(vector["payload"]))
    found, expected = unpack(type_, frame.payload)._asdict(), message_of(vector)._asdict()
    assert all(np.array_equal(found.pop(name), value) for name, value in expected.items())
    assert found == {}


@frames
def test_frames_by_an_independent_reading(vector):
    """Own COBS, own CRC, and the field sizes of the spec added up by hand."""
    body = open_frame(bytes.fromhex(vector["frame"]))
    layout = SPEC.messages[vector["message"]]
    assert struct.unpack_from("<BHI", body) == (layout.type, vector["seq"], vector["tick"])
    assert body[7:].hex() == vector["payload"]
    size = sum(SIZES[f.type.partition("[")[0]] * f.count for f in layout.fields if f.type != "text")
    if vector["message"] == "SENSE":
        size += 4 * len(vector["fields"]["codes"]) * vector["fields"]["width"]
    size += sum(len(vector["fields"][f.name].encode()) for f in layout.fields if f.type == "text")
    assert len(body) == 7 + size


@pytest.mark.parametrize("vector", VECTORS["rejected"], ids=lambda vector: vector["name"])
def test_broken_frames_are_counted_where_they_belong(vector):
    decoder = Decoder()
    assert decoder.feed(bytes.fromhex(vector["stream"])) == []
    assert getattr(decoder, vector["counter"]) == decoder.bad == 1
