"""The golden vectors of the wire, in both directions, on the C side."""

import ctypes
import json
from pathlib import Path
from typing import Any

import pytest

from hil.wire.framing import Frame
from hil.wire.spec import SPEC

from .c_messages import pack, unpack
from .c_reader import CReader, write_frame
from .conftest import FIRMWARE

VECTORS = json.loads((Path(__file__).parents[1] / "wire" / "golden.json").read_text(encoding="utf-8"))
frames = pytest.mark.parametrize("vector", VECTORS["frames"], ids=lambda vector: vector["name"])


def fixed(vector: dict[str, Any]) -> dict[str, Any]:
    """The fields of a vector that its C struct has: of SENSE, the number of rows instead of the rows."""
    fields = dict(vector["fields"])
    if "codes" in fields:
        fields["n"] = len(fields.pop("codes"))
    return fields


@frames
def test_fields_to_payload(library: ctypes.CDLL, vector: dict[str, Any]) -> None:
    made = pack(library, vector["message"], fixed(vector)).hex()
    whole = vector["payload"]
    rows = "codes" in vector["fields"]
    assert made == (whole[: 2 * SPEC.messages["SENSE"].size] if rows else whole)


@frames
def test_payload_to_fields(library: ctypes.CDLL, vector: dict[str, Any]) -> None:
    payload = bytes.fromhex(vector["payload"])
    assert unpack(library, vector["message"], payload) == fixed(vector)
    layout = SPEC.messages[vector["message"]]
    assert unpack(library, vector["message"], payload[: layout.size - 1]) is None or layout.size == 0
    assert layout.open_ended or unpack(library, vector["message"], payload + b"\0") is None


@frames
def test_frame_written_and_read(library: ctypes.CDLL, vector: dict[str, Any]) -> None:
    type_ = SPEC.messages[vector["message"]].type
    frame = Frame(type_, vector["seq"], vector["tick"], bytes.fromhex(vector["payload"]))
    assert b"".join(write_frame(library, frame)).hex() == vector["frame"]
    assert CReader(library).feed(bytes.fromhex(vector["frame"])) == [frame]


@pytest.mark.parametrize("vector", VECTORS["rejected"], ids=lambda vector: vector["name"])
def test_broken_frames_are_counted_where_they_belong(library: ctypes.CDLL, vector: dict[str, Any]) -> None:
    reader = CReader(library)
    assert reader.feed(bytes.fromhex(vector["stream"])) == []
    counters = reader.counters
    assert counters.pop(vector["counter"]) == 1
    assert not any(counters.values())


def test_field_table_is_the_hosts(library: ctypes.CDLL) -> None:
    assert f"#define HIL_FIELD_LINES {len(SPEC.table)}u" in (FIRMWARE / "src" / "hil_spec.h").read_text()
    table = (ctypes.c_char_p * len(SPEC.table)).in_dll(library, "hil_field_table")
    assert [entry.decode() for entry in table] == [entry.text for entry in SPEC.table]
