"""`estimates.arrow`: the observer's state with its standard deviations, and the angle, every few samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from hil.records.layout import TICK, Column, Layout, block_rows_for
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

    @property
    def ends_s(self) -> tuple[float, float]:
        """Bench time of the first row and of the last, of estimates that are not empty."""
        return float(self.part(0, 1).t_s[0]), float(self.part(len(self) - 1, len(self)).t_s[0])

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        return self.columns[name]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the state columns, with their units, e.g. `kxx_per_s2`."""
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
        """Unit of a column."""
        return str(self.header["columns"][name]["unit"])

    def _flaw(self) -> str:
        states = self.header.get("states", [])
        missing = [name for state in states for name in (state, f"sd_{state}") if name not in self.columns]
        if missing or not states:
            return f"lacks {', '.join(missing) or 'its list of states'}; run or replay again"
        return ""


read_estimates = Estimates.read


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
    columns = [TICK]
    for prefix in ("", "sd_"):
        columns += [Column(prefix + name, "f8", unit_of(name)) for name in states]
    columns += [Column(name, "f8", unit_of(name)) for name in ("angle_rad", "angle_sd_rad")]
    columns += [Column("valid", "u1"), Column("driving", "u1")]
    declared = {name: header[name] for name in _DECLARED}
    full_header = {"tick_rate_Hz": tick_rate_Hz, "every": every, "states": list(states), "by": "board", **declared}
    return Layout("estimates", tuple(columns), block_rows_for(tick_rate_Hz / every), full_header)
