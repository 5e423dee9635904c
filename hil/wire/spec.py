"""The wire's one spec file, loaded.

The spec boils down to its *field table*: one line (message, field, type, scale) per thing two peers must
agree on. Its CRC-32C is the spec hash that HELLO and IDENTITY carry; the same lines can be read from a board
one by one, so whenever two hashes differ there is a first line that differs, and it can be named.

Optional parts (messages, registers, enumerations of a capability) stand outside of it: one more changes no hash.
"""

import struct
import tomllib
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal, NamedTuple

from crc32c import crc32c

_STRUCT_CODES = {
    "u8": "B",
    "u16": "H",
    "u32": "I",
    "u64": "Q",
    "i16": "h",
    "i32": "i",
    "f32": "f",
    "f64": "d",
}


class FieldEntry(NamedTuple):
    """One line of the field table, all of it text."""

    message: str
    field: str
    type: str
    scale: str

    @property
    def text(self) -> str:
        """As it goes over the wire: four columns separated by tabs."""
        return "\t".join(self)

    @classmethod
    def parse(cls, text: str) -> "FieldEntry":
        """Read a line; missing columns become empty, so that a foreign table can always be shown."""
        columns = (*text.split("\t", 3), "", "", "", "")
        return cls(*columns[:4])


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message."""

    name: str
    type: str
    unit: str
    doc: str
    scale: str = "1"

    @property
    def count(self) -> int:
        """Numbers in the field: 1, or the length of an array such as `f32[8]`."""
        return int(self.type.partition("[")[2].rstrip("]") or 1)

    @property
    def struct(self) -> str:
        """Format of the field for `struct`; empty for `text` and `code`, which have no fixed size."""
        letter = _STRUCT_CODES.get(self.type.partition("[")[0], "")
        return letter if self.count == 1 else f"{self.count}{letter}"

    @property
    def bits(self) -> int:
        """Bits of the field; 0 for `text` and `code`."""
        base = self.type.partition("[")[0]
        return int(base[1:]) * self.count if base[1:].isdigit() else 0

    def entry(self, message: str) -> FieldEntry:
        scale = self.unit if self.scale == "1" else f"{self.scale} per {self.unit}"
        return FieldEntry(message, self.name, self.type, scale)


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of one message: fixed fields, then for SENSE rows of codes."""

    name: str
    type: int
    sender: Literal["host", "board", "either"]
    doc: str
    fields: tuple[Field, ...]
    rows: tuple[Field, ...] = ()
    frozen: bool = False
    optional: str = ""
    """The optional part that it belongs to, "" for what every peer knows."""

    @property
    def struct(self) -> str:
        """Format of the fixed fields for `struct`, little-endian without padding."""
        return "<" + "".join(field.struct for field in self.fields)

    @property
    def size(self) -> int:
        return struct.calcsize(self.struct)

    @property
    def open_ended(self) -> bool:
        return bool(self.rows) or any(field.type == "text" for field in self.fields)


@dataclass(frozen=True, slots=True)
class Register:
    """One register of the board."""

    name: str
    id: int
    unit: str
    access: Literal["rw", "ro"]
    live: bool
    default: float
    minimum: float
    maximum: float
    doc: str
    real: bool = False
    optional: str = ""
    """As of a message: a board without that part has no such register."""

    def accepts(self, value: float) -> bool:
        """Whether `value` is in range, and whole unless the register is real; NaN and infinities are not."""
        return self.minimum <= value <= self.maximum and (self.real or value == int(value))


@dataclass(frozen=True, slots=True)
class Enumeration:
    """Named values of a field or register; the values of flags are single bits."""

    name: str
    doc: str
    members: dict[str, int]
    flags: bool


@dataclass(frozen=True, slots=True)
class Part:
    """An optional part of the spec: the bit of IDENTITY.capabilities that stands for it, and the names of what belongs
    to it."""

    name: str
    bit: int
    doc: str
    messages: tuple[str, ...]
    registers: tuple[str, ...]
    enums: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CanSpec:
    """How frames travel on CAN.

    `header` precedes a part of the payload in a CAN FD frame; `sense` is the header of SENSE, before whole rows.
    `classic` are the layouts of classic frames, by name: SAFE, ARM, and what exists on CAN only.  `lengths` are the
    legal numbers of data bytes, ascending.
    """

    doc: str
    header_doc: str
    sense_doc: str
    header: tuple[Field, ...]
    sense: tuple[Field, ...]
    classic: dict[str, Layout]
    lengths: tuple[int, ...]
    type_shift: int
    node_shift: int
    nodes: int

    def identifier(self, type_: int, node: int, sender: int) -> int:
        """11-bit identifier of a message type; `sender` is 0 for the host, 1 for the board."""
        return type_ << self.type_shift | node << self.node_shift | sender


