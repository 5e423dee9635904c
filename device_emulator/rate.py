"""Rate profiles: Ω(t), Ω̇(t) and the angle ∫Ω dt, exact and consistent, from the `[rate]` section.

Every kind comes down to one table of pieces, each Ω(τ) = rate + slope τ + amplitude sin(frequency τ + phase)
in its own time τ since `start_s`. The angle at the start of each piece is summed once, so the angle at any
time is closed form. Between pieces Ω may jump; the plant answers with the velocity step that this means.
"""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from device_emulator.native import rate_at
from device_emulator.section import Positive, PositiveOrInf, ScenarioError, Section
from hil.wire.regular_file import what_instead

PIECE = np.dtype(
    [
        ("start_s", "f8"),
        ("angle_rad", "f8"),
        ("rate_rad_s", "f8"),
        ("slope_rad_s2", "f8"),
        ("amplitude_rad_s", "f8"),
        ("frequency_rad_s", "f8"),
        ("phase_rad", "f8"),
    ],
    align=True,
)


class Constant(Section):
    """One rate for ever."""

    kind: Literal["constant"]
    rate_rad_s: float
    """the rate"""


class Sine(Section):
    """`offset + amplitude sin(2π frequency t + phase)`."""

    kind: Literal["sine"]
    amplitude_rad_s: float
    """of the sine"""
    frequency_Hz: Positive
    """of the sine"""
    phase_rad: float = 0.0
    """of the sine at the start"""
    offset_rad_s: float = 0.0
    """its mean"""


class Ramp(Section):
    """From one rate to another in `duration_s`, then the second for ever."""

    kind: Literal["ramp"]
    from_rad_s: float
    """rate at the start"""
    to_rad_s: float
    """rate at the end, held from there on"""
    duration_s: Positive
    """length of the piece; the last one of segments may go on for ever"""


class ConstantPiece(Constant):
    duration_s: PositiveOrInf = math.inf
    """length of the piece; the last one of segments may go on for ever"""


class SinePiece(Sine):
    duration_s: PositiveOrInf = math.inf
    """length of the piece; the last one of segments may go on for ever"""


class Steps(Section):
    """`rates_rad_s[i]` from `times_s[i]` on; the first time is 0."""

    kind: Literal["steps"]
    times_s: Annotated[list[float], Field(min_length=1)]
    """begin of each rate, the first 0"""
    rates_rad_s: Annotated[list[float], Field(min_length=1)]
    """the rates, one for each time"""

    @model_validator(mode="after")
    def _ordered(self) -> "Steps":
        if len(self.times_s) != len(self.rates_rad_s):
            raise ValueError("expected as many rates_rad_s as times_s")
        if self.times_s[0] != 0.0:
            raise ValueError("expected times_s to begin at 0")
        if any(b <= a for a, b in itertools.pairwise(self.times_s)):
            raise ValueError("expected times_s to increase")
        return self


class Segments(Section):
    """Pieces one after the other; the last goes on for ever (a ramp holds its end)."""

    kind: Literal["segments"]
    segment: Annotated[
        list[Annotated[ConstantPiece | SinePiece | Ramp, Field(discriminator="kind")]], Field(min_length=1)
    ]
    """tables [[rate.segment]] of kind constant, sine or ramp, one after the other"""

    @model_validator(mode="after")
    def _only_the_last_is_endless(self) -> "Segments":
        if any(math.isinf(piece.duration_s) for piece in self.segment[:-1]):
            raise ValueError("expected duration_s in every segment but the last")
        return self


class FromFile(Section):
    """Linear between the rows of a CSV file with the header `t_s, rate_rad_s` or `t_s, rate_dps`; the last rate
    holds."""

    kind: Literal["file"]
    path: str
    """CSV file beside the scenario"""


Rate = Annotated[Constant | Steps | Sine | Ramp | Segments | FromFile, Field(discriminator="kind")]


def pieces(rate: Constant | Steps | Sine | Ramp | Segments | FromFile) -> NDArray[Any]:
    """The table of pieces (dtype `PIECE`) of a profile.

    Raises `ScenarioError` when a rate file cannot be read or its rows are not numbers in increasing time.
    """
    if isinstance(rate, Steps):
        return _table([_still(t, r) for t, r in zip(rate.times_s, rate.rates_rad_s, strict=True)])
    if isinstance(rate, FromFile):
        return _table(_read(Path(rate.path)))
    rows: list[Row] = []
    start = 0.0
    for piece in rate.segment if isinstance(rate, Segments) else [rate]:
        if isinstance(piece, Constant):
            rows.append(_still(start, piece.rate_rad_s))
        elif isinstance(piece, Sine):
            angular = 2.0 * math.pi * piece.frequency_Hz
            rows.append(Row(start, piece.offset_rad_s, 0.0, piece.amplitude_rad_s, angular, piece.phase_rad))
        else:
            rows.append(_line(start, piece.from_rad_s, start + piece.duration_s, piece.to_rad_s))
        if isinstance(piece, ConstantPiece | SinePiece | Ramp):
            start += piece.duration_s
    if isinstance(piece, Ramp):
        rows.append(_still(start, piece.to_rad_s))
    return _table(rows)


class Row(NamedTuple):
    """A piece before the angle at its start is known."""

    start_s: float
    rate_rad_s: float
    slope_rad_s2: float
    amplitude_rad_s: float
    frequency_rad_s: float
    phase_rad: float


def _still(start_s: float, rate_rad_s: float) -> Row:
    return Row(start_s, rate_rad_s, 0.0, 0.0, 0.0, 0.0)


def _line(t0: float, r0: float, t1: float, r1: float) -> Row:
    return Row(t0, r0, (r1 - r0) / (t1 - t0), 0.0, 0.0, 0.0)


def _read(path: Path) -> list[Row]:
    try:
        if kind := what_instead(path):
            raise ScenarioError(f"{path}: is {kind}; give a CSV file")
        lines = path.read_text().splitlines()
    except OSError as error:
        raise ScenarioError(f"{path}: cannot read the rate file ({error.strerror})") from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: expected a CSV text file") from None
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    if header not in (["t_s", "rate_rad_s"], ["t_s", "rate_dps"]):
        raise ScenarioError(f"{path}:1: expected the header `t_s, rate_rad_s`, or `t_s, rate_dps`")
    in_degrees = header[1] == "rate_dps"
    points: list[tuple[float, float]] = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            t, r = (float(cell) for cell in line.split(","))
        except ValueError:
            raise ScenarioError(f"{path}:{number}: expected two numbers, t_s and {header[1]}") from None
        if not (math.isfinite(t) and math.isfinite(r)):
            raise ScenarioError(f"{path}:{number}: expected finite numbers")
        if points and t <= points[-1][0]:
            raise ScenarioError(f"{path}:{number}: expected t_s to increase, {t:g} follows {points[-1][0]:g}")
        points.append((t, math.radians(r) if in_degrees else r))
    if not points or points[0][0] != 0.0:
        raise ScenarioError(f"{path}: expected rows that begin at t_s = 0")
    return [*(_line(*a, *b) for a, b in itertools.pairwise(points)), _still(*points[-1])]


def _table(rows: list[Row]) -> NDArray[Any]:
    table = np.zeros(len(rows), PIECE)
    for name in Row._fields:
        table[name] = [getattr(row, name) for row in rows]
    for before, after in itertools.pairwise(table):
        after["angle_rad"] = rate_at(before, after["start_s"].item())[2]
    return table
