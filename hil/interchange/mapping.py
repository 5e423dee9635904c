"""The map file (`--map`): how a delimited file that looks different becomes a record."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hil.errors import InputError
from hil.interchange.channels import fault_in
from hil.records.capture import Hold
from hil.strict_toml import read_toml, suggestion

_VOLTAGE = {"V": (1.0, 0.0), "mV": (1e-3, 0.0), "uV": (1e-6, 0.0)}
_TURN_RAD = 6.283185307179586

# unit → (factor, addition) that lead to the channel's SI unit
_UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "s": {"s": (1.0, 0.0), "ms": (1e-3, 0.0), "us": (1e-6, 0.0), "ns": (1e-9, 0.0)},
    "V": _VOLTAGE,
    "N": {"N": (1.0, 0.0), "mN": (1e-3, 0.0), "uN": (1e-6, 0.0)},
    "mps2": {"m/s^2": (1.0, 0.0), "mps2": (1.0, 0.0), "g": (9.80665, 0.0)},
    "rad_s": {
        "rad/s": (1.0, 0.0),
        "deg/s": (_TURN_RAD / 360, 0.0),
        "deg/h": (_TURN_RAD / 360 / 3600, 0.0),
        "rpm": (_TURN_RAD / 60, 0.0),
    },
    "C": {"degC": (1.0, 0.0), "K": (1.0, -273.15)},
}

Rows = Annotated[
    tuple[int, int], Field(description="[first, one past the last] data row, counted from 0 among those kept")
]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Source(_Table):
    """Where one channel comes from: value = scale · cell + offset, in `unit`."""

    column: str | Annotated[int, Field(ge=1)] = Field(description="name in the header, or position from 1")
    unit: str = Field(description="unit of the values, e.g. V or deg/s")
    scale: float = 1.0
    offset: float = 0.0

    def factor_and_addition(self, channel: str) -> tuple[float, float]:
        """SI value = factor · cell + addition. Raises ValueError for a unit the channel cannot have."""
        known = _UNITS[channel.split("_", 1)[1]]
        if self.unit not in known:
            raise ValueError(
                f"[columns.{channel}] unit: {self.unit!r} is not known; {suggestion(self.unit, list(known))}"
            )
        factor, addition = known[self.unit]
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


class RecordMap(_Table):
    """A map file, checked."""

    hold: Hold = Field(description="what the drive does between samples: zoh, foh or bandlimited")
    sampling_rate_Hz: Annotated[float, Field(gt=0)] | None = None
    delimiter: Annotated[str, Field(min_length=1, max_length=1)] = ","
    header: bool = True
    skip_lines: Annotated[int, Field(ge=0)] = 0
    rows: Rows | None = None
    steady: bool = Field(default=False, description="true: each row is a steady state of its own; there is no time")
    where: dict[str, str] = Field(default_factory=dict, description="keep the rows in which these columns read so")
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
        fault = fault_in(list(channels), needs_time=self.sampling_rate_Hz is None and not self.steady)
        if fault:
            raise ValueError(f"[columns] {fault}")
        for channel, source in channels.items():
            source.factor_and_addition(channel)
            if not self.header and isinstance(source.column, str):
                raise ValueError(f"[columns.{channel}] column: the file has no header; give a position from 1")
        first, last = self.rows or (0, None)
        for name, (start, stop) in {"rows": self.rows or (0, 1), **self.segments}.items():
            key = "rows" if name == "rows" else f"[segments] {name}"
            if not 0 <= start < stop:
                raise ValueError(f"{key}: [{start}, {stop}] is empty; expected 0 <= first < one past the last")
            if start < first or (last is not None and stop > last):
                raise ValueError(f"{key}: [{start}, {stop}] leaves rows [{first}, {last}]; move one of them")
        return self


def read_map(path: Path) -> RecordMap:
    """Read a map file. Raises InputError naming file and key."""
    return read_toml(path, RecordMap)


def locate_where(mapping: RecordMap, header: Sequence[str], source: Path) -> dict[int, str]:
    """Column index and text of each condition of `where`. Raises InputError for a column that is absent."""
    for column in mapping.where:
        if column not in header:
            raise InputError(f"{source}: no column {column!r} for `where`; the file has: {', '.join(header)}")
    return {header.index(column): text for column, text in mapping.where.items()}


def locate(mapping: RecordMap, header: Sequence[str], source: Path) -> list[int]:
    """Column index of each mapped channel in a file with this header. Raises InputError for one that is
    absent."""
    indices: list[int] = []
    for channel, entry in mapping.columns.given().items():
        index = entry.index_in(header)
        if index is None:
            there = ", ".join(header) if mapping.header else f"{len(header)} columns"
            raise InputError(f"{source}: no column {entry.column!r} for {channel}; the file has: {there}")
        indices.append(index)
    return indices