@dataclass(frozen=True, slots=True)
class Transition:
    """What a board does in one situation when something happens: a cell of the state table.

    `next` is the situation it goes to. `reason` is a `SafeReason` by name, `SENT` for the one in the frame, "" if
    STATUS goes on saying what it said. `answer` names the message that answers or tells, `refusal` the reason of a
    NACK; "" for none.
    """

    next: str
    reason: str = ""
    answer: str = ""
    refusal: str = ""


@dataclass(frozen=True, slots=True)
class States:
    """The state table.

    `situations` and `events` are the words for each, `state` the state that STATUS says in a situation, `table` a
    transition for every pair of situation and event. A SAFE frame for a reason of `latching` latches, for one of
    `passing` not; any other number counts as the first of `latching`.
    """

    situations: dict[str, str]
    events: dict[str, str]
    state: dict[str, str]
    table: dict[tuple[str, str], Transition]
    latching: tuple[str, ...]
    passing: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Spec:
    """Everything two peers agree on.

    A board is not armed in gain mode with a filter whose spectral radius exceeds `filter_radius`, refuses DRIVE_GAINS
    with a number beyond ± `gains_limit`, and a WATCHDOG_TICKS of more than `watchdog_s` seconds of its ticks.
    Messages, registers and enumerations are all of them, those of `optional` parts too; `table` and `hash` are without
    those. The first and the last type of optional messages, known or to come, are `optional_types`.
    """

    protocol: int
    max_payload: int
    filter_radius: float
    gains_limit: float
    watchdog_s: float
    optional_types: tuple[int, int]
    frame: tuple[Field, ...]
    messages: dict[str, Layout]
    registers: dict[str, Register]
    enums: dict[str, Enumeration]
    optional: dict[str, Part]
    states: States
    can: CanSpec
    table: tuple[FieldEntry, ...]
    hash: int

    def is_optional(self, type_: int) -> bool:
        """Whether a type is that of an optional message, known or to come."""
        return self.optional_types[0] <= type_ <= self.optional_types[1]

    def message_name(self, type_: int) -> str:
        """Name of a message type, or `type 0x..` if there is none."""
        return next((m.name for m in self.messages.values() if m.type == type_), f"type 0x{type_:02x}")


def parse_spec(text: str) -> Spec:
    """Build a spec from the text of a spec file.

    Raises:
        KeyError, TypeError: a key is missing or unknown (the file is part of the program, not user input).
    """
    raw = tomllib.loads(text)
    messages, registers, enums = _parts_of(raw)
    frame = tuple(Field(**field) for field in raw["frame"])
    can = _can(raw["can"])
    table = _field_table(raw, frame, messages, can, registers, enums)
    optional = {}
    for name, body in raw.get("optional", {}).items():
        more = _parts_of(body, name)
        optional[name] = Part(name, body["bit"], body["doc"], *(tuple(found) for found in more))
        messages, registers, enums = messages | more[0], registers | more[1], enums | more[2]
        enums["Capabilities"].members[name] = body["bit"]
    limits = ("protocol", "max_payload", "filter_radius", "gains_limit", "watchdog_s")
    return Spec(
        **{key: raw[key] for key in limits},
        optional_types=tuple(raw["optional_types"]),
        frame=frame,
        messages=messages,
        registers=registers,
        enums=enums,
        optional=optional,
        states=_states(raw),
        can=can,
        table=table,
        hash=crc32c("\n".join(entry.text for entry in table).encode()),
    )


def _parts_of(
    raw: dict[str, Any], optional: str = ""
) -> tuple[dict[str, Layout], dict[str, Register], dict[str, Enumeration]]:
    """Messages, registers and enumerations of the spec itself, or of an optional part."""
    messages = {name: _layout(name, body, optional) for name, body in raw.get("messages", {}).items()}
    registers = {
        name: Register(name=name, optional=optional, **body) for name, body in raw.get("registers", {}).items()
    }
    enums = {name: _enumeration(name, body, flags=False) for name, body in raw.get("enums", {}).items()}
    enums |= {name: _enumeration(name, body, flags=True) for name, body in raw.get("flags", {}).items()}
    return messages, registers, enums


def _layout(name: str, body: dict[str, Any], optional: str = "") -> Layout:
    fields, rows = (tuple(Field(**field) for field in body.pop(key, ())) for key in ("fields", "rows"))
    return Layout(name=name, fields=fields, rows=rows, optional=optional, **body)


