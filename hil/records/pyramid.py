"""Lowest and highest values of a long record over stretches of bench time, so that any part of it is drawn at once.

Beside `capture.arrow` lie `pyramid/capture-256.arrow` and `pyramid/capture-16384.arrow`: record files, with the same
blocks and checksums, of one row for each so many samples. The writer of a record writes them along (`Pyramid`), or
they are made of it afterwards (`build`). They are derived: what goes wrong with them leaves the record alone, and a
record without them is only slower to look at.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.direct import DirectRecord
from hil.records.layout import TICK, Column, Layout
from hil.records.stream import BlockWriter

WIDTHS = (256, 16_384)
"""Samples of the record to a row, level by level; each is a multiple of the one before."""
KINDS = ("capture", "innovation", "estimates")
"""Records that are drawn over time, their ticks ascending."""
SHORT_ROWS = 1 << 20
"""A record of no more is drawn from its own rows, and has no pyramid."""

_GATHERED = 4096  # rows that are looked at together
_BLOCK_ROWS = 1024
_BUILD_ROWS = 1 << 18
_NOT_DRAWN = ("tick", "flags", "status")
_MOST_ANSWERS = 256
_ANSWERS: dict[tuple[object, object], bool] = {}


class Stretches(NamedTuple):
    """Lowest and highest value of each column over stretches, (n,) each, and the number of each stretch."""

    number: npt.NDArray[np.int64]
    low: dict[str, npt.NDArray[Any]]
    high: dict[str, npt.NDArray[Any]]

    @property
    def size(self) -> int:
        return int(self.number.size)


def drawn(layout_columns: Mapping[str, Any]) -> list[str]:
    """The columns of a record that are drawn over time."""
    return [name for name in layout_columns if name not in _NOT_DRAWN]


def folded(found: Stretches, ratio: int) -> Stretches:
    """The same over stretches that are `ratio` times as long; numbers ascend. A value that is no number counts only
    where there is no other."""
    number = found.number // ratio
    if not number.size:
        return found._replace(number=number)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1])
    return Stretches(
        number[starts],
        {name: np.fmin.reduceat(values, starts) for name, values in found.low.items()},
        {name: np.fmax.reduceat(values, starts) for name, values in found.high.items()},
    )


def joined(parts: list[Stretches]) -> Stretches:
    """One after another; a stretch that two neighbours share stays two rows, which `folded` by 1 makes one."""
    return Stretches(
        np.concatenate([part.number for part in parts]),
        {name: np.concatenate([part.low[name] for part in parts]) for name in parts[0].low},
        {name: np.concatenate([part.high[name] for part in parts]) for name in parts[0].high},
    )


class Pyramid:
    """Writes the levels of one record beside it while its rows are told; nothing before it is a long one.

    It never raises for the sake of a file: one that cannot be written is given up, with what there is of it.
    """

    def __init__(self, record: Path, layout: Layout) -> None:
        self._folder, self._stem = record.parent / "pyramid", record.stem
        self._every = int(layout.header.get("every", 1))
        self._names = drawn({column.name: None for column in layout.columns})
        self._layouts = [_level_layout(layout, self._names, width * self._every) for width in WIDTHS]
        self._gathered: list[npt.NDArray[np.void]] = []  # with those of the coarsest stretch at hand
        self._fresh = self._rows = 0  # not looked at; in whole stretches
        self._done: tuple[list[Stretches], ...] = tuple([] for _ in WIDTHS)  # and not written
        self._writers: list[BlockWriter] = []
        self._failed = False
        self._guarded(self._clear)

    def push(self, rows: npt.NDArray[np.void]) -> None:
        """Take rows of the record's dtype, which follow those before."""
        if not rows.size or self._failed:
            return
        self._gathered.append(rows)
        self._fresh += rows.size
        if self._fresh >= _GATHERED:
            self._guarded(self._look)

    def close(self) -> None:
        """The record has ended well. May be called again."""
        self._guarded(lambda: self._end(well=True))

    def abandon(self) -> None:
        self._guarded(lambda: self._end(well=False))

    def _guarded(self, act: Callable[[], None]) -> None:
        if self._failed:
            return
        try:
            act()
        except OSError:
            self._failed = True
            for writer in self._writers:
                with suppress(OSError):
                    writer.abandon()
            with suppress(OSError):
                self._clear()

    def _clear(self) -> None:
        for width in WIDTHS:
            level_path(self._folder, self._stem, width).unlink(missing_ok=True)
        with suppress(OSError):  # not there, or of other records too
            self._folder.rmdir()

    def _look(self, *, last: bool = False) -> None:
        """Fold what nothing can be added to: all in stretches of the greatest length that are whole."""
        rows = np.concatenate(self._gathered)
        tick = rows["tick"].astype(np.int64)
        stretch = tick // (WIDTHS[-1] * self._every)
        whole = rows.size if last else int(np.searchsorted(stretch, stretch[-1]))
        self._gathered, self._fresh, self._rows = [rows[whole:]], 0, self._rows + whole
        columns = {name: np.ascontiguousarray(rows[name][:whole]) for name in self._names}
        found, before = Stretches(tick[:whole] // self._every, columns, columns), 1
        for width, done in zip(WIDTHS, self._done, strict=True):
            found, before = folded(found, width // before), width
            done.append(found)
        if self._rows <= SHORT_ROWS:
            return
        if not self._writers:
            self._folder.mkdir(exist_ok=True)
            paths = [level_path(self._folder, self._stem, width) for width in WIDTHS]
            self._writers = [BlockWriter(path, layout) for path, layout in zip(paths, self._layouts, strict=True)]
        for writer, done in zip(self._writers, self._done, strict=True):
            writer.push(_rows_of(joined(done), writer.layout))
            done.clear()

    def _end(self, *, well: bool) -> None:
        if self._gathered:
            self._look(last=True)
        for writer in self._writers:
            writer.close() if well else writer.abandon()


def _rows_of(found: Stretches, layout: Layout) -> npt.NDArray[np.void]:
    rows = np.empty(found.size, layout.dtype)
    rows["tick"] = found.number * layout.header["width"]
    for name, values in found.low.items():
        rows[f"{name}_min"], rows[f"{name}_max"] = values, found.high[name]
    return rows


def level_path(folder: Path, stem: str, width: int) -> Path:
    return folder / f"{stem}-{width}.arrow"


def build(record: Path, told: Callable[[int, int], None] = lambda done, total: None) -> None:
    """Make the pyramid of a finished record at `record`, in pieces; `told` rows done, and of how many.

    Nothing is made of a short one. Raises InputError for what is no record, and for one that is damaged.
    """
    with DirectRecord(record) as source:
        kind = str(source.header["kind"])
        if kind not in KINDS:
            raise InputError(f"{record}: a record of {kind}, which is not drawn over time; give one of {KINDS}")
        names = list(source.dtypes)
        layout = _layout_of(source)
        pyramid = Pyramid(record, layout)
        try:
            for start in range(0, source.rows, _BUILD_ROWS):
                columns = source.read(names, start, start + _BUILD_ROWS)
                rows = np.empty(len(columns["tick"]), layout.dtype)
                for name, values in columns.items():
                    rows[name] = values
                pyramid.push(rows)
                told(start + rows.size, source.rows)
        except BaseException:
            pyramid._guarded(pyramid._clear)
            raise
        pyramid.close()


def levels_of(record: Path, source: DirectRecord) -> list[DirectRecord]:
    """The levels there are of an open record, finest first, none that is of another; the caller closes them."""
    found: list[DirectRecord] = []
    for width in WIDTHS:
        path = level_path(record.parent / "pyramid", record.stem, width)
        with suppress(InputError):
            level = DirectRecord(path, "pyramid")
            if level.rows and _known_to_belong(level, source):
                found.append(level)
            else:
                level.close()
    return found


def _known_to_belong(level: DirectRecord, source: DirectRecord) -> bool:
    """`_belongs`, asked once as long as neither file changes."""
    asked = (level.stamp, source.stamp)
    if (known := _ANSWERS.get(asked)) is None:
        if len(_ANSWERS) >= _MOST_ANSWERS:
            _ANSWERS.clear()
        known = _ANSWERS[asked] = _belongs(level, source)
    return known


def _belongs(level: DirectRecord, source: DirectRecord) -> bool:
    """Whether a level speaks of this record: of its columns, its first stretch, and no ticks beyond its end."""
    names = drawn(source.dtypes)
    if [f"{name}_{side}" for name in names for side in ("min", "max")] != list(level.dtypes)[1:] or not source.rows:
        return False
    width = int(level.header["width"])
    first = level.read(list(level.dtypes), 0, 1)
    if int(first["tick"][0]) != source.tick_at(0) // width * width or level.tick_at(-1) > source.tick_at(-1):
        return False
    if level.complete and level.tick_at(-1) + width <= source.tick_at(-1):
        return False
    rows = source.read(names, 0, source.row_of(int(first["tick"][0]) + width))
    return all(
        np.fmin.reduce(values) == first[f"{name}_min"][0] and np.fmax.reduce(values) == first[f"{name}_max"][0]
        for name, values in rows.items()
        if not np.isnan(values).all()
    )


def _level_layout(layout: Layout, names: list[str], width: int) -> Layout:
    columns = [TICK]
    for column in layout.columns:
        if column.name in names:
            columns += [column._replace(name=f"{column.name}_{side}") for side in ("min", "max")]
    header = {"of": layout.kind, "tick_rate_Hz": layout.header["tick_rate_Hz"], "width": width}
    return Layout("pyramid", tuple(columns), _BLOCK_ROWS, header)


def _layout_of(source: DirectRecord) -> Layout:
    told = source.header["columns"]
    columns = tuple(
        Column(name, dtype.str[1:], told[name]["unit"], told[name]["scale"], told[name].get("clock", ""))
        for name, dtype in source.dtypes.items()
    )
    header = {name: source.header[name] for name in ("tick_rate_Hz", "every") if name in source.header}
    return Layout(str(source.header["kind"]), columns, source.block_rows, header)
