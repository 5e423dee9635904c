"""What the pages have of the wire's spec: messages, registers, the state table, numbers that stand in their text."""

from collections.abc import Iterable, Iterator

from hil.wire.client import FIELD_TABLE_S, MOST_LINES
from hil.wire.framing import CRC_SIZE, HEADER, MAX_ENCODED
from hil.wire.keyed import CALL, CHALLENGE, FRAME, KEY_SIZE, NONCE_SIZE, OPEN, PEER_S, TAG_SIZE
from hil.wire.spec import SPEC, Enumeration, Field, Layout
from hil.wire.stream import REPEAT_RUN, REPEAT_WINDOW
from tools.keyed_example import BOARD_NONCE, HOST_NONCE, SECRET, example
from tools.markdown import table

_FIELD = ("field", "type", "unit", "")
_SENDER = {"host": "host → board", "board": "board → host", "either": "either way"}


def said() -> Iterator[str]:
    """What wire.md says with numbers of the program in it; where lines break is the page's own."""
    frame = ", ".join(f"{field.name} {field.type}" for field in SPEC.frame)
    yield f"COBS( {frame}, payload, crc32c u32 )"
    yield f"A payload has at most {SPEC.max_payload} bytes"
    yield f"has at least {HEADER.size + CRC_SIZE + 1} and at most {MAX_ENCODED} bytes."
    yield f"A number up to {REPEAT_WINDOW} behind the expected one"
    yield f"Exception: {REPEAT_RUN} such frames"
    yield f"one stray frame costs {REPEAT_RUN - 1} good ones, not {REPEAT_WINDOW}."
    yield f"field-table.tsv), {len(SPEC.table)} lines"
    yield f"A table has at most {MOST_LINES:,} lines"
    yield f"has not sent all lines after {FIELD_TABLE_S:g} s"
    yield f"a WATCHDOG_TICKS of more than {SPEC.watchdog_s:g} s"
    radius, area = SPEC.filter_radius, SPEC.filter_radius**2
    yield f"spectral radius of A is above {radius:g}"
    yield f"|det A| ≤ {area:.4g} and {radius:g} |tr A| ≤ {area:.4g} + det A"
    yield f"types `0x{SPEC.optional_types[0]:02x}` to `0x{SPEC.optional_types[1]:02x}` are for optional messages"
    yield f"up to {SPEC.can.nodes} boards share a bus as nodes 0 to {SPEC.can.nodes - 1}."
    yield f"heard from another peer within the last {PEER_S:g} s"
    yield f"| CALL | host | `{CALL:02x}`, host nonce ({NONCE_SIZE} bytes), tag |"
    yield f"| CHALLENGE | board | `{CHALLENGE:02x}`, host nonce, board nonce ({NONCE_SIZE} bytes), u8 busy, tag |"
    yield f"| OPEN | host | `{OPEN:02x}`, host nonce, board nonce"
    yield f"| FRAME | either | `{FRAME:02x}`, counter u64"
    yield f"a keyed BLAKE2s (RFC 7693) of {TAG_SIZE} bytes"
    yield f"has its own {KEY_SIZE}-byte key"
    yield f"keyed with the {KEY_SIZE} bytes of the key file"
    yield f"With the key {SECRET[0]:02x} {SECRET[1]:02x} … {SECRET[-1]:02x},"
    yield f"host nonce {HOST_NONCE[0]:02x} … {HOST_NONCE[-1]:02x},"
    yield f"board nonce {BOARD_NONCE[0]:02x} … {BOARD_NONCE[-1]:02x}:"


def spec() -> str:
    """Which spec the page is of."""
    return f"Protocol {SPEC.protocol}, spec hash `0x{SPEC.hash:08x}`."


def frame() -> str:
    """The header of a frame on a serial line."""
    return table(_FIELD, _field_rows(SPEC.frame))


def optional() -> str:
    """The optional parts there are, one paragraph each."""
    parts = []
    for part in SPEC.optional.values():
        what = [f"message {name}" for name in part.messages] + [f"register {name}" for name in part.registers]
        parts.append(f"**{part.name}** (bit `{part.bit}`): {part.doc} It has {', '.join(what)}.")
    return "\n\n".join(parts)


def messages() -> str:
    """A section for each message."""
    return "\n\n".join(map(_message, SPEC.messages.values()))


def can_identifier() -> str:
    """How an identifier is made."""
    return f"    {SPEC.can.doc}"


