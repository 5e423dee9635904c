"""`board_estimates.arrow`: what the board's own estimator said of itself, in board mode, every few samples."""

from collections.abc import Mapping, Sequence
from typing import Any

from hil.records.layout import TICK, Column, Layout, block_rows_for
from hil.records.units import unit_of

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
