"""A write that fails once: the block is written when there is room again, or nothing follows what is torn."""

import errno
from pathlib import Path

import numpy as np
import pytest

from hil.records.blocks import read_blocks
from hil.records.check import check
from hil.records.layout import TICK, Column, Layout
from hil.records.stream import BlockWriter

LAYOUT = Layout("timing", (TICK, Column("value", "f8")), 64, {"tick_rate_Hz": 1000.0})
FULL = OSError(errno.ENOSPC, "No space left on device")


class FailingFile:
    """A raw file that takes half of one write and has no room for the rest."""

    def __init__(self, file, at: int, *, torn: bool) -> None:
        self._file, self._left, self._torn = file, at, torn

    def write(self, data) -> int:
        self._left -= 1
        if self._left == 0:
            return self._file.write(data[: len(data) // 2])
        if self._left == -1:
            raise FULL
        return self._file.write(data)

    def truncate(self, size: int) -> int:
        if self._torn:
            raise FULL
        return self._file.truncate(size)

    def __getattr__(self, name: str):
        return getattr(self._file, name)


def rows(start: int, stop: int):
    made = np.zeros(stop - start, LAYOUT.dtype)
    made["tick"] = np.arange(start, stop)
    return made


@pytest.mark.parametrize("at", [1, 2, 3])
@pytest.mark.parametrize("torn", [False, True])
def test_what_follows_a_write_that_failed(tmp_path: Path, at: int, torn: bool) -> None:
    path = tmp_path / "timing.arrow"
    writer = BlockWriter(path, LAYOUT)
    writer._file = FailingFile(writer._file, at, torn=torn)
    writer.push(rows(0, 64 * (at - 1)))
    with pytest.raises(OSError, match="No space left"):
        writer.push(rows(64 * (at - 1), 64 * at))
    if torn:
        with pytest.raises(OSError, match="No space left"):
            writer.close()
    else:
        writer.close()
    whole = 64 * (at - 1 if torn else at)
    found = read_blocks(path, "timing")
    assert found.complete is not torn
    assert found.columns["tick"].tolist() == list(range(whole))
    (checked,) = check(path)
    assert not any("damaged" in problem for problem in checked.problems)
