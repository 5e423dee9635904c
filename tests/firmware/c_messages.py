"""The C structs of the messages, laid out from the spec by ctypes rather than read from the generated header."""

import ctypes
from typing import Any

from hil.wire.spec import SPEC, Layout

_TYPES = {
    "u8": ctypes.c_uint8,
    "u16": ctypes.c_uint16,
    "u32": ctypes.c_uint32,
    "u64": ctypes.c_uint64,
    "i16": ctypes.c_int16,
    "i32": ctypes.c_int32,
    "f32": ctypes.c_float,
    "f64": ctypes.c_double,
}


class CFrame(ctypes.Structure):
    """hil_frame."""

    _fields_ = [
        ("type", ctypes.c_uint8),
        ("sequenced", ctypes.c_bool),
        ("seq", ctypes.c_uint16),
        ("tick", ctypes.c_uint32),
        ("payload", ctypes.POINTER(ctypes.c_uint8)),
        ("size", ctypes.c_size_t),
    ]


def struct_of(layout: Layout) -> type[ctypes.Structure]:
    """The struct of one message; text is a pointer and a length."""
    members: list[tuple[str, Any]] = []
    for field in layout.fields:
        if field.type == "text":
            members += [(field.name, ctypes.c_char_p), (f"{field.name}_size", ctypes.c_size_t)]
            continue
        kind: Any = _TYPES[field.type.partition("[")[0]]
        members.append((field.name, kind * field.count if field.count > 1 else kind))
    return type(layout.name, (ctypes.Structure,), {"_fields_": members})


def pack(library: ctypes.CDLL, name: str, fields: dict[str, Any]) -> bytes:
    """Payload that the C side makes of a message's fixed fields and text."""
    layout = SPEC.messages[name]
    if not layout.fields:
        return b""
    values: list[Any] = []
    for field in layout.fields:
        value = fields[field.name]
        if field.type == "text":
            values += [value.encode(), len(value.encode())]
        else:
            values.append(tuple(value) if field.count > 1 else value)
    message = struct_of(layout)(*values)
    payload = (ctypes.c_uint8 * SPEC.max_payload)()
    function = getattr(library, f"hil_pack_{name.lower()}")
    function.restype = ctypes.c_size_t
    return bytes(payload[: function(ctypes.byref(message), payload)])


def unpack(library: ctypes.CDLL, name: str, payload: bytes) -> dict[str, Any] | None:
    """Fixed fields and text that the C side reads in a payload; None where it refuses the length."""
    layout = SPEC.messages[name]
    if not layout.fields:
        return None if payload else {}
    message = struct_of(layout)()
    function = getattr(library, f"hil_unpack_{name.lower()}")
    function.restype = ctypes.c_bool
    held = ctypes.create_string_buffer(payload, len(payload))
    if not function(ctypes.byref(message), held, ctypes.c_size_t(len(payload))):
        return None
    found: dict[str, Any] = {}
    for field in layout.fields:
        value = getattr(message, field.name)
        if field.type == "text":
            found[field.name] = payload[layout.size :].decode()
            assert getattr(message, f"{field.name}_size") == len(payload) - layout.size
        else:
            found[field.name] = list(value) if field.count > 1 else value
    return found
