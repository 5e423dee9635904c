"""The spec: consistent in itself, and its hash a fingerprint of what matters."""

from dataclasses import replace
from pathlib import Path

import pytest

from hil.wire import spec
from hil.wire.sense import MAX_ROWS
from hil.wire.spec import SPEC, FieldEntry, first_difference, parse_spec

TEXT = Path(spec.__file__).with_name("spec.toml").read_text(encoding="utf-8")


def test_message_types_and_register_numbers_are_unique():
    types = [message.type for message in SPEC.messages.values()]
    numbers = [register.id for register in SPEC.registers.values()]
    assert len(set(types)) == len(types)
    assert len(set(numbers)) == len(numbers)
    assert 0 < min(types) <= max(types) <= 0xFF


def test_urgent_messages_have_the_lowest_types():
    order = sorted(SPEC.messages, key=lambda name: SPEC.messages[name].type)
    assert order[:3] == ["SAFE", "ARM", "DRIVE_FORCE"]


def test_every_field_has_a_known_type_and_a_meaning():
    for message in SPEC.messages.values():
        for field in message.fields:
            assert field.struct or field.type == "text", f"{message.name}.{field.name}"
            assert field.unit
            assert field.doc
        assert all(field.type == "code" for field in message.rows)
        assert [field.type for field in message.fields[:-1]].count("text") == 0
        assert message.size <= SPEC.max_payload


def test_units_that_name_an_enumeration_name_an_existing_one():
    fields = [field for message in SPEC.messages.values() for field in message.fields]
    units = {thing.unit for thing in (*fields, *SPEC.registers.values())}
    assert {unit for unit in units if unit[0].isupper()} - {"Hz", "V"} <= SPEC.enums.keys()


def test_scales_name_fields_that_a_board_tells():
    messages = SPEC.messages.values()
    told = [message for message in messages if message.sender == "board"]
    known = {f"{message.name}.{field.name}" for message in told for field in message.fields} | {"1"}
    assert {field.scale for message in messages for field in (*message.fields, *message.rows)} <= known


def test_registers_accept_their_default_and_nothing_outside_their_range():
    for register in SPEC.registers.values():
        assert register.accepts(register.default)
        assert register.accepts(register.minimum)
        assert register.accepts(register.maximum)
        for value in (
            register.minimum - 1,
            register.maximum + 1,
            float("nan"),
            float("inf"),
        ):
            assert not register.accepts(value)
        assert register.accepts(register.minimum + 0.5) is register.real


def test_a_full_block_of_24_bit_codes_fits_a_payload():
    assert SPEC.registers["BLOCK"].maximum == MAX_ROWS[3]


def test_messages_that_let_two_versions_talk_never_change():
    frozen = [entry.text for entry in SPEC.table if entry.message in {"HELLO", "FIELD_READ", "FIELD_VALUE"}]
    assert frozen == [
        "HELLO\t\t0x40\thost",
        "HELLO\tprotocol\tu16\t1",
        "HELLO\tspec_hash\tu32\t1",
        "FIELD_READ\t\t0x45\thost",
        "FIELD_READ\tline\tu16\t1",
        "FIELD_VALUE\t\t0x46\tboard",
        "FIELD_VALUE\tline\tu16\t1",
        "FIELD_VALUE\tlines\tu16\t1",
        "FIELD_VALUE\tentry\ttext\t1",
    ]
    assert {m.name for m in SPEC.messages.values() if m.frozen} == {"HELLO", "FIELD_READ", "FIELD_VALUE"}
    identity = [entry.text for entry in SPEC.table if entry.message == "IDENTITY"][:3]
    assert identity == [
        "IDENTITY\t\t0x41\tboard",
        "IDENTITY\tprotocol\tu16\t1",
        "IDENTITY\tspec_hash\tu32\t1",
    ]
    assert [entry.text for entry in SPEC.table if entry.message == "frame"][1:] == [
        "frame\ttype\tu8\t1",
        "frame\tseq\tu16\t1",
        "frame\ttick\tu32\ttick",
    ]


