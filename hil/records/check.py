"""Whether records are what was written, whole, and agree with each other; and what can be kept of others."""

import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hil.errors import InputError
from hil.records.atomic import is_sealed, read_json, replacing
from hil.records.blocks import Scan, StoredColumns, pieces_of, scan_blocks
from hil.records.capture import missing
from hil.records.result import load_result
from hil.records.runfolder import RunFolder
from hil.records.table import cut_after

STEMS = ("capture", "innovation", "estimates", "board_estimates", "covariance", "timing", "clock")
"""Record files of a run, by stem."""
_KINDS = {"board_estimates": "estimates"}  # what a file holds that is not called so
_MADE_FROM_THEM = ("result.json", "report.html")
_UNSEALED = "without a checksum: a changed figure would not show"
_STEADY = ("capture", "innovation", "estimates")


@dataclass
class Checked:
    """What was found of one file. `problems` speak against it, `remarks` do not; each is one line."""

    name: str
    rows: int = 0
    seconds: float = 0.0
    complete: bool = False
    lost: int = 0
    gaps: int = 0
    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    scan: Scan | None = None

    @property
    def whole(self) -> bool:
        return not self.problems

    def figures(self) -> dict[str, Any]:
        names = ("name", "rows", "seconds", "complete", "lost", "gaps", "problems", "remarks")
        return {"whole": self.whole} | {name: getattr(self, name) for name in names}


def check(place: Path) -> list[Checked]:
    """Check a record file, or all files of a run folder and that they agree.

    Raises InputError where there is no record at all.
    """
    if not place.is_dir():
        return [_record(place)]
    found = [_tolerant(place / f"{stem}.arrow") for stem in STEMS if (place / f"{stem}.arrow").exists()]
    if not found:
        raise InputError(f"{place}: no record in it; give a run folder, or a capture")
    _compare(found)
    return found + list(_texts(place, found))


def repair(place: Path, out: Path | None = None) -> Path:
    """Keep every whole block: a new file `<stem>.repaired.arrow` or folder `<run>-repaired`, or `out`; returns it.

    The original stays as it is. A repaired record has no end marker: it reads as interrupted. A new folder has no
    result.json and no report.html, which spoke of other records. Raises InputError when nothing can be kept, nothing
    is to be repaired, or the target exists.
    """
    checked = check(place)
    if all(
        entry.scan is not None and not entry.scan.damage and entry.complete for entry in checked if _is_record(entry)
    ):
        raise InputError(f"{place}: every block is whole; there is nothing to repair")
    name = f"{place.name}-repaired" if place.is_dir() else f"{place.stem}.repaired{place.suffix}"
    target = out or place.resolve().parent / name
    if target.exists():
        raise InputError(f"{target}: exists already; give another --out, or remove it")
    if not place.is_dir():
        _keep(checked[0].scan, place, target)
        return target
    target.mkdir(parents=True)
    for path in sorted(place.iterdir()):
        entry = next((entry for entry in checked if entry.name == path.name and _is_record(entry)), None)
        if path.is_dir() or path.name in _MADE_FROM_THEM or (entry is not None and entry.scan is None):
            continue
        if entry is None:
            shutil.copyfile(path, target / path.name)
        else:
            _keep(entry.scan, path, target / path.name)
    return target


def _is_record(entry: Checked) -> bool:
    return entry.name.endswith(".arrow")


def _keep(scan: Scan | None, path: Path, target: Path) -> None:
    if scan is None or (scan.damage and not scan.blocks):
        raise InputError(f"{path}: no block of it is whole; restore it from a copy")
    left = scan.size if scan.damage or not scan.complete else path.stat().st_size
    with replacing(target) as part, path.open("rb") as source, part.open("wb") as copy:
        while left:
            left -= copy.write(source.read(min(left, 1 << 20)))


def _tolerant(path: Path) -> Checked:
    try:
        return _record(path)
    except InputError as error:
        return Checked(path.name, problems=[str(error).removeprefix(f"{path}: ")])


def _record(path: Path) -> Checked:
    kind = _KINDS.get(path.stem, path.stem)
    scan = scan_blocks(path, kind if path.stem in STEMS else None)
    found = Checked(path.name, scan.rows, complete=scan.complete, scan=scan)
    if scan.damage:
        found.problems.append(scan.damage)
    elif not scan.complete:
        found.problems.append(cut_after(scan.rows))
    _count(found, scan)
    return found


