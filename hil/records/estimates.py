"""`estimates.arrow`: the observer's state with its standard deviations, and the angle, every few samples.

`covariance.arrow`: the whole covariance of what is estimated, every so many samples, at ticks of the estimates.

With it and a truth the normalised estimation error squared of a run can be computed from its folder alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from hil.records.blocks import pieces_of
from hil.records.layout import TICK, Column, Layout, block_rows_for
from hil.records.quantiles import quantiles
from hil.records.table import Table, scored_from_s
from hil.records.units import unit_of

Floats = npt.NDArray[np.float64]

ANGLE_COLUMNS = (
    "angle_rad",
    "angle_u_rad",
    "angle_sd_rad",
    "angle_forced_rad",
    "angle_pattern_rad",
    "angle_plain_rad",
    "angle_rate_integral_rad",
    "energy_ratio",
    "quadrature_ratio",
)
"""What a two-axis model adds to its state: reported angle φ; its standard uncertainty (k = 1), and the part of it by
estimation; what was taken off of it for forces; φ from the pattern with only the virtual rotation taken off, φ by the
plain formula (11), ∫Ω̂ dt, energy over its set point, and quadrature normalised by energy.

All angles, and the uncertainty, count from one zero: the first row, and from the start of the scored window (so many
seconds after the first row as the header's `angle_zero_after_s`) on the row there.
"""

_ZERO = (
    "angle and uncertainty count from bench time {at:g} s, where the scored window begins; "
    "rows before it count from the first row"
)


def estimates_layout(
    states: Sequence[str],
    *,
    tick_rate_Hz: float,
    every: int,
    angle: bool,
    units: Mapping[str, str] | None = None,
    header: Mapping[str, Any] | None = None,
) -> Layout:
    """Columns tick, the `states`, `sd_` of each, then (with `angle`) `ANGLE_COLUMNS` and the flag `valid`.

    One row per `every` samples. Units are read from the names, except for those in `units` (no SI suffix).
    `header` adds JSON values, e.g. `target_stiffness_per_s2` and `virtual_rotation_rad_s`, which the score
    uses.
    """
    known = dict(units or {})
    columns = [TICK]
    for prefix in ("", "sd_"):
        columns += [Column(prefix + name, "f8", known.get(name, unit_of(name))) for name in states]
    if angle:
        columns += [Column(name, "f8", unit_of(name)) for name in ANGLE_COLUMNS]
        columns.append(Column("valid", "u1"))
    full_header = {"tick_rate_Hz": tick_rate_Hz, "every": every, "states": list(states), **(header or {})}
    return Layout("estimates", tuple(columns), block_rows_for(tick_rate_Hz / every), full_header)


@dataclass(frozen=True)
class Estimates(Table):
    """Estimates of a run, read. Which states there are depends on the model: see `states`."""

    KIND = "estimates"

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        return self.columns[name]

    @property
    def states(self) -> tuple[str, ...]:
        return tuple(self.header["states"])

    @property
    def zero(self) -> str:
        """What its angles count from, one line; "" where it has none."""
        if "angle_rad" not in self:
            return ""
        after = float(self.header.get("angle_zero_after_s", 0.0))
        return _ZERO.format(at=scored_from_s(self.ends_s[0] if len(self) else 0.0, after, self.tick_rate_Hz))

    @cached_property
    def valid(self) -> npt.NDArray[np.bool_]:
        """Whether the ellipse was slender enough for its angle to mean something (n,)."""
        return np.asarray(self.columns.get("valid", np.ones(len(self)))).astype(bool)

    def sd(self, name: str) -> Floats:
        """Standard deviation (n,) of the state `name`."""
        return self.columns[f"sd_{name}"]

    def unit(self, name: str) -> str:
        return str(self.header["columns"][name]["unit"])

    def _flaw(self) -> str:
        states = self.header.get("states", [])
        missing = [name for state in states for name in (state, f"sd_{state}") if name not in self.columns]
        if missing or not states:
            return f"lacks {', '.join(missing) or 'its list of states'}; run or replay again"
        return ""


_DECLARED = (
    "target_stiffness_per_s2", "virtual_rotation_rad_s", "virtual_reversal_s", "angular_gain", "angle_zero_after_s",
)  # fmt: skip


def board_estimates_layout(
    states: Sequence[str], *, tick_rate_Hz: float, every: int, header: Mapping[str, Any]
) -> Layout:
    """Columns tick, the `states`, `sd_` of each (0 where the board does not say it), angle_rad and angle_sd_rad, and
    the flags valid and driving, as the board says them. The angle counts from one zero, as that of `estimates.arrow`,
    whose `header` it shares: what is declared of the pattern.
    """
    names = (*states, *(f"sd_{name}" for name in states), "angle_rad", "angle_sd_rad")
    columns = [TICK, *(Column(name, "f8", unit_of(name)) for name in names)]
    columns += [Column("valid", "u1"), Column("driving", "u1")]
    declared = {name: header[name] for name in _DECLARED}
    full_header = {"tick_rate_Hz": tick_rate_Hz, "every": every, "states": list(states), "by": "board", **declared}
    return Layout("estimates", tuple(columns), block_rows_for(tick_rate_Hz / every), full_header)


_AXES = ("x", "y")

WIDE = 1.5
"""A prediction that is less sure than usual by more than this comes behind a gap, or before the motion is known."""


def innovation_layout(*, tick_rate_Hz: float, axes: int, sense_unit: str = "V") -> Layout:
    """Columns tick, nu_x_V (nu_y_V), s_x_V (s_y_V), the latter the predicted standard deviations; their unit is that of
    what is sensed, whatever the name says.
    """
    names = _AXES[:axes]
    columns = (
        TICK,
        *(Column(f"nu_{axis}_V", "f4", sense_unit) for axis in names),
        *(Column(f"s_{axis}_V", "f4", sense_unit) for axis in names),
    )
    header = {"tick_rate_Hz": tick_rate_Hz, "axes": axes}
    return Layout("innovation", columns, block_rows_for(tick_rate_Hz), header)


@dataclass(frozen=True)
class Innovation(Table):
    KIND = "innovation"

    @property
    def unit(self) -> str:
        """Of what is sensed: V, or the sensor's own."""
        return str(self.header["columns"]["nu_x_V"]["unit"])

    @cached_property
    def nu_V(self) -> npt.NDArray[np.float64]:
        """Innovation (n, axes) in volts."""
        return self._stack("nu")

    @cached_property
    def sd_V(self) -> npt.NDArray[np.float64]:
        """Its predicted standard deviation (n, axes) in volts."""
        return self._stack("s")

    def _stack(self, prefix: str) -> npt.NDArray[np.float64]:
        return np.stack([self.columns[f"{prefix}_{axis}_V"] for axis in _AXES[: self.axes]], 1).astype(float)


def usual_sd_V(innovation: Innovation) -> npt.NDArray[np.float64] | None:
    """The predicted standard deviation (axes,) as its median over the rows; None without rows, or where it is not
    finite."""

    def of_axis(axis: int) -> list[float] | None:
        return quantiles(lambda: (piece.sd_V[:, axis] for piece in innovation.pieces()), (0.5,))

    found = [median[0] for axis in range(innovation.axes) if (median := of_axis(axis)) is not None]
    usual = np.array(found)
    return usual if len(found) == innovation.axes > 0 and np.isfinite(usual).all() else None


def steady(sd_V: npt.NDArray[np.float64], usual_V: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Whether (n,) rows count in an average: their prediction is about as sure as usual, on every axis.

    Behind a gap it is wide for a while, and what comes then is large by right: that is neither noise nor a residual.
    """
    return np.asarray((sd_V <= WIDE * usual_V).all(axis=1), np.bool_)


def stretches(innovation: Innovation, usual_V: npt.NDArray[np.float64]) -> Iterator[npt.NDArray[np.float64] | None]:
    """The innovation of steady rows (n, axes) in V, in parts that follow each other; None where a gap lies between."""
    expected: int | None = None
    for piece in innovation.pieces():
        tick, sure = piece.tick, steady(piece.sd_V, usual_V)
        nu = piece.nu_V
        cuts = np.flatnonzero((np.diff(tick) != 1) | (np.diff(sure.astype(np.int8)) != 0)) + 1
        for rows in np.split(np.arange(tick.size), cuts):
            if not rows.size or not sure[rows[0]]:
                continue
            if expected is not None and tick[rows[0]] != expected:
                yield None
            expected = int(tick[rows[-1]]) + 1
            yield nu[rows]


MEANING = (
    "covariance that the estimates have under the observer's gain, which the sd_ columns of the estimates are from; "
    "with fading memory it is not the filter's own P, which is about twice as large"
)
_PIECE_ROWS = 1 << 12
TRIANGLE = "upper, row by row, diagonal included"


def covariance_layout(names: Sequence[str], units: Sequence[str], *, tick_rate_Hz: float, every: int) -> Layout:
    """Columns tick, then A*B for each pair of entries A, B of the upper triangle, row by row, in unit(A)·unit(B), SI.

    `names` are those of the estimates' columns.
    """
    pairs = zip(*_triangle(len(names)), strict=True)
    columns = [Column(f"{names[i]}*{names[j]}", "f8", f"{units[i]}·{units[j]}") for i, j in pairs]
    header = {
        "tick_rate_Hz": tick_rate_Hz,
        "every": every,
        "entries": list(names),
        "units": list(units),
        "triangle": TRIANGLE,
        "meaning": MEANING,
    }
    return Layout("covariance", (TICK, *columns), block_rows_for(tick_rate_Hz / every), header)


def packed(covariance: Floats) -> list[float]:
    """The upper triangle of (n, n), row by row, as a row of the file holds it."""
    return list(covariance[_triangle(len(covariance))].tolist())


@dataclass(frozen=True)
class Covariance(Table):
    """Covariance of a run, read; its rows are at ticks that the estimates have too."""

    KIND = "covariance"

    def pieces(self) -> Iterator[Self]:
        """The record in parts that memory always has room for, one after another."""
        for _, columns in pieces_of(self.columns, _PIECE_ROWS):
            yield self._of(columns)

    @property
    def entries(self) -> tuple[str, ...]:
        """What is estimated, by the names of the estimates' columns: the order of the matrices."""
        return tuple(self.header["entries"])

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of each entry."""
        return tuple(self.header["units"])

    @cached_property
    def matrices(self) -> Floats:
        """The covariances (n, entries, entries), symmetric, SI."""
        n = len(self.entries)
        rows, columns = _triangle(n)
        full = np.empty((len(self), n, n))
        values = np.stack([self.columns[name] for name in list(self.columns)[1:]], axis=1)
        full[:, rows, columns] = values
        full[:, columns, rows] = values
        return full

    def _flaw(self) -> str:
        entries = list(self.header.get("entries", []))
        wanted = ["tick", *(f"{entries[i]}*{entries[j]}" for i, j in zip(*_triangle(len(entries)), strict=True))]
        if not entries or list(self.columns) != wanted:
            return "its columns are not those of its entries; run or replay again"
        return ""


@cache
def _triangle(n: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    return np.triu_indices(n)
