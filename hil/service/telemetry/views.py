"""What a client asked to see: each view makes the newest frame of it when it is asked, so that who is slow is sent
fewer frames, not older ones.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from hil.errors import InputError
from hil.records.estimates import steady
from hil.records.frame import Frame
from hil.records.layout import Column, Layout
from hil.running.recording.ring import Onlooker
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
        self._onlooker.detach()


class Tracks:
    """All rings of one run."""

    def __init__(self) -> None:
        self._tracks: dict[str, Track] = {}
        self.channels: dict[str, Channel] = {}
        self.rate_Hz = 1.0

    def add(self, stem: str, layout: Mapping[str, Any], descriptor: int) -> None:
        """One more ring. Raises OSError or ValueError where it is none."""
        columns = tuple(Column(*entry) for entry in layout["columns"])
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
        return self._tracks.get(stem)

    def __iter__(self) -> Iterator[Track]:
        return iter(self._tracks.values())

    def close(self) -> None:
        for track in self._tracks.values():
            track.close()


_BUCKET = np.dtype([("number", "<i8"), ("low", "<f4"), ("high", "<f4")])

Floats = npt.NDArray[np.float32]


def stretches(ticks: npt.NDArray[np.int64], values: npt.NDArray[np.float32], step: int) -> npt.NDArray[np.void]:
    """Number (tick // step), lowest and highest value of each bucket that has a row; ticks ascend."""
    number = ticks // step
    found = np.empty(0, _BUCKET)
    if number.size:
        starts = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1])
        found = np.empty(len(starts), _BUCKET)
        found["number"] = number[starts]
        found["low"] = np.fmin.reduceat(values, starts)
        found["high"] = np.fmax.reduceat(values, starts)
    return found


def dense(found: npt.NDArray[np.void], first: int, count: int) -> tuple[Floats, Floats]:
    """Lowest and highest value (count,) of the buckets from number `first` on, NaN where nothing was recorded."""
    low = np.full(count, np.nan, np.float32)
    high = low.copy()
    at = found["number"] - first
    inside = (at >= 0) & (at < count)
    low[at[inside]] = found["low"][inside]
    high[at[inside]] = found["high"][inside]
    return low, high


class Roll:
    """The last `buckets` buckets of `step` ticks of one channel."""

    def __init__(self, step: int, buckets: int) -> None:
        self.step, self.buckets = step, buckets
        self._kept = History(_BUCKET, buckets + 1)
        self._open = np.empty(0, _BUCKET)  # the newest, to which more may come

    def add(self, ticks: npt.NDArray[np.int64], values: npt.NDArray[np.float32]) -> None:
        """Rows that follow those before."""
        found = stretches(ticks, values, self.step)
        if not found.size:
            return
        if self._open.size:
            if found["number"][0] == self._open["number"][0]:
                found["low"][0] = np.fmin(found["low"][0], self._open["low"][0])
                found["high"][0] = np.fmax(found["high"][0], self._open["high"][0])
            else:
                self._kept.add(self._open)
        self._kept.add(found[:-1])
        self._open = found[-1:].copy()

    @property
    def next(self) -> int:
        """Number of the bucket to which more may come: those before it are whole. 0 before the first row."""
        return int(self._open["number"][0]) if self._open.size else 0

    def between(self, first: int, stop: int) -> tuple[Floats, Floats]:
        """Buckets first … stop − 1, which are whole."""
        return dense(self._kept.newest(self.buckets + 1), first, stop - first)


_BEFORE = 5  # a trigger stands a part of the window, one in so many, after its beginning
_TRIGGERED = 1 << 17  # ticks of a window: half of what is kept
_SEGMENT, _SEGMENTS = 4096, 15  # of a spectrum, half overlapping
_SPECTRUM_EVERY_S = 0.25

Name = Annotated[str, Field(max_length=64)]
Id = Annotated[int, Field(ge=0, lt=2**32)]


