"""The wire on CAN as a DBC file, for any CAN tool.

One DBC message per identifier of node 0; another node's identifiers are higher by twice its number.  All fields are
laid out, those of a message of several frames by the number of the part; text, which DBC does not know, is left out.
Codes have the unit "code": what one is worth is in IDENTITY.
"""

from bisect import bisect_left
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from hil.wire.spec import SPEC, Field

HOST, BOARD = 0, 1
_NODES = ("HOST", "BOARD")
_CLASSIC, _FD = 0, 14  # of VFrameFormat; without it tools read CAN FD back as classic
_FORMATS = ["StandardCAN", "ExtendedCAN", "reserved", "J1939PG", *["reserved"] * 10, "StandardCAN_FD", "ExtendedCAN_FD"]

_HEAD = """\
VERSION ""

NS_ :

BS_:

BU_: HOST BOARD

"""


@dataclass(frozen=True)
class _Signal:
    """One signal, little-endian; `multiplexer` as in DBC: "", "M", or "m0"."""

    name: str
    start: int
    bits: int
    kind: str  # u, i or f
    unit: str
    doc: str
    multiplexer: str = ""

    def line(self, receiver: str) -> str:
        sign = "+" if self.kind == "u" else "-"
        unit = "" if self.unit == "1" or self.unit in SPEC.enums else self.unit
        multiplexer = f" {self.multiplexer}" if self.multiplexer else ""
        return f' SG_ {self.name}{multiplexer} : {self.start}|{self.bits}@1{sign} (1,0) [0|0] "{unit}" {receiver}'


@dataclass(frozen=True)
class _Message:
    """One identifier."""

    name: str
    identifier: int
    sender: int
    size: int
    format: int
    doc: str
    signals: tuple[_Signal, ...]

    def lines(self) -> str:
        head = f"BO_ {self.identifier} {self.name}: {self.size} {_NODES[self.sender]}"
        return "\n".join((head, *(signal.line(_NODES[1 - self.sender]) for signal in self.signals)))


def _signals(fields: Iterable[Field], start: int) -> Iterator[_Signal]:
    """The fields, from bit `start` on; an array as one signal per number, text not at all."""
    for field in fields:
        if not field.bits:
            continue
        each = field.bits // field.count
        for k in range(field.count):
            name = field.name if field.count == 1 else f"{field.name}_{k}"
            yield _Signal(name, start, each, field.type[0], field.unit, field.doc)
            start += each


def _bits(fields: Iterable[Field]) -> int:
    return sum(field.bits for field in fields)


def _legal(size: int) -> int:
    return SPEC.can.lengths[min(bisect_left(SPEC.can.lengths, size), len(SPEC.can.lengths) - 1)]


def _sense() -> _Message:
    """SENSE: as many rows as a frame holds, for either width of a code."""
    can, layout = SPEC.can, SPEC.messages["SENSE"]
    head = [replace(s, multiplexer="M") if s.name == "wide" else s for s in _signals(can.sense, 0)]
    start = _bits(can.sense)
    rows = []
    for wide, width in enumerate((2, 3)):
        count = (8 * can.lengths[-1] - start) // (8 * width * len(layout.rows))
        for k in range(count * len(layout.rows)):
            row, column = divmod(k, len(layout.rows))
            field = layout.rows[column]
            name = f"{field.name}{'_wide' * wide}_{row}"
            rows.append(_Signal(name, start + 8 * width * k, 8 * width, "i", field.unit, field.doc, f"m{wide}"))
    identifier = can.identifier(layout.type, 0, BOARD)
    return _Message("SENSE", identifier, BOARD, can.lengths[-1], _FD, layout.doc, (*head, *rows))


