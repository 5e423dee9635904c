"""Windows of recorded rows over bench time, lowest and highest value per pixel, whatever the record's length.

A window is read from the rows themselves, or from the pyramid beside them (`hil.records.pyramid`), whichever is less
to read and exact: a bucket is a whole number of the stretches that it is read from.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.direct import DirectRecord
from hil.records.frame import Frame
from hil.records.pyramid import KINDS, SHORT_ROWS, Stretches, drawn, folded, joined, levels_of

MOST_POINTS = 20_000
_READ_ROWS = 1 << 18
_AT_ONCE = 4 * SHORT_ROWS
_COARSER = 4
"""A bucket may be longer than asked for by one part in so many, to be a whole number of stretches."""

Floats = npt.NDArray[np.float32]


class PyramidNeeded(InputError):
    """So much would have to be read that its pyramid has to be made first; `record` is its file."""

    def __init__(self, record: Path) -> None:
        super().__init__(f"{record.parent.name}: too long to be drawn before its pyramid is made; ask again soon")
        self.record = record


class Channel(NamedTuple):
    """What can be drawn: its name as in the library, `capture.vx_V`; unit; rows; bench time of the first and last."""

    name: str
    unit: str
    rows: int
    from_s: float
    to_s: float


def channels(folder: Path) -> list[Channel]:
    """What the records of a run folder hold that can be drawn."""
    found = []
    with ExitStack() as stack:
        for one in _records(folder, stack):
            ends = one.ends_s
            found += [
                Channel(f"{one.kind}.{name}", shown.unit, one.source.rows, *ends) for name, shown in one.shown.items()
            ]
    return found


@np.errstate(all="ignore")  # an observer that diverged is drawn as what it is
def window(
    folder: Path, names: Sequence[str], from_s: float | None = None, to_s: float | None = None, points: int = 800
) -> Frame:
    """At most `points` buckets of the channels `names` over bench time from_s … to_s, by default the whole run.

    Raises InputError for what the run does not have, PyramidNeeded where it is long and has no pyramid.
    """
    if not 1 <= points <= MOST_POINTS:
        raise InputError(f"points: {points}; give 1 to {MOST_POINTS}")
    with ExitStack() as stack:
        records = {one.kind: one for one in _records(folder, stack)}
        asked: dict[str, list[str]] = {}
        for name in names:
            kind, _, column = name.partition(".")
            if kind not in records or column not in records[kind].shown:
                raise InputError(f"{name}: no such channel of {folder.name}; its channels are listed")
            asked.setdefault(kind, []).append(column)
        if not asked:
            raise InputError("channels: none given; their names are listed")
        used = [records[kind] for kind in asked]
        low_s, high_s = _limits(used, from_s, to_s)
        if not all(one.uniform for one in used):
            grid = _Grid.by_time(low_s, high_s, points)
            read = {one.kind: one.rows_over(grid, asked[one.kind]) for one in used}
        else:
            grid, depths = _chosen(used, low_s, high_s, points)
            read = {one.kind: one.over(grid, asked[one.kind], depths[one.kind]) for one in used}
        return _framed(names, records, read, grid)


class Shown(NamedTuple):
    """Where a channel comes from: column of the file, what one count of it is, unit."""

    column: str
    scale: float
    unit: str


@dataclass(frozen=True)
class _Grid:
    """Buckets of `step` ticks from number `first` on; without ticks, of `step_s` from `origin_s` on."""

    first: int
    count: int
    step: int
    origin_s: float
    step_s: float

    @classmethod
    def by_time(cls, low_s: float, high_s: float, points: int) -> "_Grid":
        return cls(0, points, 0, low_s, max((high_s - low_s) / points, 1e-12) * (1 + 1e-12))

    @property
    def begin_s(self) -> float:
        return self.origin_s + self.first * self.step_s


class _Record:
    """One record file of a run and its pyramid."""

    def __init__(self, source: DirectRecord, stack: ExitStack) -> None:
        self.source = source
        self.kind = str(source.header["kind"])
        self.every = int(source.header.get("every", 1))
        self.rate_Hz = float(source.header["tick_rate_Hz"])
        self.uniform = bool(source.header.get("uniform", True))
        told = {column: source.header["columns"][column] for column in drawn(source.dtypes)}
        self.shown = dict(shown(self.kind, told))
        self.levels = levels_of(source.path, source)
        for level in self.levels:
            stack.callback(level.close)
        self.origin_s = 0.0
        if "t_s" in source.dtypes and source.rows:
            first = source.read(["tick", "t_s"], 0, 1)
            self.origin_s = float(first["t_s"][0]) - int(first["tick"][0]) / self.rate_Hz

    @property
    def ends_s(self) -> tuple[float, float]:
        if not self.source.rows:
            return 0.0, 0.0
        if not self.uniform:
            ends = [float(self.source.read(["t_s"], row, row + 1)["t_s"][0]) for row in (0, self.source.rows - 1)]
            return ends[0], ends[1]
        first, last = (self.source.tick_at(row) for row in (0, -1))
        return self.origin_s + first / self.rate_Hz, self.origin_s + last / self.rate_Hz

    @property
    def widths(self) -> list[int]:
        """Ticks to a row: of the record itself, then of its levels."""
        return [1, *(int(level.header["width"]) for level in self.levels)]

    def over(self, grid: _Grid, names: list[str], depth: int) -> Stretches:
        """The buckets of a grid, read from a level and, where that ends, from what is finer."""
        at, stop = grid.first * grid.step, (grid.first + grid.count) * grid.step
        columns = [self.shown[name].column for name in names]
        parts = []
        for level in range(depth, -1, -1):
            source = self.levels[level - 1] if level else self.source
            for tick, low, high in _pieces(source, columns, at, stop, level=level > 0):
                parts.append(folded(Stretches(tick, low, high), grid.step))
                at = int(tick[-1]) + self.widths[level]
        return folded(joined(parts), 1) if parts else _nothing(columns)

    def rows_over(self, grid: _Grid, names: list[str]) -> Stretches:
        """The same by the time of each row."""
        if self.source.rows > _AT_ONCE:
            raise InputError(f"{self.source.path}: an uneven record of {self.source.rows} rows, too long to be drawn")
        columns = [self.shown[name].column for name in names]
        timed = [name for name in ("tick", "t_s") if name in self.source.dtypes]
        read = self.source.read([*columns, *timed], 0, self.source.rows)
        t_s = read["t_s"] if "t_s" in read else read["tick"] / self.rate_Hz
        number = np.floor((t_s - grid.origin_s) / grid.step_s).astype(np.int64)
        rows = {name: read[name] for name in columns}
        return folded(Stretches(number, rows, rows), 1)


def _pieces(
    source: DirectRecord, columns: list[str], first_tick: int, stop_tick: int, *, level: bool
) -> Iterator[tuple[npt.NDArray[np.int64], dict[str, Any], dict[str, Any]]]:
    """Ticks, lowest and highest values, a part of the rows at a time."""
    sides = [f"{name}_{side}" for name in columns for side in ("min", "max")]
    wanted = sides if level else list(dict.fromkeys(columns))
    start, stop = source.row_of(first_tick), source.row_of(stop_tick)
    for row in range(start, stop, _READ_ROWS):
        read = source.read(["tick", *wanted], row, min(row + _READ_ROWS, stop))
        low = {name: read[f"{name}_min" if level else name] for name in columns}
        high = {name: read[f"{name}_max" if level else name] for name in columns}
        yield read["tick"], low, high


def _nothing(columns: list[str]) -> Stretches:
    none = dict.fromkeys(columns, np.empty(0))
    return Stretches(np.empty(0, np.int64), none, none)


def _records(folder: Path, stack: ExitStack) -> Iterator[_Record]:
    for kind in KINDS:
        path = folder / f"{kind}.arrow"
        if path.exists():
            with suppress(InputError):  # cut inside its header, or from before there were checksums
                yield _Record(stack.enter_context(DirectRecord(path, kind)), stack)


def shown(kind: str, told: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, Shown]]:
    """Channels of a record by name, those of a capture as an export has them; `told` is unit and scale by column."""
    for column in drawn(told):
        unit, scale = str(told[column]["unit"]), float(told[column]["scale"])
        if kind != "capture":
            yield column, Shown(column, scale, unit)
        elif column.startswith(("vx_", "vy_")):
            yield f"{column[:2]}_{'V' if unit == 'V' else 'sensed'}", Shown(column, scale, unit)
        elif column.startswith(("ux_", "uy_")):
            yield f"{column[:2]}_{unit}", Shown(column, scale, unit)
        elif column.startswith("rate_") and column.endswith("_code"):
            yield f"{column[:-5]}_rad_s", Shown(column, scale, unit)
        elif column in ("rate_rad_s", "temp_C"):
            yield column, Shown(column, scale, unit)


def _limits(used: list[_Record], from_s: float | None, to_s: float | None) -> tuple[float, float]:
    ends = [one.ends_s for one in used if one.source.rows]
    low = from_s if from_s is not None else min((first for first, _ in ends), default=0.0)
    high = to_s if to_s is not None else max((last for _, last in ends), default=0.0)
    if not (math.isfinite(low) and math.isfinite(high) and low <= high and max(abs(low), abs(high)) < 1e9):
        raise InputError(f"from {low:g} s to {high:g} s: no stretch of bench time")
    return low, high


def _chosen(used: list[_Record], low_s: float, high_s: float, points: int) -> tuple[_Grid, dict[str, int]]:
    """The grid, and for each record the level that it is read from: what is least to read of all that is exact."""
    rate, origin = used[0].rate_Hz, used[0].origin_s
    first = math.floor((low_s - origin) * rate + 1e-6)
    last = math.ceil((high_s - origin) * rate - 1e-6)
    least = max(-(-(last - first + 1) // points), 1)
    best: tuple[int, int, tuple[int, ...]] | None = None
    for depths in product(*(range(len(one.widths)) for one in used)):
        together = math.lcm(*(one.widths[depth] for one, depth in zip(used, depths, strict=True)))
        if together > max(least // _COARSER, 1):
            continue
        step = -(-least // together) * together
        rows = [_rows_to_read(one, depth, first, last) for one, depth in zip(used, depths, strict=True)]
        if best is None or sum(rows) < best[0]:
            best = (sum(rows), step, depths)
    assert best is not None  # the rows themselves always do
    most, step, depths = best
    if most > _AT_ONCE:
        raise PyramidNeeded(max(used, key=lambda one: one.source.rows).source.path)
    begin = first // step
    grid = _Grid(begin, last // step - begin + 1, step, origin, step / rate)
    return grid, {one.kind: depth for one, depth in zip(used, depths, strict=True)}


def _rows_to_read(one: _Record, depth: int, first: int, last: int) -> int:
    """At most so many, by how many ticks a row stands for; where a level ends early, the finer rows behind it too."""
    if not one.source.rows:
        return 0
    first, last = max(first, one.source.tick_at(0)), min(last, one.source.tick_at(-1))
    rows = 0
    for level in range(depth, -1, -1):
        if last < first:
            break
        width = one.widths[level] if level else one.every
        end = one.levels[level - 1].tick_at(-1) + width - 1 if level else last
        rows += max(min(end, last) - first + 1, 0) // width + 1
        first = max(first, end + 1)
    return rows


def _framed(names: Sequence[str], records: dict[str, _Record], read: dict[str, Stretches], grid: _Grid) -> Frame:
    low = np.full((len(names), grid.count), np.nan, np.float32)
    high = low.copy()
    for row, name in enumerate(names):
        kind, _, channel = name.partition(".")
        shown, found = records[kind].shown[channel], read[kind]
        inside = (found.number >= grid.first) & (found.number < grid.first + grid.count)
        at = found.number[inside] - grid.first
        ends = [shown.scale * side[shown.column][inside].astype(float) for side in (found.low, found.high)]
        low[row, at], high[row, at] = np.minimum(*ends), np.maximum(*ends)
    return Frame(grid.begin_s, grid.step_s, grid.first, low, high)
