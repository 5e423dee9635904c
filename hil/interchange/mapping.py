"""The map file (`--map`): how a delimited file that looks different becomes a record."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hil.errors import InputError
from hil.interchange.band import Band
from hil.interchange.channels import OWN, fault_in
from hil.interchange.units import MOTIONS, Motion, factor_and_addition, motion_of, require_own_unit
from hil.records.capture import Hold
from hil.strict_toml import near_or_all, read_toml

Rows = Annotated[
    tuple[int, int], Field(description="[first, one past the last] data row, counted from 0 among those kept")
]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Source(_Table):
    """Where one channel comes from: value = scale · cell + offset, in `unit`."""

    column: str | Annotated[int, Field(ge=1)] = Field(description="name in the header, or position from 1")
    unit: str = Field(description="unit of scale · cell + offset, e.g. V or deg/s")
    scale: float = Field(default=1.0, description="what a cell is multiplied by before `unit` applies")
    offset: float = Field(default=0.0, description="what is added to that, in `unit`")
    frame: Literal["relative", "absolute"] = Field(
        default="relative",
        description="vx, vy beside a base: relative to it, or absolute, from which the base's motion is taken off",
    )

    def factor_and_addition(self, channel: str) -> tuple[float, float]:
        """SI value = factor · cell + addition, of a channel in its own unit that unit's. Raises ValueError for a unit
        the channel cannot have."""
        try:
            if channel in OWN:
                require_own_unit(self.unit)
                factor, addition = 1.0, 0.0
            elif channel == "base":
                factor, addition = motion_of(self.unit).factor, 0.0
            else:
                factor, addition = factor_and_addition(channel.split("_", 1)[1], self.unit)
        except ValueError as error:
            raise ValueError(f"[columns.{channel}] {error}") from None
        return factor * self.scale, factor * self.offset + addition

    def index_in(self, header: Sequence[str]) -> int | None:
        """Index of the column in a file with this header; None when it has no such column."""
        if isinstance(self.column, int):
            return self.column - 1 if self.column <= len(header) else None
        return header.index(self.column) if self.column in header else None


class Columns(_Table):
    """The channels of the record and their sources."""

    t_s: Source | None = None
    vx_V: Source | None = None
    vy_V: Source | None = None
    vx: Source | None = None
    vy: Source | None = None
    base: Source | None = None
    ux_mps2: Source | None = None
    ux_N: Source | None = None
    ux_V: Source | None = None
    uy_mps2: Source | None = None
    uy_N: Source | None = None
    uy_V: Source | None = None
    rate_rad_s: Source | None = None
    temp_C: Source | None = None

    def given(self) -> dict[str, Source]:
        """Channels that have a source, in the order of the interchange file."""
        return {name: source for name in type(self).model_fields if (source := getattr(self, name)) is not None}


class Filter(_Table):
    """A band-pass without delay, and decimation."""

    low_Hz: Annotated[float, Field(gt=0)] | None = Field(default=None, description="lower edge of the band")
    high_Hz: Annotated[float, Field(gt=0)] | None = Field(default=None, description="upper edge of the band")
    order: Annotated[int, Field(ge=1, le=8)] = Field(
        default=4, description="of the Butterworth filter, which is run forwards and backwards"
    )
    decimate: Annotated[int, Field(ge=1, le=10_000)] = Field(default=1, description="keep every so many-th sample")


class RecordMap(_Table):
    """A map file, checked."""

    hold: Hold = Field(description="what the drive does between samples: zoh, foh or bandlimited")
    sampling_rate_Hz: Annotated[float, Field(gt=0)] | None = Field(
        default=None, description="samples per second, where the file has no time column"
    )
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = Field(
        default=",", description="what stands between two cells"
    )
    header: bool = Field(default=True, description="whether the first line names the columns")
    skip_lines: Annotated[int, Field(ge=0)] = Field(default=0, description="lines before that one")
    rows: Rows | None = Field(default=None, description="the rows to keep, [first, one past the last], from 0")
    steady: bool = Field(default=False, description="true: each row is a steady state of its own; there is no time")
    where: dict[str, str] = Field(default_factory=dict, description="keep the rows in which these columns read so")
    covariates: dict[str, float] = Field(
        default_factory=dict, description="what was other on other records: load, serial number; numbers by name"
    )
    filter: Filter | None = Field(default=None, description="table [filter]")
    columns: Columns
    segments: dict[str, Rows] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        channels = self.columns.given()
        if self.sampling_rate_Hz is not None and "t_s" in channels:
            raise ValueError("sampling_rate_Hz: the columns have t_s already; keep one of the two")
        if self.steady and (self.sampling_rate_Hz is not None or "t_s" in channels):
            raise ValueError("steady: steady states have no time; leave out t_s and sampling_rate_Hz")
        if self.where and not self.header:
            raise ValueError("where: the file has no header to find columns by; keep rows by `rows`")
        needs_time = self.sampling_rate_Hz is None and not self.steady
        fault = fault_in(list(channels), needs_time=needs_time, mapped=True)
        if fault:
            raise ValueError(f"[columns] {fault}")
        for channel, source in channels.items():
            source.factor_and_addition(channel)
            if not self.header and isinstance(source.column, str):
                raise ValueError(f"[columns.{channel}] column: the file has no header; give a position from 1")
        self._require_base(channels)
        first, last = self.rows or (0, None)
        for name, (start, stop) in {"rows": self.rows or (0, 1), **self.segments}.items():
            key = "rows" if name == "rows" else f"[segments] {name}"
            if not 0 <= start < stop:
                raise ValueError(f"{key}: [{start}, {stop}] is empty; expected 0 <= first < one past the last")
            if start < first or (last is not None and stop > last):
                raise ValueError(f"{key}: [{start}, {stop}] leaves rows [{first}, {last}]; move one of them")
        return self

    def _require_base(self, channels: dict[str, Source]) -> None:
        """What only goes with a base that moves, and what does not go with it."""
        base = channels.get("base")
        for channel in OWN:
            source = channels.get(channel)
            if source is None or source.frame == "relative":
                continue
            if base is None:
                raise ValueError(f"[columns.{channel}] frame: absolute beside no base; add base, or leave it out")
            if source.unit not in MOTIONS:
                raise ValueError(
                    f"[columns.{channel}] frame: {source.unit!r} is no unit of a motion, from which a base's could be "
                    "taken off; give scale and unit, as mm/s"
                )
            if MOTIONS[source.unit].order < motion_of(base.unit).order:
                raise ValueError(
                    f"[columns.{channel}] frame: the base, in {base.unit}, would have to be integrated to "
                    f"{source.unit}, from a start that nobody knows; give the base's displacement"
                )
        for channel, source in channels.items():
            if source.frame == "absolute" and channel not in OWN:
                raise ValueError(f"[columns.{channel}] frame: belongs to vx and vy; give the sensor's own unit there")
        if base is None:
            return
        if self.hold == "zoh":
            raise ValueError('hold: a base moves between its samples; "bandlimited" or "foh"')
        if self.steady:
            raise ValueError("[columns.base]: steady states have no motion; leave it out")

    def band(self, rate_Hz: float) -> Band | None:
        """The filter at this sampling rate. Raises ValueError, with the key, where it makes none."""
        if self.filter is None:
            return None
        band = Band(self.filter.low_Hz, self.filter.high_Hz, self.filter.order, self.filter.decimate, rate_Hz)
        if fault := band.fault():
            raise ValueError(f"[filter] {fault}")
        return band

    @property
    def base_motion(self) -> Motion | None:
        """What the base is given as, where there is one."""
        return None if self.columns.base is None else motion_of(self.columns.base.unit)

    @property
    def sense_unit(self) -> str:
        """Unit of the sense channels."""
        own = self.columns.vx
        return "V" if own is None else own.unit


def read_map(path: Path) -> RecordMap:
    """Read a map file. Raises InputError naming file and key."""
    return read_toml(path, RecordMap)


def locate_where(mapping: RecordMap, header: Sequence[str], source: Path) -> dict[int, str]:
    """Column index and text of each condition of `where`. Raises InputError for a column that is absent."""
    for column in mapping.where:
        if column not in header:
            raise InputError(f"{source}: no column {column!r} for `where`; {near_or_all(column, header)}")
    return {header.index(column): text for column, text in mapping.where.items()}


def locate(mapping: RecordMap, header: Sequence[str], source: Path) -> list[int]:
    """Column index of each mapped channel in a file with this header. Raises InputError for one that is
    absent."""
    indices: list[int] = []
    for channel, entry in mapping.columns.given().items():
        index = entry.index_in(header)
        if index is None:
            raise InputError(f"{source}: no column {entry.column!r} for {channel}; {_there(mapping, header, entry)}")
        indices.append(index)
    return indices


def delimiter_meant(header: Sequence[str], delimiter: str) -> str | None:
    """What seems to stand between the cells of a header that was read as one column, None where it is fine."""
    if len(header) != 1:
        return None
    return next((mark for mark in ";\t,| " if mark != delimiter and mark in header[0]), None)


def _there(mapping: RecordMap, header: Sequence[str], entry: Source) -> str:
    """What the file has instead, with the key that would mend it."""
    if (mark := delimiter_meant(header, mapping.delimiter)) is not None:
        shown = "\\t" if mark == "\t" else mark
        return f'its first line is one cell; set delimiter = "{shown}"'
    if not mapping.header or isinstance(entry.column, int):
        return f"the file has {len(header)} columns"
    if all(_is_number(cell) for cell in header):
        return "its first line holds numbers; set header = false and give columns by position, or skip_lines"
    return near_or_all(entry.column, header)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
