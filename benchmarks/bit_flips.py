"""Single changed bits in the record files of a run: every one must be told, with file and block.

A run of the example s-slow is made in lockstep, with its truth. Then, one at a time, a bit anywhere in one of its
record files is changed, header and end included, and the file is read as every verb reads it. Which file and which bit
is drawn with a seed, files by their length.
"""

import re
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.row import Row
from hil.bench import load_bench, override
from hil.bench.examples import find
from hil.boards.emulation import located
from hil.errors import InputError
from hil.records.blocks import read_blocks
from hil.records.check import check
from hil.running.request import RunRequest
from hil.running.run import run

_FLIPS = 1000
_SEED = 20_261
_SECONDS = 12.0
_ONE_LINE = re.compile(r"[^\n]*\.arrow: (block \d+[^\n]* is damaged|no \w+ record: [^\n]*cut inside its header)[^\n]*")


def rows(say: Callable[[str], None]) -> list[Row]:
    """Share of changed bits that were told."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        say("a run of s-slow in lockstep")
        files = [*sorted(_run(place).glob("*.arrow")), place / "truth.arrow"]
        whole = {path: path.read_bytes() for path in files}
        for path in files:
            assert check(path)[0].whole
        say(f"{_FLIPS} bits in {len(files)} files, {sum(map(len, whole.values())) / 1e6:.1f} MB")
        told = by_check = 0
        rng = np.random.default_rng(_SEED)
        shares = np.array([len(data) for data in whole.values()], float)
        for _ in range(_FLIPS):
            path = files[rng.choice(len(files), p=shares / shares.sum())]
            place_of_bit = int(rng.integers(8 * len(whole[path])))
            changed = bytearray(whole[path])
            changed[place_of_bit // 8] ^= 1 << place_of_bit % 8
            path.write_bytes(changed)
            told += _told(path)
            by_check += _told_by_check(path)
            path.write_bytes(whole[path])
    return [
        Row("changed bits told by whoever reads the file", told, f"of {_FLIPS}"),
        Row("changed bits told by hil check", by_check, f"of {_FLIPS}"),
    ]


def _run(place: Path) -> Path:
    changes = {"loop": {"clock": "lockstep", "duration_s": _SECONDS}}
    bench = override(load_bench(find("bench", "s-slow")), changes, "s-slow")
    link = located("inproc:s-slow")
    done = run(RunRequest(bench, link, truth=place / "truth.arrow"), place / "runs", progress=lambda _: None)
    assert done.folder is not None
    return done.folder


def _told(path: Path) -> bool:
    try:
        read_blocks(path, path.stem)
    except InputError as error:
        return _ONE_LINE.fullmatch(str(error)) is not None
    return False


def _told_by_check(path: Path) -> bool:
    try:
        return not check(path)[0].whole
    except InputError as error:
        return _ONE_LINE.fullmatch(str(error)) is not None
