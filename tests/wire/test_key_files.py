"""docs/security.md, key files: whose they are, how they are opened, and what is left where one could not be written."""

import errno
import os
import stat
from pathlib import Path
from typing import Any

import pytest

from hil.wire import key_file
from hil.wire.errors import LinkError
from hil.wire.key_file import as_c, make_key, read_key

KEY = bytes(range(32))


@pytest.mark.parametrize("mask", [0o000, 0o277])
def test_whatever_the_umask_its_owner_may_read_and_write_it(tmp_path: Path, mask: int) -> None:
    before = os.umask(mask)
    try:
        make_key(tmp_path / "a.key")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.key").stat().st_mode) == 0o600


def test_a_key_is_on_the_disk_before_it_is_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda fd: held.append((tmp_path / "a.key").read_text()))
    key = make_key(tmp_path / "a.key")
    assert held == [f"gyrohil-key-1 {key.hex()}\n"]


def test_of_a_key_that_could_not_be_written_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LinkError, match=r"a\.key: No space left on device; nothing was left there"):
        make_key(tmp_path / "a.key")
    assert not list(tmp_path.iterdir())


def written(path: Path, text: str, mode: int = 0o600) -> Path:
    path.write_text(text, encoding="ascii")
    path.chmod(mode)
    return path


@pytest.mark.parametrize("end", ["\n", ""])
@pytest.mark.parametrize("digits", [KEY.hex(), KEY.hex().upper()])
def test_a_key_is_read_with_or_without_a_line_end_in_either_case(tmp_path: Path, digits: str, end: str) -> None:
    assert read_key(written(tmp_path / "a.key", f"gyrohil-key-1 {digits}{end}")) == KEY


@pytest.mark.parametrize(
    "text", [f"gyrohil-key-1 {KEY.hex()}\n\n", f" gyrohil-key-1 {KEY.hex()}", f"gyrohil-key-1 {KEY.hex()[1:]}"]
)
def test_anything_more_or_less_is_no_key(tmp_path: Path, text: str) -> None:
    with pytest.raises(LinkError, match="expected one line, gyrohil-key-1 and 64 hexadecimal digits; make one"):
        read_key(written(tmp_path / "a.key", text))


class Owned:
    """The module `os`, but for whose a file is."""

    def __init__(self, about: os.stat_result) -> None:
        self.fstat = lambda _: about

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)


@pytest.mark.parametrize(
    ("owner", "ours", "taken"), [(1000, 1000, True), (0, 1000, True), (1000, 1001, False), (1, 1000, False)]
)
def test_it_is_its_readers_or_the_administrators(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, owner: int, ours: int, taken: bool
) -> None:
    path = written(tmp_path / "a.key", f"gyrohil-key-1 {KEY.hex()}\n")
    about = os.stat_result((*path.stat()[:4], owner, *path.stat()[5:10]))
    monkeypatch.setattr(key_file, "os", Owned(about))
    monkeypatch.setattr(os, "geteuid", lambda: ours)
    if taken:
        assert read_key(path) == KEY
    else:
        with pytest.raises(LinkError, match="belongs to another user; make one of your own with `hil key FILE`"):
            read_key(path)


def test_a_pipe_is_no_file_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    with pytest.raises(LinkError, match="not a file; make one with `hil key FILE`"):
        read_key(tmp_path / "pipe")


def test_a_key_in_c_is_four_rows_of_eight_bytes() -> None:
    rows = [
        "    0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07,",
        "    0x08, 0x09, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F,",
        "    0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x16, 0x17,",
        "    0x18, 0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x1E, 0x1F,",
    ]
    assert as_c(KEY) == "static const uint8_t key[32] = {\n" + "\n".join(rows) + "\n};\n"
