"""Of the pages of the wire, what goes beyond the parts that are generated."""

from pathlib import Path

from crc32c import crc32c

from hil.wire.spec import SPEC

PAGES = Path(__file__).parents[2] / "docs"


def test_the_published_field_table_is_the_one_that_is_hashed():
    file = (PAGES / "reference" / "field-table.tsv").read_bytes()
    assert crc32c(file) == SPEC.hash
    assert all(line.count("\t") == 3 for line in file.decode().split("\n"))


def test_what_changed_is_told_of_every_protocol_number():
    """The page beside the spec: a new number, or a new hash, needs a row and a section of what a board has to do."""
    page = (PAGES / "reference" / "wire-changes.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and "`0x" in line]
    assert rows[-1].startswith(f"| {SPEC.protocol} | `{SPEC.hash:#010x}` | {len(SPEC.table)} |")
    for number in range(1, SPEC.protocol):
        assert f"## {number} → {number + 1}\n" in page


def test_page_has_every_name():
    page = (PAGES / "wire.md").read_text(encoding="utf-8")
    fields = [field.name for message in SPEC.messages.values() for field in (*message.fields, *message.rows)]
    members = [member for enum in SPEC.enums.values() for member in enum.members]
    for name in (*SPEC.messages, *SPEC.registers, *SPEC.enums, *fields, *members):
        assert name in page
