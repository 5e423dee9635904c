"""Where the fields of one frame stand: from a declaration and a frame's head to a function that reads it.

Checksums of makers' frames are each over a frame with its checksum at the end.
"""

import binascii
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial, reduce
from operator import xor
from typing import Any, Literal, NamedTuple

from hil.records.layout import Column
from hil.sensors.declared import Field, Protocol, fields_of

LONGEST = 1024
"""Bytes; whatever says it is longer is no frame."""

_PACKED = {"t": "3s", "T": "3s", "w": "6s"}
"""Types that struct does not have."""
_PRECISIONS = {0: ("f", 1.0), 1: ("i", 2.0**-20), 2: ("w", 2.0**-32), 3: ("d", 1.0)}


class Reading(NamedTuple):
    """What one frame says: the counter or None, values of fields with a column by name, status, latency in µs, counts
    of a clock beside the counter or None."""

    counter: int | None
    values: dict[str, float]
    status: int
    latency_us: int
    clock: int | None = None


class Layout(NamedTuple):
    """The fields of a frame, `size` bytes of it in all, and how it is read."""

    size: int
    fields: tuple[Field, ...]
    read: Callable[[bytes], Reading]


Finder = Callable[[bytes, int], Layout | int | None]
"""From a buffer and where a frame may begin to its layout; to the bytes there must be first; None where it is none."""


class Framing(NamedTuple):
    """How a protocol's frames are found: what they begin with, their fields as declared, whether a checksum fits."""

    begins: Sequence[bytes]
    fields: Sequence[Sequence[Field]]
    find: Finder
    fits: Callable[[bytes], bool]

    @property
    def rates(self) -> tuple[Column, ...]:
        """Columns of the rates, as the first fields that are declared with some have them."""
        every = ([one.column for one in fields if one.name.startswith("rate_")] for fields in self.fields)
        return tuple(column for column in next(columns for columns in every if columns) if column is not None)


def framing_of(protocol: Protocol) -> Framing:
    """By the way that it declares."""
    return next(make(protocol) for way, make in _WAYS.items() if way in protocol.how)


