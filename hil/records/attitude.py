"""`attitude.arrow` and `attitude.json`: the attitude of a body that carries three gyros, each with a run of its own."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from hil.records import json_file
from hil.records.layout import TICK, Column, Layout, block_rows_for
from hil.records.stream import write_counted
from hil.records.table import Table

QUATERNION = ("q_w", "q_x", "q_y", "q_z")
COVARIANCE = ("c_xx_rad2", "c_yy_rad2", "c_zz_rad2", "c_xy_rad2", "c_xz_rad2", "c_yz_rad2")
CONING = ("coning_x_rad", "coning_y_rad", "coning_z_rad")


def attitude_layout(*, rate_Hz: float, start_s: float) -> Layout:
    """Columns tick, quaternion (body to reference), covariance of the small rotation by which it is off (reference
    frame), its root trace, coning so far (body frame); `start_s` is the time of tick 0 on the runs' common clock."""
    columns = (
        TICK,
        *(Column(name, "f8") for name in QUATERNION),
        *(Column(name, "f8", "rad²") for name in COVARIANCE),
        Column("u_rad", "f8", "rad"),
        *(Column(name, "f8", "rad") for name in CONING),
    )
    return Layout("attitude", columns, block_rows_for(rate_Hz), {"tick_rate_Hz": rate_Hz, "start_s": start_s})


@dataclass(frozen=True)
class AttitudeRecord(Table):
    KIND = "attitude"

    @property
    def quaternion(self) -> np.ndarray:
        """(n, 4), scalar first."""
        return np.column_stack([self.columns[name] for name in QUATERNION])

    @property
    def coning(self) -> np.ndarray:
        """(n, 3) [rad]."""
        return np.column_stack([self.columns[name] for name in CONING])


def write_attitude(path: Path, layout: Layout, columns: np.ndarray) -> None:
    """Write the file; columns (n, 14) in the order of the layout, without tick."""
    write_counted(path, layout, columns)


class AxisOfBody(json_file.Strict):
    """One gyro of the body."""

    name: str = Field(description="x, y, z: first, second and third bench file")
    run: str = Field(description="Its run folder, beside this file")
    verdict: str | None = Field(description="Of its run")
    direction: tuple[float, float, float]
    angle_rad: float | None = Field(default=None, description="About its axis, over the attitude's time")
    angle_u_rad: float | None = Field(default=None, description="Standard uncertainty of that")
    clock_u_s: float | None = Field(default=None, description="Of its time on the common clock; null: lockstep")


class OneStop(json_file.Strict):
    """What stopped all of them."""

    by: str = Field(description="The axis whose run ended early, or Ctrl-C")
    safe_after_s: dict[str, float] = Field(
        description="By axis: from that until its board had confirmed SAFE, on the host's clock"
    )
    unconfirmed: tuple[str, ...] = Field(default=(), description="Axes whose board did not confirm it")


class AttitudeResult(json_file.Sealed):
    """Figures of several gyros run at once."""

    verdict: Literal["good", "failed", "interrupted", "unsafe"]
    axes: tuple[AxisOfBody, ...]
    seconds: float | None = Field(default=None, description="Length of the attitude")
    quaternion: tuple[float, float, float, float] | None = Field(
        default=None, description="At its end, scalar first, body to reference; the reference is the body at its start"
    )
    u_rad: float | None = Field(default=None, description="Standard uncertainty, root sum square over three axes")
    coning_rad: float | None = Field(
        default=None, description="Coning: magnitude of the sum of what the rotation vectors have beyond the angles"
    )
    without: str = Field(default="", description="Why there is no attitude; empty where there is one")
    stop: OneStop | None = None


def save_attitude_result(folder: Path, result: AttitudeResult) -> None:
    json_file.save(folder / "attitude.json", result)


def load_attitude_result(folder: Path) -> AttitudeResult:
    """Read `attitude.json`. Raises InputError."""
    return json_file.load(
        folder / "attitude.json", AttitudeResult, give="a folder of several gyros", anew="run them again"
    )
