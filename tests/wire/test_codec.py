"""Messages: packed and back, and everything that does not fit refused."""

import runpy
import struct
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.wire import messages, spec
from hil.wire.codec import KNOWN_TYPES, check_against, field_value, pack, type_of, unpack
from hil.wire.errors import ProtocolError
from hil.wire.messages import DriveForce, DriveGains, FieldValue, RegisterValue, Safe, Status, version_of
from hil.wire.sense import Sense
from hil.wire.spec import SPEC, parse_spec

from .test_spec import TEXT

untimed = settings(deadline=None)
RANGES = {
    "u8": st.integers(0, 2**8 - 1),
    "u16": st.integers(0, 2**16 - 1),
    "u32": st.integers(0, 2**32 - 1),
    "u64": st.integers(0, 2**64 - 1),
    "i32": st.integers(-(2**31), 2**31 - 1),
    "f32": st.floats(width=32, allow_nan=False),
    "f64": st.floats(allow_nan=False),
    "text": st.text(st.characters(codec="utf-8"), max_size=40),
}
CLASSES = {
    name: getattr(messages, "".join(word.capitalize() for word in name.split("_")))
    for name in SPEC.messages
    if name != "SENSE"
}


def values(field):
    numbers = RANGES[field.type.partition("[")[0]]
    return numbers if field.count == 1 else st.tuples(*[numbers] * field.count)


plain_messages = st.one_of(
    [st.builds(cls, *[values(field) for field in SPEC.messages[name].fields]) for name, cls in CLASSES.items()]
)


@pytest.mark.moderate
@untimed
@given(plain_messages)
def test_messages_come_back(message):
    payload = pack(message)
    back = unpack(type_of(message), payload)
    assert back == message
    assert type(back) is type(message)
    layout = SPEC.messages[SPEC.message_name(type_of(message))]
    assert len(payload) == layout.size or layout.open_ended


def test_every_message_of_the_spec_has_a_class_and_a_type():
    assert {message.type for message in SPEC.messages.values()} == KNOWN_TYPES
    assert {type_of(cls) for cls in CLASSES.values()} | {type_of(Sense)} == KNOWN_TYPES


@pytest.mark.moderate
@untimed
@given(st.integers(0, 255), st.binary(max_size=80))
def test_any_payload_is_a_message_or_a_protocol_error(type_, payload):
    try:
        found = type_of(unpack(type_, payload))
    except ProtocolError as error:
        found = str(error)
    assert (
        found == type_ or ("\n" not in found and "payload" in found) or found == f"unknown message type 0x{type_:02x}"
    )


@pytest.mark.parametrize("name", [name for name, layout in SPEC.messages.items() if not layout.open_ended])
def test_wrong_lengths_are_refused(name):
    layout = SPEC.messages[name]
    with pytest.raises(ProtocolError, match=f"{name}: payload of {layout.size + 1} bytes; expected {layout.size}"):
        unpack(layout.type, bytes(layout.size + 1))
    if layout.size:
        with pytest.raises(ProtocolError, match=f"expected {layout.size}"):
            unpack(layout.type, bytes(layout.size - 1))


def test_unknown_type_is_refused():
    with pytest.raises(ProtocolError, match="unknown message type 0xee"):
        unpack(0xEE, b"")


@pytest.mark.parametrize(
    "message",
    [
        Safe(256),
        DriveForce(2**31, 0, 0),
        RegisterValue(-1, 0.0),
        DriveGains(0, (0.0,) * 7, (0.0,) * 2, 0),
        DriveGains(0, (1e39,) * 8, (0.0,) * 2, 0),
        Status(0, 0, 2**32, 0, 0, 0, 0, 0, 0, 0),
    ],
)
def test_values_that_do_not_fit_are_refused(message):
    with pytest.raises(ProtocolError, match=SPEC.message_name(type_of(message))) as caught:
        pack(message)
    assert "\n" not in str(caught.value)


def test_ticks_of_any_width_travel_by_their_low_bits():
    assert unpack(0x10, pack(DriveForce(1, 2, 2**32 + 5))).effective_tick == 5
    assert unpack(0x31, pack(Status(0, 0, 0, 0, 0, 0, 0, 0, 0, 2**40 + 7))).tick == 7


def test_layout_of_a_drive_by_hand():
    assert pack(DriveForce(1, -2, 3)) == struct.pack("<iiI", 1, -2, 3)


def test_text_that_is_not_utf8_is_shown_not_refused():
    assert unpack(type_of(FieldValue), b"\0\0\1\0\xff!") == FieldValue(0, 1, "�!")


def test_field_table_line_by_line():
    assert field_value(1) == FieldValue(1, len(SPEC.table), "frame\ttype\tu8\t1")
    for line in (-1, len(SPEC.table)):
        with pytest.raises(ProtocolError, match=rf"FIELD_READ.line: {line}; the table has {len(SPEC.table)} lines"):
            field_value(line)


def test_sense_goes_through_the_same_door():
    block = Sense(np.array([[1, -2, 3, -4], [5, 6, 7, 8]], np.int32), 3, 1)
    back = unpack(type_of(block), pack(block))
    assert np.array_equal(back.codes, block.codes)
    assert (back.width, back.flags) == (3, 1)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[messages.ARM]", "[messages.LEG]", r"messages differ from spec.toml: \['ARM', 'LEG'\]"),
        ('name = "of_seq"', 'name = "of_sequence"', "Nack has fields .*; spec.toml gives NACK .*of_sequence"),
        ("WATCHDOG = 4", "WATCHDOG = 7", r"enumerations differ from spec.toml: \['SafeReason'\]"),
        ("[enums.LoopMode]", "[enums.LoopKind]", r"enumerations differ from spec.toml: \['LoopKind', 'LoopMode'\]"),
    ],
)
def test_names_and_spec_cannot_drift_apart(old, new, words):
    assert TEXT.count(old) == 1
    with pytest.raises(TypeError, match=words):
        check_against(parse_spec(TEXT.replace(old, new)))


def test_the_module_is_not_loaded_beside_a_spec_of_other_names(monkeypatch):
    monkeypatch.setattr(spec, "SPEC", parse_spec(TEXT.replace("[messages.ARM]", "[messages.LEG]")))
    monkeypatch.delitem(sys.modules, "hil.wire.codec")
    with pytest.raises(TypeError, match=r"messages differ from spec.toml: \['ARM', 'LEG'\]"):
        runpy.run_module("hil.wire.codec", run_name="again")


@pytest.mark.parametrize(
    ("firmware", "words"), [(0x00010203, "1.2.3"), (0x00010000, "1.0.0"), (0x00FF0A63, "255.10.99")]
)
def test_firmware_in_words(firmware, words):
    """IDENTITY.firmware is 0x00MMmmpp, a byte for each part."""
    assert version_of(firmware) == words
