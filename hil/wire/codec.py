"""Codecs of all messages, built from the spec: payload bytes to named tuples and back."""

import re
import struct
from collections.abc import Sequence
from enum import Enum
from typing import Any, get_args

from hil.wire import messages
from hil.wire.errors import ProtocolError
from hil.wire.messages import FieldValue, Message
from hil.wire.sense import Sense, decode_sense, encode_sense
from hil.wire.spec import SPEC, Spec

_CLASSES: dict[str, type[Message]] = {
    re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).upper(): cls for cls in get_args(Message)
}


class _Codec:
    """Codec of one message, from its layout in the spec. SENSE has its own in `hil.wire.sense`."""

    def __init__(self, name: str) -> None:
        self.layout = SPEC.messages[name]
        self.cls = _CLASSES[name]
        self._struct = struct.Struct(self.layout.struct)
        fields = self.layout.fields
        self._plain = not self.layout.open_ended and all(field.count == 1 for field in fields)
        self._shape = [(field.name, field.type == "text", field.count) for field in fields]
        self._ticks = [k for k, field in enumerate(fields) if field.type == "u32" and field.unit == "tick"]

    def pack(self, message: Message) -> bytes:
        try:
            if isinstance(message, Sense):
                return encode_sense(message)
            values: list[Any] = list(message)
            for k in self._ticks:
                values[k] &= 0xFFFFFFFF
            if self._plain:
                return self._struct.pack(*values)
            numbers, text = _flatten(self._shape, values)
            return self._struct.pack(*numbers) + text
        except (struct.error, OverflowError) as error:
            raise ProtocolError(f"{self.layout.name}: {error} in {message}") from None

    def unpack(self, payload: bytes) -> Message:
        if self.cls is Sense:
            return decode_sense(payload)
        size = self._struct.size
        if len(payload) < size or (len(payload) > size and not self.layout.open_ended):
            raise ProtocolError(f"{self.layout.name}: payload of {len(payload)} bytes; expected {size}")
        numbers = self._struct.unpack_from(payload)
        if self._plain:
            return self.cls(*numbers)
        return self.cls(*_gather(self._shape, numbers, payload[size:]))


_Shape = Sequence[tuple[str, bool, int]]  # of each field: its name, whether it is text, how many numbers it has


def _flatten(shape: _Shape, values: Sequence[Any]) -> tuple[list[Any], bytes]:
    """Numbers in wire order, and the text behind them; the length of every array is checked."""
    numbers: list[Any] = []
    text = b""
    for (name, is_text, count), value in zip(shape, values, strict=True):
        if is_text:
            text = str(value).encode()
        elif count == 1:
            numbers.append(value)
        elif isinstance(value, Sequence) and len(value) == count:
            numbers.extend(value)
        else:
            raise struct.error(f"{name} needs {count} numbers")
    return numbers, text


def _gather(shape: _Shape, numbers: tuple[Any, ...], tail: bytes) -> list[Any]:
    """The opposite of `_flatten`; text that is not UTF-8 is shown with replacement characters."""
    values: list[Any] = []
    taken = 0
    for _, is_text, count in shape:
        if is_text:
            values.append(tail.decode("utf-8", "replace"))
            continue
        part = numbers[taken : taken + count]
        taken += count
        values.append(part[0] if count == 1 else part)
    return values


def check_against(spec: Spec) -> None:
    """Raise TypeError unless the named tuples and enumerations of this package are those of `spec`."""
    if _CLASSES.keys() != spec.messages.keys():
        raise TypeError(f"messages differ from spec.toml: {sorted(_CLASSES.keys() ^ spec.messages.keys())}")
    for name, cls in _CLASSES.items():
        declared = tuple(field.name for field in spec.messages[name].fields)
        if cls is not Sense and cls._fields != declared:
            raise TypeError(f"{cls.__name__} has fields {cls._fields}; spec.toml gives {name} {declared}")
    enums: list[type[Enum]] = [
        found
        for found in vars(messages).values()
        if isinstance(found, type) and issubclass(found, Enum) and found.__module__ == messages.__name__
    ]
    ours = {enum.__name__: {name: member.value for name, member in enum.__members__.items()} for enum in enums}
    theirs = {name: enum.members for name, enum in spec.enums.items()}
    if ours != theirs:
        different = [name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name)]
        raise TypeError(f"enumerations differ from spec.toml: {sorted(different)}")


check_against(SPEC)
_BY_CLASS: dict[type[Message], _Codec] = {cls: _Codec(name) for name, cls in _CLASSES.items()}
_BY_TYPE: dict[int, _Codec] = {codec.layout.type: codec for codec in _BY_CLASS.values()}

KNOWN_TYPES = frozenset(_BY_TYPE)
"""Type numbers of all messages."""


def type_of(message: Message | type[Message]) -> int:
    """Number of a message's type on the wire."""
    return _BY_CLASS[message if isinstance(message, type) else type(message)].layout.type


def pack(message: Message) -> bytes:
    """Payload of a message; ticks may be of any width, only the low 32 bits travel.

    Raises:
        ProtocolError: a value does not fit its field.
    """
    return _BY_CLASS[type(message)].pack(message)


def unpack(type_: int, payload: bytes) -> Message:
    """Message of a payload. Numbers only are checked to be there: what they mean is up to the receiver, so an
    unknown reason or state arrives as the integer it is.

    Raises:
        ProtocolError: unknown type, or a length that does not fit the type.
    """
    codec = _BY_TYPE.get(type_)
    if codec is None:
        raise ProtocolError(f"unknown message type 0x{type_:02x}")
    return codec.unpack(payload)


def field_value(line: int) -> FieldValue:
    """A board's answer to FIELD_READ.

    Raises:
        ProtocolError: no such line (answer NACK with OUT_OF_RANGE).
    """
    if not 0 <= line < len(SPEC.table):
        raise ProtocolError(f"FIELD_READ.line: {line}; the table has {len(SPEC.table)} lines")
    return FieldValue(line, len(SPEC.table), SPEC.table[line].text)
