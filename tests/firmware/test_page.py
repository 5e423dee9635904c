"""docs/connect-your-board.md says what is there: its C is that of the example, its files and commands exist."""

import re
from pathlib import Path

import numpy as np

from hil.wire.messages import DriveForce
from hil.wire.sense import Sense
from hil.wire.stream import Transmitter

TREE = Path(__file__).parents[2]
PAGE = (TREE / "docs" / "connect-your-board.md").read_text(encoding="utf-8")


def test_its_c_is_in_the_example() -> None:
    example = [line.strip() for line in (TREE / "firmware" / "examples" / "bare_board.c").read_text().splitlines()]
    shown = [
        line.strip() for line in PAGE.splitlines() if line.startswith("    ") and line.rstrip().endswith((";", "*/"))
    ]
    assert len(shown) >= 11
    for line in shown:
        assert line in example


def test_its_files_exist() -> None:
    for link in re.findall(r"\]\(([^)#]+)", PAGE):
        assert (TREE / "docs" / link).exists(), link
    for name in re.findall(r"`((?:firmware|tests|hil|examples)/[\w./-]+)`", PAGE):
        assert (TREE / name).exists(), name


def test_its_functions_exist() -> None:
    sources = "".join(path.read_text() for path in (TREE / "firmware").rglob("*.[ch]"))
    for name in re.findall(r"`(hil_\w+)`", PAGE):
        assert name in sources


def test_its_frame_sizes_are_right() -> None:
    """Of codes and ticks without a zero byte in them."""
    tx = Transmitter()
    tx.seq = 0x0101
    row = tx.encode(Sense(np.array([(1000, -2000, 300, -400)], np.int32), 2, 0), 0x01010101)
    drive = tx.encode(DriveForce(300, -400, 0x01010102), 0x01010101)
    sizes = re.search(r"goes out in (\d+) bytes .* comes back in (\d+)", PAGE)
    assert sizes is not None
    assert [int(size) for size in sizes.groups()] == [len(row), len(drive)]
