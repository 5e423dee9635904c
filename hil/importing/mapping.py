"""The map file (`--map`): how a file or arrays that look different become a record."""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, create_model, model_validator

from hil.importing.band import Band
from hil.importing.channels import COMPONENTS, OWN, dimension_of, fault_in
from hil.importing.units import (
    MOTIONS,
    VOLTS_OF_LEVELS,
    Motion,
    factor_and_addition,
    motion_of,
    one_spelling,
    require_own_unit,
)
from hil.records.capture import DRIVE_UNITS, Hold
from hil.toml.reading import read_toml

Mark = Annotated[str, Field(min_length=1, max_length=1)]
Rows = Annotated[
    tuple[int, int], Field(description="[first, one past the last] data row, counted from 0 among those kept")
]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _name_or_position(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, str | int):
        shown = str(value).lower() if isinstance(value, bool) else repr(value)
        raise ValueError(f"expected a name in quotes, or a position from 1, not {shown}")
    if isinstance(value, int) and value < 1:
        raise ValueError(f"{value} is no position; positions count from 1")
    return value


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("0 makes every value the same; give another, or leave the column out")
    return value


Name = Annotated[str | int, BeforeValidator(_name_or_position)]
Unit = Annotated[str, AfterValidator(one_spelling)]
Factor = Annotated[float, AfterValidator(_not_zero)]
LONGEST_COMMENT = 8
SLOWEST_HZ, FASTEST_HZ = 1e-6, 1e9
"""What a sampling rate lies between: a sample in twelve days, and one in a nanosecond."""