def _count(found: Checked, scan: Scan) -> None:
    """Length and gaps, by the column of ticks."""
    if "tick" not in scan.dtypes or not scan.rows:
        return
    every = int(scan.header.get("every", 1))
    back, last, first = 0, None, 0
    for _, columns in pieces_of(StoredColumns(scan, 0, scan.rows)):
        tick = columns["tick"]
        if last is None:
            first = int(tick[0])
        steps = np.diff(tick, prepend=tick[:1] - every if last is None else last)
        back += int(np.count_nonzero(steps <= 0))
        if scan.header.get("kind") in ("capture", "innovation"):
            found.gaps += int(np.count_nonzero(steps > 1))
            found.lost += int(np.sum(steps[steps > 1] - 1))
        last = tick[-1]
    rate = float(scan.header.get("tick_rate_Hz", scan.header.get("sample_rate_Hz", 0.0)))
    found.seconds = (int(last) - first) / rate if rate and last is not None else 0.0
    if back and scan.header.get("kind") in _STEADY:
        found.problems.append(f"{back} rows do not come after the one before them")
    if found.gaps:
        found.remarks.append(missing(found.lost, found.gaps))


def _compare(found: list[Checked]) -> None:
    """Files of one run have one rate, and what was estimated lies within what was captured."""
    scans = {entry.name.removesuffix(".arrow"): entry for entry in found if entry.scan is not None and entry.rows}
    capture = scans.get("capture")
    if capture is None:
        return
    low, high = _span(capture)
    rate = _rate(capture)
    for stem, entry in scans.items():
        if abs(_rate(entry) / rate - 1.0) > 1e-3:
            entry.problems.append(f"of {_rate(entry):g} samples a second, the capture of {rate:g}: of another run")
        elif stem in _STEADY:
            first, last = _span(entry)
            if first < low or (last > high and capture.complete):
                entry.problems.append(
                    f"ticks {first} to {last}, the capture {low} to {high}: of another run, or rows of one are missing"
                )


def _texts(folder: Path, found: list[Checked]) -> Iterator[Checked]:
    """The bench file as run, and the figures beside the record they speak of."""
    bench = folder / "bench.toml"
    if bench.exists():
        yield _bench(bench, sealed=_carries_seal(folder / "result.json"))
    path = folder / "result.json"
    if not path.exists():
        return
    entry = Checked(path.name, complete=True)
    capture = next((other for other in found if other.name == "capture.arrow" and other.scan is not None), None)
    if capture is not None and capture.scan is not None and capture.scan.damage:
        capture = None  # that it now has fewer rows says nothing of the figures
    try:
        result = load_result(path)
    except InputError as error:
        entry.problems.append(str(error).removeprefix(f"{path}: "))
    else:
        if not _carries_seal(path):
            entry.remarks.append(_UNSEALED)
        if capture is not None and result.samples != capture.rows:
            entry.problems.append(f"speaks of {result.samples} samples, the capture has {capture.rows}: of another run")
        elif capture is not None and result.complete and not capture.complete:
            entry.problems.append("speaks of a complete record, the capture is not")
    yield entry


def _bench(path: Path, *, sealed: bool) -> Checked:
    """The bench file as run; `sealed` where the figures beside it are, so that it must be."""
    entry = Checked(path.name, complete=True)
    try:
        tomllib.loads(RunFolder(path.parent).bench_text)
    except InputError as error:
        entry.problems.append(str(error).removeprefix(f"{path}: "))
    except (ValueError, RecursionError) as error:
        entry.problems.append(f"not TOML ({error})")
    if not _carries_seal(path):
        (entry.problems if sealed else entry.remarks).append(_UNSEALED)
    return entry


def _carries_seal(path: Path) -> bool:
    try:
        return is_sealed(read_json(path))
    except OSError:
        return False


def _span(entry: Checked) -> tuple[int, int]:
    assert entry.scan is not None
    columns = StoredColumns(entry.scan, 0, entry.scan.rows)
    ends = columns.part(0, 1)["tick"], columns.part(entry.scan.rows - 1, entry.scan.rows)["tick"]
    return int(ends[0][0]), int(ends[1][0])


def _rate(entry: Checked) -> float:
    assert entry.scan is not None
    return float(entry.scan.header.get("tick_rate_Hz", 0.0)) or 1.0