class _Asked(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    id: Id


class Trigger(BaseModel):
    """When a triggered frame is taken."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    channel: Name
    level: float = 0.0
    edge: Literal["rise", "fall"] = "rise"


class Subscribe(_Asked):
    """Channels over a window of bench time, rolling or triggered."""

    op: Literal["subscribe"]
    channels: Annotated[list[Name], Field(min_length=1, max_length=16)]
    window_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 1.0
    points: Annotated[int, Field(ge=1, le=4000)] = 800
    mode: Literal["roll", "trigger"] = "roll"
    trigger: Trigger | None = None


class AskPattern(_Asked):
    """The newest periods of the vibration in the plane, every sample."""

    op: Literal["pattern"]
    periods: Annotated[float, Field(gt=0.0, le=100.0)] = 3.0


class AskSpectrum(_Asked):
    """The amplitude density of a channel."""

    op: Literal["spectrum"]
    channel: Name


class View(ABC):
    """One subscription of one client."""

    @abstractmethod
    def frame(self, tracks: Tracks) -> Frame | None:
        """The newest, None where nothing is new or the run does not have what was asked for."""

    def close(self) -> None:  # noqa: B027
        """It is no longer wanted."""


class Rolls:
    """Decimated channels of a run, shared by all who ask for the same."""

    def __init__(self) -> None:
        self._rolls: dict[tuple[str, int, int], tuple[Channel, Roll]] = {}
        self._wanted: dict[tuple[str, int, int], int] = {}

    def want(self, key: tuple[str, int, int], tracks: Tracks) -> Roll:
        """Buckets of key = channel, ticks to a bucket, how many; begins with the rows that are still there."""
        self._wanted[key] = self._wanted.get(key, 0) + 1
        if key not in self._rolls:
            channel, roll = tracks.channels[key[0]], Roll(*key[1:])
            track = tracks.get(channel.track)
            assert track is not None
            rows = track.kept.newest(key[1] * key[2] // channel.every)
            roll.add(rows["tick"], channel.values(rows))
            self._rolls[key] = channel, roll
        return self._rolls[key][1]

    def leave(self, key: tuple[str, int, int]) -> None:
        """One less who wants it."""
        self._wanted[key] -= 1
        if not self._wanted[key]:
            del self._wanted[key]
            del self._rolls[key]

    def add_new(self, tracks: Tracks) -> None:
        """What the tracks' last look brought."""
        for channel, roll in self._rolls.values():
            track = tracks.get(channel.track)
            if track is not None and len(track.new):
                roll.add(track.new["tick"], channel.values(track.new))


class RollView(View):
    """The newest buckets since the last frame; all of the window first, and after frames that were not sent."""

    def __init__(self, asked: Subscribe, tracks: Tracks, rolls: Rolls) -> None:
        require(asked.channels, tracks)
        every = math.lcm(*(tracks.channels[name].every for name in asked.channels))
        ticks = max(asked.window_s * tracks.rate_Hz, 1.0)
        self._step = max(math.ceil(ticks / asked.points / every), 1) * every
        self._count = max(math.ceil(ticks / self._step), 1)
        self._rolls = rolls
        self._keys = [(name, self._step, self._count) for name in asked.channels]
        self._shown = [rolls.want(key, tracks) for key in self._keys]
        self._sent: int | None = None

    def frame(self, tracks: Tracks) -> Frame | None:
        stop = min(roll.next for roll in self._shown)
        first = max(stop - self._count, 0 if self._sent is None else self._sent)
        if stop <= first:
            return None
        self._sent = stop
        found = [roll.between(first, stop) for roll in self._shown]
        low, high = (np.stack([pair[side] for pair in found]) for side in (0, 1))
        return Frame(first * self._step / tracks.rate_Hz, self._step / tracks.rate_Hz, first, low, high)

    def close(self) -> None:
        for key in self._keys:
            self._rolls.leave(key)


class TriggerView(View):
    """The newest window in which a channel crossed a level."""

    def __init__(self, asked: Subscribe, tracks: Tracks) -> None:
        if asked.trigger is None:
            raise InputError("trigger: missing; give channel, level and edge")
        require([*asked.channels, asked.trigger.channel], tracks)
        self._channels = [tracks.channels[name] for name in asked.channels]
        self._source = tracks.channels[asked.trigger.channel]
        self._level, self._falls = asked.trigger.level, asked.trigger.edge == "fall"
        every = math.lcm(*(channel.every for channel in (*self._channels, self._source)))
        self._ticks = max(round(asked.window_s * tracks.rate_Hz), every)
        self._step = max(math.ceil(self._ticks / asked.points / every), 1) * every
        self._seen = -1  # tick of the last trigger shown
        self._frames = 0
        if self._ticks > _TRIGGERED:
            longest = _TRIGGERED / tracks.rate_Hz
            raise InputError(f"window_s: {asked.window_s:g} s is too long for a trigger; {longest:g} s at most")

    def frame(self, tracks: Tracks) -> Frame | None:
        source = tracks.get(self._source.track)
        if source is None:
            return None
        before = self._ticks // _BEFORE
        rows = source.kept.newest(2 * self._ticks // source.every + 2)
        if len(rows) < 2:
            return None
        values, ticks = self._source.values(rows), rows["tick"]
        above = values < self._level if self._falls else values >= self._level
        crossed = ticks[1:][above[1:] & ~above[:-1]]
        fits = (crossed > self._seen) & (crossed + self._ticks - before <= ticks[-1]) & (crossed - before >= ticks[0])
        if not fits.any():
            return None
        self._seen = int(crossed[fits][-1])
        begin = self._seen - before
        self._frames += 1
        return _cut(self._channels, tracks, begin, -(-self._ticks // self._step), self._step, self._frames)


class PatternView(View):
    """x and y over the newest periods of the target oscillator."""

    def __init__(self, asked: AskPattern, tracks: Tracks) -> None:
        names = [name for name in tracks.channels if name.startswith(("capture.vx_", "capture.vy_"))]
        estimates = tracks.get("estimates")
        if len(names) != 2 or estimates is None:
            raise InputError("pattern: the run has one axis alone")
        self._channels = [tracks.channels[name] for name in names]
        frequency = math.sqrt(float(estimates.layout.header["target_stiffness_per_s2"])) / (2.0 * math.pi)
        self._ticks = min(max(round(asked.periods * tracks.rate_Hz / frequency), 2), 1 << 14)
        self._last = -1

    def frame(self, tracks: Tracks) -> Frame | None:
        capture = tracks.get("capture")
        rows = None if capture is None else capture.kept.newest(1)
        if rows is None or not len(rows) or int(rows["tick"][0]) == self._last:
            return None
        self._last = int(rows["tick"][0])
        begin = max(self._last + 1 - self._ticks, 0)
        return _cut(self._channels, tracks, begin, self._last + 1 - begin, 1, begin)


class SpectrumView(View):
    """One-sided amplitude density, unit/√Hz, by Welch's mean over Hann windows of the newest rows. "Seconds per bucket"
    are hertz here, and the first bucket is at 0.
    """

    def __init__(self, asked: AskSpectrum, tracks: Tracks) -> None:
        require([asked.channel], tracks)
        self._channel = tracks.channels[asked.channel]
        self._next = 0
        self._frames = 0

    def frame(self, tracks: Tracks) -> Frame | None:
        track = tracks.get(self._channel.track)
        if track is None or track.kept.added < self._next:
            return None
        rate = tracks.rate_Hz / self._channel.every
        rows = track.kept.newest(_SEGMENT * (_SEGMENTS + 1) // 2)
        values = self._channel.values(rows).astype(float)
        length = _SEGMENT
        while length > len(values) and length > 64:
            length //= 2
        if len(values) < length:
            return None
        self._next = track.kept.added + round(_SPECTRUM_EVERY_S * rate)
        # A segment in which a row is missing, or none that counts, would spread the gap over all frequencies.
        broken = ~np.isfinite(values) | ~_steady(rows)
        broken[1:] |= np.diff(rows["tick"]) != self._channel.every
        windows = np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2]
        whole = ~np.lib.stride_tricks.sliding_window_view(broken, length)[:: length // 2].any(axis=1)
        if not whole.any():
            return None
        self._frames += 1
        segments = windows[whole]
        window = np.hanning(length + 1)[:-1]
        lines = np.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window, axis=1)
        density = 2.0 * (np.abs(lines) ** 2).mean(axis=0) / (rate * (window @ window))
        density[[0, -1]] *= 0.5
        root = np.sqrt(density).astype(np.float32)[None, :]
        return Frame(0.0, rate / length, self._frames, root, root)


def _steady(rows: Rows) -> npt.NDArray[np.bool_]:
    """Whether rows (n,) count in an average; of an innovation those behind a gap do not."""
    names = [name for name in rows.dtype.names or () if name.startswith("s_") and name.endswith("_V")]
    if not names:
        return np.ones(len(rows), bool)
    sd = np.stack([rows[name] for name in names], 1).astype(float)
    return steady(sd, np.median(sd, axis=0))


def require(names: list[str], tracks: Tracks) -> None:
    """InputError for a channel that the run does not have."""
    for name in names:
        if name not in tracks.channels:
            raise InputError(f"{name}: no channel of this run; there are {', '.join(tracks.channels)}")


def _cut(channels: list[Channel], tracks: Tracks, begin: int, count: int, step: int, serial: int) -> Frame:
    """Buckets of `step` ticks from tick `begin` on."""
    found = []
    for channel in channels:
        track = tracks.get(channel.track)
        assert track is not None
        newest = track.kept.newest(1)["tick"]
        since = int(newest[0]) - begin if len(newest) else 0
        rows = track.kept.newest(max(since, 0) // channel.every + 1)  # no more: the search copies their ticks
        rows = rows[np.searchsorted(rows["tick"], begin) : np.searchsorted(rows["tick"], begin + count * step)]
        found.append(dense(stretches(rows["tick"] - begin, channel.values(rows), step), 0, count))
    low, high = (np.stack([pair[side] for pair in found]) for side in (0, 1))
    return Frame(begin / tracks.rate_Hz, step / tracks.rate_Hz, serial, low, high)