class Source(_Table):
    """Where one channel comes from: value = scale · cell + offset, in `unit`."""

    column: Name = Field(description="its name, or its position from 1")
    unit: Unit = Field(description="unit of scale · cell + offset, e.g. V or deg/s")
    scale: Factor = Field(default=1.0, description="what a cell is multiplied by before `unit` applies")
    offset: float = Field(default=0.0, description="what is added to that, in `unit`")
    thousands: Literal[",", ".", "'", "\u2019", " ", "\u00a0", "\u202f"] | None = Field(
        default=None,
        description="of a text: what stands between groups of three digits; no decimal then, if it is that",
    )
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
            elif self.is_level_in_volts(channel):
                factor, addition = 1.0, 0.0
            else:
                factor, addition = factor_and_addition(dimension_of(channel), self.unit)
        except ValueError as error:
            raise ValueError(f"[columns.{channel}] {error}") from None
        return factor * self.scale, factor * self.offset + addition

    def is_level_in_volts(self, channel: str) -> bool:
        """Whether a level stands where volts are asked for."""
        return channel in ("vx_V", "vy_V") and self.unit in VOLTS_OF_LEVELS

    def in_its_unit(self, channel: str, cells: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """The values of a channel: in SI, in the sensor's own unit, of a level the amplitude."""
        factor, addition = self.factor_and_addition(channel)
        with np.errstate(over="ignore", invalid="ignore"):  # the caller refuses what is not finite, with its row
            values = factor * cells + addition
            if self.is_level_in_volts(channel):
                values = VOLTS_OF_LEVELS[self.unit] * 10.0 ** (values / 20.0)
        return values


class Addend(_Table):
    """A further column of the time."""

    column: Name = Field(description="its name, or its position from 1")
    unit: Unit = Field(description="its unit, e.g. ns or week")


class Time(Source):
    """Where the time comes from: the sum of one column or several."""

    add: tuple[Addend, ...] = Field(
        default=(), description="columns to add, where the time stands in several: [{ column = …, unit = … }]"
    )


def _with_channels(body: "type[Columns]") -> "type[Columns]":
    drives = (f"{axis}_{unit}" for axis in ("ux", "uy") for unit in DRIVE_UNITS)
    names = ("vx_V", "vy_V", *OWN, "base", *drives, "rate_rad_s", "temp_C", *COMPONENTS, "carrier_Hz")
    fields: dict[str, Any] = {"t_s": (Time | None, None)} | dict.fromkeys(names, (Source | None, None))
    return create_model("Columns", __base__=body, __module__=body.__module__, __doc__=body.__doc__, **fields)


@_with_channels
class Columns(_Table):
    """The channels of the record and their sources."""

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
    sampling_rate_Hz: Annotated[float, Field(ge=SLOWEST_HZ, le=FASTEST_HZ)] | None = Field(
        default=None, description="samples per second; beside t_s, whose stamps are then rounded to that grid"
    )
    encoding: str = Field(default="utf-8", description="of the text, as cp1252 or utf-16")
    delimiter: Mark = Field(default=",", description='what stands between two cells; " " is any run of blanks')
    quote: Annotated[str, Field(max_length=1)] = Field(
        default='"', description='what a cell may stand between; "" where such marks are letters'
    )
    decimal: Literal[".", ","] | None = Field(default=None, description="what stands before decimals; a point")
    comment: Annotated[str, Field(min_length=1, max_length=LONGEST_COMMENT)] | None = Field(
        default=None, description="lines that begin so are left out, as # or %"
    )
    skip_lines: Annotated[int, Field(ge=0)] = Field(default=0, description="lines before the header")
    header: bool = Field(default=True, description="whether the first line names the columns")
    units_row: bool = Field(default=False, description="whether a line of units follows the header; it is left out")
    rows: Rows | None = Field(default=None, description="the rows to keep, [first, one past the last], from 0")
    steady: bool = Field(default=False, description="true: each row is a steady state of its own; there is no time")
    where: dict[str, str] = Field(default_factory=dict, description="keep the rows in which these columns read so")
    missing: tuple[str | float, ...] | None = Field(
        default=None, description="cells that are no measurement: the row is lost; [] where there are none"
    )
    covariates: dict[str, float] = Field(
        default_factory=dict, description="what was other on other records: load, serial number; numbers by name"
    )
    filter: Filter | None = Field(default=None, description="table [filter]")
    columns: Columns | None = Field(default=None, description="table [columns]; without it names are channels")
    segments: dict[str, Rows] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        self._require_dialect()
        if self.columns is not None:
            self._require_columns(self.columns.given())
        first, last = self.rows or (0, None)
        for name, (start, stop) in {"rows": self.rows or (0, 1), **self.segments}.items():
            key = "rows" if name == "rows" else f"[segments] {name}"
            if not 0 <= start < stop:
                raise ValueError(f"{key}: [{start}, {stop}] is empty; expected 0 <= first < one past the last")
            if start < first or (last is not None and stop > last):
                raise ValueError(f"{key}: [{start}, {stop}] leaves rows [{first}, {last}]; move one of them")
        return self

    def _require_dialect(self) -> None:
        """What the keys of a text may not be together."""
        try:
            "1".encode(self.encoding)
        except (LookupError, ValueError):
            raise ValueError(
                f"encoding: {self.encoding!r} is not known; give utf-8, cp1252, utf-16 or another"
            ) from None
        if self.delimiter in (self.decimal or ".", self.quote):
            raise ValueError(
                f"delimiter: {self.delimiter!r} stands in a number or is the quote; give another delimiter"
            )
        if self.where and not self.header:
            raise ValueError("where: the file has no header to find columns by; keep rows by `rows`")
        if self.units_row and not self.header:
            raise ValueError("units_row: the file has no header that it could follow; skip both by skip_lines")

    def _require_columns(self, channels: dict[str, Source]) -> None:
        if self.steady and (self.sampling_rate_Hz is not None or "t_s" in channels):
            raise ValueError("steady: steady states have no time; leave out t_s and sampling_rate_Hz")
        if not self.is_demodulated and (fault := fault_in(list(channels), needs_time=self.needs_time, mapped=True)):
            raise ValueError(f"[columns] {fault}")
        own = [channels[name].unit for name in OWN if name in channels]
        if len(set(own)) > 1:
            raise ValueError(
                f"[columns.vy] unit: {own[1]!r}, but vx is in {own[0]!r}; give both axes in one unit, by scale"
            )
        for channel, source in channels.items():
            source.factor_and_addition(channel)
            parts = [source.column, *(addend.column for addend in getattr(source, "add", ()))]
            if not self.header and any(isinstance(column, str) for column in parts):
                raise ValueError(f"[columns.{channel}] column: the file has no header; give a position from 1")
        for addend in getattr(channels.get("t_s"), "add", ()):
            try:
                factor_and_addition("s", addend.unit)
            except ValueError as error:
                raise ValueError(f"[columns.t_s] add: {error}") from None
        self._require_base(channels)

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
    def channels(self) -> dict[str, Source]:
        """Channels that have a source; none without [columns]."""
        return {} if self.columns is None else self.columns.given()

    @property
    def is_demodulated(self) -> bool:
        return bool(self.channels.keys() & {*COMPONENTS, "carrier_Hz"})

    @property
    def needs_time(self) -> bool:
        """Whether the record must have a column of it."""
        return self.sampling_rate_Hz is None and not self.steady

    @property
    def base_motion(self) -> Motion | None:
        """What the base is given as, where there is one."""
        base = self.channels.get("base")
        return None if base is None else motion_of(base.unit)

    @property
    def sense_unit(self) -> str:
        own = self.channels.get("vx")
        return "V" if own is None else own.unit

    def keys_of_text_given(self) -> list[str]:
        """Those of its keys that say how a text is written."""
        given = [key for key in OF_TEXT if key in self.model_fields_set]
        return given + [
            f"[columns.{name}] thousands" for name, entry in self.channels.items() if entry.thousands is not None
        ]


OF_TEXT = (
    "encoding",
    "delimiter",
    "quote",
    "decimal",
    "comment",
    "skip_lines",
    "header",
    "units_row",
)
"""Keys that act on text alone."""


def read_map(path: Path) -> RecordMap:
    """Read a map file. Raises InputError naming file and key."""
    return read_toml(path, RecordMap)