def test_table_lines_survive_the_wire():
    for entry in SPEC.table:
        assert FieldEntry.parse(entry.text) == entry
        assert "\n" not in entry.text
    assert FieldEntry.parse("only one column") == ("only one column", "", "", "")
    assert FieldEntry.parse("a\tb\tc\td\te") == ("a", "b", "c", "d\te")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name = "uy",             type = "i32"', 'name = "uy", type = "i16"'),
        ("max_payload = 8192", "max_payload = 4096"),
        ("WATCHDOG = 4", "WATCHDOG = 9"),
        ("maximum = 682", "maximum = 600"),
        ("type = 0x20\n", "type = 0x21\n"),
    ],
)
def test_hash_follows_what_matters(old, new):
    assert old in TEXT
    assert parse_spec(TEXT.replace(old, new)).hash != SPEC.hash


def test_hash_ignores_wording():
    assert parse_spec(TEXT.replace("Drive along x.", "Drive in x.")).hash == SPEC.hash


def test_first_difference_names_the_field():
    changed = list(SPEC.table)
    place = next(k for k, entry in enumerate(changed) if entry.field == "uy")
    changed[place] = changed[place]._replace(type="i16")
    words = first_difference(tuple(changed), SPEC.table)
    assert words == (
        "the board has DRIVE_FORCE.uy (i16, IDENTITY.drive_scale_mps2 per code), "
        "this host has DRIVE_FORCE.uy (i32, IDENTITY.drive_scale_mps2 per code)"
    )


def test_first_difference_sees_missing_and_additional_lines():
    assert first_difference(SPEC.table, SPEC.table) is None
    short = first_difference(SPEC.table[:-1], SPEC.table)
    assert short == "this host has Capabilities.BOARD_MODE (16), the board does not"
    gap = first_difference(SPEC.table[:5] + SPEC.table[6:], SPEC.table)
    assert gap == "this host has SAFE.reason (u8, SafeReason), the board does not"
    twice = first_difference((*SPEC.table, SPEC.table[0]), SPEC.table)
    assert twice == "the board has frame.max_payload (8192, byte), this host has nothing there"
    long = first_difference((*SPEC.table, FieldEntry("State", "ASLEEP", "5", "")), SPEC.table)
    assert long == "the board has State.ASLEEP (5), this host does not"


def test_message_names():
    assert SPEC.message_name(0x20) == "SENSE"
    assert SPEC.message_name(0xEE) == "type 0xee"


def test_spec_cannot_be_changed_by_accident():
    with pytest.raises(AttributeError):
        SPEC.protocol = 2
    assert replace(SPEC, protocol=2).protocol == 2


def test_a_situation_goes_where_its_row_says_and_stays_where_none_does():
    """hil/wire/spec.toml, [[transitions]]: what is not listed changes nothing and says nothing."""
    states = SPEC.states
    assert states.table["BOOT", "HELLO"] == spec.Transition("IDLE", answer="IDENTITY")
    assert states.table["SAFE", "HELLO"] == spec.Transition("SAFE", answer="IDENTITY")
    assert set(states.table) == {(name, event) for name in states.situations for event in states.events}
    assert states.state["SAFE_LATCHED"] == "SAFE"
    without = TEXT.replace('from = ["BOOT"]\nevent = "HELLO"\nnext = "IDLE"', 'from = []\nevent = "HELLO"')
    assert parse_spec(without).states.table["BOOT", "HELLO"] == spec.Transition("BOOT")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('from = ["SAFE_LATCHED"]\nevent = "HELLO"', 'from = ["SAFE"]\nevent = "HELLO"'),
        ('from = ["BOOT"]\nevent = "HELLO"', 'from = ["COT"]\nevent = "HELLO"'),
        ('from = ["BOOT"]\nevent = "HELLO"', 'from = ["BOOT"]\nevent = "HULLO"'),
        ('event = "HELLO"\nnext = "IDLE"', 'event = "HELLO"\nnext = "IDEAL"'),
    ],
    ids=["listed twice", "no such situation", "no such event", "goes nowhere"],
)
def test_a_transition_that_contradicts_the_table_is_refused(old, new):
    assert TEXT.count(old) == 1
    with pytest.raises(KeyError, match="transitions: "):
        parse_spec(TEXT.replace(old, new))
