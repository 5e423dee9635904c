"""The committed page is the one the spec makes."""

from pathlib import Path

from hil.wire import docs
from hil.wire.spec import SPEC

PAGE = Path(__file__).parents[2] / "docs" / "wire.md"


def test_page_is_current():
    """If this fails: python -m hil.wire.docs docs/wire.md"""
    assert PAGE.read_text(encoding="utf-8") == docs.render()


def test_page_has_every_name():
    page = docs.render()
    fields = [field.name for message in SPEC.messages.values() for field in (*message.fields, *message.rows)]
    members = [member for enum in SPEC.enums.values() for member in enum.members]
    for name in (*SPEC.messages, *SPEC.registers, *SPEC.enums, *fields, *members):
        assert name in page
