"""The committed C files are the ones the spec makes."""

from pathlib import Path

from hil.wire.generate import c_header
from hil.wire.spec import SPEC

SOURCES = Path(__file__).parents[2] / "firmware" / "src"


def test_files_are_current() -> None:
    """If this fails: python -m hil.wire.generate.c_header firmware/src"""
    assert (SOURCES / "hil_spec.h").read_text(encoding="utf-8") == c_header.header()
    assert (SOURCES / "hil_spec.c").read_text(encoding="utf-8") == c_header.source()


def test_header_has_every_name() -> None:
    header = c_header.header()
    names = [f"HIL_TYPE_{name}" for name in SPEC.messages]
    names += [f"HIL_REGISTER_{name}" for name in SPEC.registers]
    names += [field.name for message in SPEC.messages.values() for field in message.fields]
    names += [f"_{member} =" for enum in SPEC.enums.values() for member in enum.members]
    for name in names:
        assert name in header