def can_header() -> str:
    """The parts of a message on CAN FD."""
    return f"**CAN FD.** {SPEC.can.header_doc}\n\n{table(_FIELD, _field_rows(SPEC.can.header))}"


def can_sense() -> str:
    """SENSE on CAN FD."""
    return f"**SENSE.** {SPEC.can.sense_doc}\n\n{table(_FIELD, _field_rows(SPEC.can.sense))}"


def can_classic() -> str:
    """The layouts on classic CAN."""
    parts = []
    for layout in SPEC.can.classic.values():
        name = f"`{layout.name}`, `0x{layout.type:02x}`, {_SENDER[layout.sender]}, {layout.size} bytes. {layout.doc}"
        parts.append(f"{name}\n\n{table(_FIELD, _field_rows(layout.fields))}")
    return "\n\n".join(parts)


def keyed_example() -> str:
    """Keys and datagrams of a short session."""
    return table(("", "hex"), ((what, f"`{data.hex()}`") for what, data in example().items()))


def registers() -> str:
    """All registers."""
    rows = [
        (
            f"`0x{r.id:04x}`",
            r.name,
            r.access + ", live" * r.live + ", real" * r.real + f", optional: {r.optional}" * bool(r.optional),
            f"{r.minimum:.15g} … {r.maximum:.15g}",
            f"{r.default:.15g}",
            "" if r.unit == "1" else r.unit,
            r.doc,
        )
        for r in SPEC.registers.values()
    ]
    return table(("id", "name", "access", "range", "default", "unit", ""), rows)


def enumerations() -> str:
    """All enumerations."""
    return "\n\n".join(map(_enumeration, SPEC.enums.values()))


def state_table() -> str:
    """What each event does, of safety.md."""
    return table(("when", "in", "then", "reason", "the board says"), _outcomes())


def field_table() -> str:
    """The field table as a file: its CRC-32C is the spec hash, so no line feed ends it."""
    return "\n".join(entry.text for entry in SPEC.table)


def _field_rows(fields: Iterable[Field], prefix: str = "") -> Iterator[tuple[str, ...]]:
    for field in fields:
        worth = "" if field.scale == "1" else f" × {field.scale.removeprefix('IDENTITY.')}"
        unit = "" if field.unit == "1" else field.unit
        yield f"{prefix}`{field.name}`", field.type, f"{unit}{worth}", field.doc


def _message(layout: Layout) -> str:
    size = f"{layout.size} byte{'' if layout.size == 1 else 's'}" + (" and more" if layout.open_ended else "")
    frozen = ", *frozen*" * layout.frozen + f", *optional*: {layout.optional}" * bool(layout.optional)
    parts = [f"### {layout.name}", f"`0x{layout.type:02x}`, {_SENDER[layout.sender]}, {size}{frozen}. {layout.doc}"]
    rows = [*_field_rows(layout.fields), *_field_rows(layout.rows, "row: ")]
    return "\n\n".join([*parts, table(_FIELD, rows)] if rows else parts)


def _enumeration(enum: Enumeration) -> str:
    values = ", ".join(f"`{value}` {name}" for name, value in enum.members.items())
    return f"**{enum.name}**{' (bits)' if enum.flags else ''}: {enum.doc} {values}."


def _outcomes() -> Iterator[tuple[str, ...]]:
    """Rows of the state table: what an event does, and in which situations; where it does nothing is left out."""
    states = SPEC.states
    for event, what in states.events.items():
        alike: dict[tuple[str, str, str], list[str]] = {}
        for name, words in states.situations.items():
            cell = states.table[name, event]
            following = "stays" if cell.next == name else states.situations[cell.next]
            answer = f"NACK, {cell.refusal}" if cell.refusal else cell.answer
            if following != "stays" or answer:
                reason = {"": "", "SENT": "the frame's"}.get(cell.reason, cell.reason)
                alike.setdefault((following, reason, answer), []).append(words)
        for k, ((following, reason, answer), found) in enumerate(alike.items()):
            where = "any" if len(found) == len(states.situations) else ", ".join(found)
            yield "" if k else what, where, following, reason, answer


PARTS = {
    "spec": spec,
    "frame": frame,
    "optional": optional,
    "messages": messages,
    "can_identifier": can_identifier,
    "can_header": can_header,
    "can_sense": can_sense,
    "can_classic": can_classic,
    "keyed_example": keyed_example,
    "registers": registers,
    "enumerations": enumerations,
}