def _by_start(protocol: Protocol) -> Framing:
    blocks = {name: tuple(fields_of(texts)) for name, texts in protocol.how["blocks"].items()}
    layouts: dict[bytes, Layout] = {}
    for start, names in protocol.how["frames"].items():
        fields = tuple(field for name in names.split() for field in blocks[name])
        layouts[bytes.fromhex(start)] = _binary(protocol, len(start) // 2, fields)
    width = max(map(len, layouts))
    find: Finder = lambda buffer, at: layouts.get(buffer[at : at + width])  # noqa: E731
    return Framing(list(layouts), list(blocks.values()), find, partial(_fits, protocol))


def _by_group(protocol: Protocol) -> Framing:
    groups = [[tuple(fields_of(texts)) for texts in group] for group in protocol.how["groups"]["fields"]]
    known: dict[bytes, Layout | None] = {}

    def find(buffer: bytes, at: int) -> Layout | int | None:
        if len(buffer) < at + 2:
            return 2
        chosen = [bit for bit in range(8) if buffer[at + 1] >> bit & 1]
        if not chosen or chosen[-1] >= len(groups):
            return None
        head = buffer[at : at + 2 + 2 * len(chosen)]
        if len(head) < 2 + 2 * len(chosen):
            return 2 + 2 * len(chosen)
        if head not in known:
            masks = struct.unpack_from(f"<{len(chosen)}H", head, 2)
            bits = [(groups[group], mask) for group, mask in zip(chosen, masks, strict=True)]
            if any(mask == 0 or mask >> len(group) for group, mask in bits):
                return None
            texts = [one for group, mask in bits for bit, one in enumerate(group) if mask >> bit & 1]
            fields = tuple(one for each in texts for one in each)
            if not any(one.name.startswith("rate_") for one in fields):  # the one that is sent is the rate
                fields = tuple(one._replace(name=one.name.replace("raw_rate", "rate")) for one in fields)
            if len(known) > 1000:  # of noise
                known.clear()
            known[head] = _binary(protocol, len(head), fields)
        return known[head]

    every = [fields for group in groups for fields in group]
    return Framing([bytes.fromhex(protocol.how["groups"]["sync"])], every, find, partial(_fits, protocol))


def _by_tag(protocol: Protocol) -> Framing:
    declared = {int(tag, 16): tuple(fields_of(texts)) for tag, texts in protocol.how["tags"].items() if tag != "sync"}
    sync = len(protocol.how["tags"]["sync"]) // 2
    known: dict[bytes, Layout | None] = {}

    def find(buffer: bytes, at: int) -> Layout | int | None:
        head = sync + 1
        if len(buffer) < at + head:
            return head
        length = buffer[at + sync]
        if length == 0xFF:
            head = sync + 3
            if len(buffer) < at + head:
                return head
            length = int.from_bytes(buffer[at + sync + 1 : at + head], "big")
        size = head + length + CHECKS[protocol.check].size
        if length == 0 or size > LONGEST:
            return None
        if len(buffer) < at + size:
            return size
        key, place, fields = buffer[at : at + head], at + head, []
        while place < at + head + length:
            tag, width = int.from_bytes(buffer[place : place + 2], "big"), buffer[place + 2]
            key += buffer[place : place + 3]
            fields += _tagged(declared, tag, width)
            place += 3 + width
        if place != at + head + length:
            return None
        if len(known) > 1000:
            known.clear()
        if key not in known:
            known[key] = _binary(protocol, head, tuple(fields))
        return known[key]

    begins = [bytes.fromhex(protocol.how["tags"]["sync"])]
    return Framing(begins, list(declared.values()), find, partial(_fits, protocol))


def _tagged(declared: Mapping[int, tuple[Field, ...]], tag: int, width: int) -> list[Field]:
    """Identifier and length are skipped, and the whole of what is not declared or of another precision."""
    skip = Field("-", "3s")
    precision = _PRECISIONS.get(tag & 3)
    fields = []
    for one in declared.get(tag & 0xFFF0, ()):
        if one.type == "F" and precision is None:
            return [Field("-", f"{3 + width}s")]
        kind, factor = (one.type, 1.0) if one.type != "F" or precision is None else precision
        fields.append(one._replace(type=kind, factor=one.factor * factor))
    if not fields or struct.calcsize(">" + _codes(fields)) != width:
        return [Field("-", f"{3 + width}s")]
    return [skip, *fields]


def _codes(fields: Sequence[Field]) -> str:
    return "".join(_PACKED.get(one.type, one.type) for one in fields)


def _binary(protocol: Protocol, head: int, fields: tuple[Field, ...]) -> Layout:
    """Fields packed one after the other behind `head` bytes."""
    packed = struct.Struct(f"{protocol.order}{head}x{_codes(fields)}")
    order: Literal["big", "little"] = "big" if protocol.order == ">" else "little"
    types = [one.type for one in fields]

    def number_of(packed: Any, type_: str) -> Any:
        if type_ not in _PACKED:
            return packed
        in_order = packed[4:] + packed[:4] if type_ == "w" else packed
        return int.from_bytes(in_order, order, signed=type_ != "T")

    def read(frame: bytes) -> Reading:
        return _reading(fields, map(number_of, packed.unpack_from(frame), types), protocol)

    size = packed.size + CHECKS[protocol.check].size + len(protocol.tail)
    return Layout(size, fields, read)


def _fits(protocol: Protocol, frame: bytes) -> bool:
    """Whether the checksum in front of the tail is right."""
    body = frame[protocol.check_from : len(frame) - len(protocol.tail)]
    return frame.endswith(protocol.tail) and CHECKS[protocol.check].left(body) == 0


def _by_sentence(protocol: Protocol) -> Framing:
    """Text: `$NAME,number,…*CHECKSUM`, two digits of an exclusive or or four of a CRC, over what stands between."""
    declared = {b"$" + name.encode(): tuple(fields_of(texts)) for name, texts in protocol.how["sentences"].items()}

    def find(buffer: bytes, at: int) -> Layout | int | None:
        star = buffer.find(b"*", at, at + 300)
        if star < 0:
            return len(buffer) - at + 1 if len(buffer) - at < 300 else None
        if len(buffer) < star + 5:
            return star + 5 - at
        fields = declared[buffer[at : at + 6]]
        digits = 4 if all(byte in b"0123456789ABCDEFabcdef" for byte in buffer[star + 1 : star + 5]) else 2

        def read(frame: bytes) -> Reading:
            texts = frame[: star - at].split(b",")[1:]
            return _reading(fields, map(float, texts), protocol)

        return Layout(star + 1 + digits - at, fields, read)

    def fits(frame: bytes) -> bool:
        body, _, told = frame[1:].partition(b"*")
        made = reduce(xor, body) if len(told) == 2 else binascii.crc_hqx(body, 0)
        try:
            return int(told, 16) == made
        except ValueError:
            return False

    return Framing([name + b"," for name in declared], list(declared.values()), find, fits)


_WAYS = {"frames": _by_start, "groups": _by_group, "tags": _by_tag, "sentences": _by_sentence}


def _reading(fields: Sequence[Field], numbers: object, protocol: Protocol) -> Reading:
    counter: int | None = None
    clock: int | None = None
    values: dict[str, float] = {}
    status, latency_us = 0, -1
    for one, number in zip(fields, numbers, strict=True):  # type: ignore[call-overload]
        match one.name:
            case "-":
                pass
            case "counter":
                counter = number
            case "clock":
                clock = number
            case "time_ns":
                counter = number // 1000 % protocol.counter_size
            case "status":
                status |= number << int(one.factor)
            case "latency_us":
                latency_us = number
            case name:
                values[name] = number
    for name in [name for name in values if "@" in name]:  # only where that bit of the status is set
        plain, _, bit = name.partition("@")
        number = values.pop(name)
        if status >> int(bit) & 1:
            values[plain] = number
    if "counter" in protocol.status:
        counter = status >> int(protocol.status["counter"]) & (protocol.counter_size - 1)
    return Reading(counter, values, status & 0x7FFF_FFFF_FFFF_FFFF, latency_us, clock)


_MIRROR = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class Check(NamedTuple):
    """A checksum of so many bytes: `left` of a frame is 0 where it fits."""

    size: int
    left: Callable[[bytes], int]


def _crc32(frame: bytes) -> int:
    """x³² + x²⁶ + … + 1 from all ones, nothing mirrored or inverted (CRC-32/MPEG-2), over zeros up to a multiple of
    four bytes that are not sent. zlib's is the same with every byte and the result mirrored and the result inverted:
    compared in its mirror it is this one, at the speed of C.
    """
    mirrored = frame.translate(_MIRROR)
    body = mirrored[:-4]
    made: int = zlib.crc32(body + bytes(-len(body) % 4))
    return made ^ 0xFFFFFFFF ^ int.from_bytes(mirrored[-4:], "little")


def _words_last(frame: bytes) -> int:
    words: tuple[int, ...] = struct.unpack(f"<{len(frame) // 2}H", frame)
    return (sum(words[:-1]) - words[-1]) & 0xFFFF


CHECKS: Mapping[str, Check] = {
    "none": Check(0, lambda _: 0),
    "crc32": Check(4, _crc32),
    "crc16": Check(2, lambda frame: binascii.crc_hqx(frame, 0)),
    "sum8": Check(1, lambda frame: sum(frame) & 0xFF),
    "sum16": Check(2, lambda frame: (sum(frame[:-2]) - int.from_bytes(frame[-2:], "big")) & 0xFFFF),
    "words_zero": Check(2, lambda frame: sum(struct.unpack(f">{len(frame) // 2}H", frame)) & 0xFFFF),
    "words_last": Check(2, _words_last),
}