def _messages() -> Iterator[_Message]:
    can = SPEC.can
    for name, layout in can.classic.items():
        sender = BOARD if layout.sender == "board" else HOST
        signals = tuple(_signals(layout.fields, 0))
        doc = SPEC.messages[name].doc if name in SPEC.messages else layout.doc
        yield _Message(
            name, can.identifier(layout.type, 0, sender), sender, _bits(layout.fields) // 8, _CLASSIC, doc, signals
        )
    yield _sense()
    start = _bits(can.header)
    for name, layout in SPEC.messages.items():
        if name in can.classic or layout.rows:
            continue
        several = layout.open_ended or start // 8 + layout.size > can.lengths[-1]
        for sender in {"host": (HOST,), "board": (BOARD,), "either": (HOST, BOARD)}[layout.sender]:
            # Where a message goes on in another frame, each part has fields of its own.
            head = [replace(s, multiplexer="M") if several and s.name == "part" else s for s in _signals(can.header, 0)]
            taken = {s.name for s in head}
            body = [
                replace(s, name=f"{name.lower()}_{s.name}") if s.name in taken else s
                for s in _in_parts(layout.fields, start, several=several)
            ]
            size = can.lengths[-1] if several else _legal(start // 8 + layout.size)
            answer = "_ANSWER" if layout.sender == "either" and sender == BOARD else ""
            yield _Message(
                name + answer, can.identifier(layout.type, 0, sender), sender, size, _FD, layout.doc, (*head, *body)
            )


def _in_parts(fields: Iterable[Field], start: int, *, several: bool) -> Iterator[_Signal]:
    """The fields behind the header, which ends at bit `start`; of `several` frames each in the part that it lies in.

    Raises ValueError for one that lies across two frames, which no DBC can say.
    """
    room = 8 * SPEC.can.lengths[-1] - start
    for signal in _signals(fields, 0):
        part, place = divmod(signal.start, room)
        if several and place + signal.bits > room:
            raise ValueError(f"{signal.name}: lies across two CAN frames; order the fields otherwise")
        yield replace(signal, start=start + place, multiplexer=f"m{part}" if several else "")


def _values(signal: _Signal) -> dict[int, str]:
    """What the values of a signal are called."""
    if signal.name == "register":
        return {register.id: name for name, register in SPEC.registers.items()}
    if signal.name == "of_type":
        return {layout.type: name for name, layout in SPEC.messages.items()}
    enumeration = SPEC.enums.get(signal.unit)
    if enumeration is None or enumeration.flags:
        return {}
    return {value: name for name, value in enumeration.members.items()}


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', "'") + '"'


def render() -> str:
    """The file's text."""
    messages = sorted(_messages(), key=lambda message: message.identifier)
    parts = [_HEAD + "\n\n".join(message.lines() for message in messages)]
    comments = [f"CM_ BO_ {m.identifier} {_quoted(m.doc)};" for m in messages]
    comments += [f"CM_ SG_ {m.identifier} {s.name} {_quoted(s.doc)};" for m in messages for s in m.signals]
    parts.append("\n".join(comments))
    formats = ",".join(_quoted(name) for name in _FORMATS)
    parts.append(
        "\n".join(
            (
                f'BA_DEF_ BO_ "VFrameFormat" ENUM {formats};',
                'BA_DEF_ BO_ "CANFD_BRS" ENUM "0","1";',
                'BA_DEF_ "BusType" STRING ;',
                'BA_DEF_DEF_ "VFrameFormat" "StandardCAN";',
                'BA_DEF_DEF_ "CANFD_BRS" "0";',
                'BA_DEF_DEF_ "BusType" "";',
                'BA_ "BusType" "CAN FD";',
                *(f'BA_ "VFrameFormat" BO_ {m.identifier} {m.format};' for m in messages),
                *(f'BA_ "CANFD_BRS" BO_ {m.identifier} 1;' for m in messages if m.format == _FD),
            )
        )
    )
    values = [
        f"VAL_ {m.identifier} {s.name} " + " ".join(f"{value} {_quoted(name)}" for value, name in names.items()) + " ;"
        for m in messages
        for s in m.signals
        if (names := _values(s))
    ]
    parts.append("\n".join(values))
    floats = [
        f"SIG_VALTYPE_ {m.identifier} {s.name} : {1 if s.bits == 32 else 2};"
        for m in messages
        for s in m.signals
        if s.kind == "f"
    ]
    parts.append("\n".join(floats))
    return "\n\n".join(parts) + "\n"
