"""The committed pages are the ones the spec makes."""

from pathlib import Path

from crc32c import crc32c

from hil.wire.generate import docs
from hil.wire.spec import SPEC

PAGES = Path(__file__).parents[2] / "docs"
PAGE = PAGES / "wire.md"


def test_page_is_current():
    """If this fails: python -m hil.wire.generate.docs docs"""
    assert PAGE.read_text(encoding="utf-8") == docs.render()


def test_the_state_table_in_the_safety_page_is_current():
    """If this fails: python -m hil.wire.generate.docs docs"""
    page = (PAGES / "safety.md").read_text(encoding="utf-8")
    assert docs.state_table() in page
    assert docs.with_state_table(page) == page


def test_the_published_field_table_is_the_one_that_is_hashed():
    """If this fails: python -m hil.wire.generate.docs docs"""
    file = (PAGES / "reference" / "field-table.tsv").read_bytes()
    assert crc32c(file) == SPEC.hash
    lines = file.decode().split("\n")
    assert lines == [entry.text for entry in SPEC.table]
    assert all(line.count("\t") == 3 for line in lines)


def test_what_changed_is_told_of_every_protocol_number():
    """The page beside the spec: a new number, or a new hash, needs a row and a section of what a board has to do."""
    page = (PAGES / "reference" / "wire-changes.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and "`0x" in line]
    assert rows[-1].startswith(f"| {SPEC.protocol} | `{SPEC.hash:#010x}` | {len(SPEC.table)} |")
    for number in range(1, SPEC.protocol):
        assert f"## {number} → {number + 1}\n" in page


def test_page_has_every_name():
    page = docs.render()
    fields = [field.name for message in SPEC.messages.values() for field in (*message.fields, *message.rows)]
    members = [member for enum in SPEC.enums.values() for member in enum.members]
    for name in (*SPEC.messages, *SPEC.registers, *SPEC.enums, *fields, *members):
        assert name in page
