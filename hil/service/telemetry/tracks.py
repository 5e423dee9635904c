"""The rings of a run that lasts, as channels: read as they fill, the newest rows kept."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hil.records.layout import Layout
from hil.running.ring import Onlooker
from hil.service.series import shown

Rows = npt.NDArray[np.void]


class History:
    """The last `most` rows of a dtype, and perhaps as many before them."""

    def __init__(self, dtype: np.dtype[Any], most: int) -> None:
        self._rows = np.empty(2 * most, dtype)
        self._most = most
        self._count = 0
        self.added = 0
        """rows ever"""

    def add(self, rows: Rows) -> None:
        """Append rows; the oldest are forgotten."""
        self.added += len(rows)
        rows = rows[-self._most :]
        if self._count + len(rows) > len(self._rows):
            kept = self._most - len(rows)
            self._rows[:kept] = self._rows[self._count - kept : self._count].copy()
            self._count = kept
        self._rows[self._count : self._count + len(rows)] = rows
        self._count += len(rows)

    def newest(self, count: int) -> Rows:
        """The last `count` rows, or as many as there are; a view that holds until more are added."""
        return self._rows[max(self._count - count, 0) : self._count]


_AT_MOST = 1 << 17  # rows taken at a look: after a long halt the oldest are let go
_KEPT = {"capture": 1 << 18, "innovation": 1 << 18, "estimates": 1 << 12, "timing": 1 << 14}
_FEW = 64


class Channel(NamedTuple):
    """Where a channel's values are: the track, its column, what one count of it is, the unit, ticks to a row."""

    track: str
    column: str
    scale: float
    unit: str
    every: int

    def values(self, rows: Rows) -> npt.NDArray[np.float32]:
        """Its values in rows of its track, in its unit."""
        return np.asarray(np.multiply(rows[self.column], self.scale, dtype=np.float64), np.float32)


class Track:
    """One ring, and the newest rows of it."""

    def __init__(self, descriptor: int, layout: Layout) -> None:
        self._onlooker = Onlooker(descriptor)
        self.layout = layout
        self.every = int(layout.header.get("every", 1))
        self.kept = History(layout.dtype, _KEPT.get(layout.kind, _FEW))
        self.new: Rows = np.empty(0, layout.dtype)

    def look(self) -> Rows:
        """What has come since the last look, which stays in `new` until the next."""
        self.new = self._onlooker.look(_AT_MOST)
        self.kept.add(self.new)
        return self.new

    @property
    def passed_over(self) -> int:
        """Rows that were not looked at in time; they are in the record."""
        return self._onlooker.lost

    def close(self) -> None:
        """Look no more."""
        self._onlooker.close()


class Tracks:
    """All rings of one run."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = {}
        self.channels: dict[str, Channel] = {}
        self.rate_Hz = 1.0

    def add(self, stem: str, layout: Mapping[str, Any], descriptor: int) -> None:
        """One more ring. Raises OSError or ValueError where it is none."""
        columns = tuple(_column(entry) for entry in layout["columns"])
        made = Layout(layout["kind"], columns, layout["block_rows"], layout["header"])
        track = self._tracks[stem] = Track(descriptor, made)
        self.rate_Hz = float(made.header["tick_rate_Hz"])
        told = {column.name: {"unit": column.unit, "scale": column.scale} for column in columns}
        for name, channel in shown(made.kind, told):
            self.channels[f"{stem}.{name}"] = Channel(stem, channel.column, channel.scale, channel.unit, track.every)

    def look(self) -> bool:
        """Whether anything has come."""
        return sum(len(track.look()) for track in self._tracks.values()) > 0

    def get(self, stem: str) -> Track | None:
        """A track by its stem."""
        return self._tracks.get(stem)

    def __iter__(self) -> Iterator[Track]:
        return iter(self._tracks.values())

    def close(self) -> None:
        """Look no more."""
        for track in self._tracks.values():
            track.close()


def _column(entry: Any) -> Any:
    from hil.records.layout import Column

    return Column(*entry)