def _can(raw: dict[str, Any]) -> CanSpec:
    return CanSpec(
        doc=raw["doc"],
        header_doc=raw["fd"]["doc"],
        sense_doc=raw["sense"]["doc"],
        header=tuple(Field(**field) for field in raw["fd"]["fields"]),
        sense=tuple(Field(**field) for field in raw["sense"]["fields"]),
        classic={name: _layout(name, body) for name, body in raw["classic"].items()},
        lengths=tuple(raw["lengths"]),
        **{key: raw[key] for key in ("type_shift", "node_shift", "nodes")},
    )


def _enumeration(name: str, body: dict[str, Any], *, flags: bool) -> Enumeration:
    members = {key: value for key, value in body.items() if key != "doc"}
    return Enumeration(name, body["doc"], members, flags)


def _states(raw: dict[str, Any]) -> States:
    situations = {name: body["doc"] for name, body in raw["situations"].items()}
    table = {(name, event): Transition(name) for name in situations for event in raw["events"]}
    listed: set[tuple[str, str]] = set()
    for row in raw["transitions"]:
        told = {key: value for key, value in row.items() if key not in ("from", "event")}
        for name in row["from"]:
            pair = name, row["event"]
            if pair not in table or pair in listed or told.get("next", name) not in situations:
                raise KeyError(f"transitions: {pair} is listed twice, or names a situation or event there is not")
            listed.add(pair)
            table[pair] = Transition(**{"next": name} | told)
    return States(
        situations=situations,
        events=raw["events"],
        state={name: body["state"] for name, body in raw["situations"].items()},
        table=table,
        latching=tuple(raw["latching"]),
        passing=tuple(raw["passing"]),
    )


def _field_table(
    raw: dict[str, Any],
    frame: tuple[Field, ...],
    messages: dict[str, Layout],
    can: CanSpec,
    registers: dict[str, Register],
    enums: dict[str, Enumeration],
) -> tuple[FieldEntry, ...]:
    """All that a peer must know to read and write frames; wording of the documentation is left out."""
    table = [FieldEntry("frame", "max_payload", str(raw["max_payload"]), "byte")]
    table += [field.entry("frame") for field in frame]
    for message in messages.values():
        table.append(FieldEntry(message.name, "", f"0x{message.type:02x}", message.sender))
        table += [field.entry(message.name) for field in message.fields]
        table += [field.entry(f"{message.name} row") for field in message.rows]
    table += _can_table(can)
    for register in registers.values():
        limits = f"{register.minimum}..{register.maximum} {register.unit}, default {register.default}"
        kind = f"0x{register.id:04x} {register.access}{' live' * register.live}{' real' * register.real}"
        table.append(FieldEntry("register", register.name, kind, limits))
    first, last = raw["optional_types"]
    table.append(FieldEntry("limit", "optional_types", f"0x{first:02x}..0x{last:02x}", "1"))
    for name, unit in (("filter_radius", "1"), ("gains_limit", "1"), ("watchdog_s", "s")):
        table.append(FieldEntry("limit", name, str(raw[name]), unit))
    for enum in enums.values():
        table += [FieldEntry(enum.name, name, str(value), "") for name, value in enum.members.items()]
    return tuple(table)


def _can_table(can: CanSpec) -> list[FieldEntry]:
    shifts = f"type << {can.type_shift} | node << {can.node_shift} | sender"
    table = [FieldEntry("CAN", "identifier", shifts, "")]
    table += [field.entry("CAN FD") for field in can.header]
    table += [field.entry("CAN FD SENSE") for field in can.sense]
    for layout in can.classic.values():
        table.append(FieldEntry(f"CAN {layout.name}", "", f"0x{layout.type:02x}", layout.sender))
        table += [field.entry(f"CAN {layout.name}") for field in layout.fields]
    return table


def first_difference(theirs: tuple[FieldEntry, ...], ours: tuple[FieldEntry, ...]) -> str | None:
    """The first line in which the board's field table differs from ours, in words; None if they are equal."""
    for other, mine in zip_longest(theirs, ours):
        if other == mine:
            continue
        if other is not None and other[:2] not in {entry[:2] for entry in ours}:
            return f"the board has {_words(other)}, this host does not"
        if mine is not None and mine[:2] not in {entry[:2] for entry in theirs}:
            return f"this host has {_words(mine)}, the board does not"
        return f"the board has {_words(other)}, this host has {_words(mine)}"
    return None


def _words(entry: FieldEntry | None) -> str:
    if entry is None:
        return "nothing there"
    name = f"{entry.message}.{entry.field}" if entry.field else entry.message
    return f"{name} ({', '.join(part for part in (entry.type, entry.scale) if part)})"


SPEC = parse_spec(Path(__file__).with_name("spec.toml").read_text(encoding="utf-8"))
