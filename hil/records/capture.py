"""`capture.arrow`: what the sensors said and what the drives did, sample by sample, in bench time only.

A capture is either recorded from a board (integer codes with their scales) or imported (SI values). Readers
see no difference: volts, drive in its unit, seconds. Row m carries the sense values at t_m and, for hold
`zoh`, the drive that acted over the interval that ends at t_m; for `foh` and `bandlimited`, the drive's
value at t_m.

`trims.arrow`: the voltages of the trim outputs, one row for each change.

`tick` is the sample before which the observer was told, `acted_tick` the one from which on they were put out.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntFlag
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self, get_args

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.records.blocks import Columns
from hil.records.layout import BENCH, TICK, Column, Layout, block_rows_for
from hil.records.table import Table
from hil.records.units import unit_of

Floats = npt.NDArray[np.float64]
Hold = Literal["zoh", "foh", "bandlimited"]
DriveUnit = Literal["mps2", "N", "V"]

DRIVE_UNITS: tuple[DriveUnit, ...] = get_args(DriveUnit)
_AXES = ("x", "y")
COMPONENTS = ("i_", "q_")
"""Of a demodulated stream, in its columns' names: in phase, in quadrature."""

TIME_LOCKSTEP = "bench time, which here is the board's own: it waits for the host at every tick"
TIME_RUNNING = "bench time: ticks of the board's own clock; clock.arrow relates it to the host's"
TIME_IMPORTED = "as in the file it was imported from"


class RowFlag(IntFlag):
    """Bits of a capture's `flags` column."""

    LATE_ANSWER_HELD = 1
    ADC_CLIPPED = 2
    DRIVE_SATURATED = 4
    GAP_BEFORE = 8


def missing(lost: int, gaps: int) -> str:
    """So many samples in so many gaps, in words."""
    samples = "1 sample is" if lost == 1 else f"{lost} samples are"
    return f"{samples} missing, in {gaps} gap{'' if gaps == 1 else 's'}"


@dataclass(frozen=True)
class Capture(Table):
    """One record."""

    KIND = "capture"

    @property
    def uniform(self) -> bool:
        """Whether samples are 1/tick_rate_Hz apart (gaps in `tick` excepted)."""
        return bool(self.header.get("uniform", True))

    @property
    def steady(self) -> bool:
        """Whether each row is a steady state of its own, so that time means nothing."""
        return bool(self.header.get("steady", False))

    @property
    def sense_unit(self) -> str:
        """Unit of the sense channels: V, or the sensor's own."""
        name = self._pick("vx_")
        return "V" if name is None else str(self.header["columns"][name]["unit"])

    @property
    def covariates(self) -> dict[str, float]:
        """What was other on other records of the same device, by name: a load, a serial number."""
        return dict(self.header.get("covariates", {}))

    @property
    def noise_gain(self) -> float:
        """What the filter that the record passed leaves of white noise, rms over rms."""
        return float(self.header.get("noise_gain", 1.0))

    @property
    def prepared(self) -> tuple[str, ...]:
        """What was done to the record as it was imported, a sentence each."""
        return tuple(self.header.get("prepared", ()))

    @property
    def told(self) -> tuple[str, ...]:
        """The same, and that it was interrupted, where it was: for what is made of the whole of it."""
        return (*self.prepared, *filter(None, [self.cut]))

    @property
    def carrier_Hz(self) -> float | None:
        """Of demodulated streams: what X and Y are the components of, X cos ωt − Y sin ωt; None of samples."""
        carrier = self.header.get("carrier_Hz")
        return None if carrier is None else float(carrier)

    @property
    def hold(self) -> Hold:
        """What the drive does between samples."""
        hold: Hold = self.header["hold"]
        return hold

    @property
    def latency_ticks(self) -> int:
        """A drive computed from row m first acts at tick m + latency."""
        return int(self.header["latency_ticks"])

    @property
    def segments(self) -> dict[str, tuple[int, int]]:
        """Named parts of the record as row ranges [start, stop), e.g. train and test."""
        return {name: (start, stop) for name, (start, stop) in self.header.get("segments", {}).items()}

    @cached_property
    def t_s(self) -> Floats:
        """Time of each row (n,) in seconds of bench time."""
        return self.columns["t_s"] if "t_s" in self.columns else self.tick / self.tick_rate_Hz

    @cached_property
    def sense_V(self) -> Floats:
        """Sensed voltages (n, axes); of demodulated streams (n, 4): x and y in phase, then both in quadrature."""
        return self._stack([self._pick(prefix) for prefix in self._prefixes("v")])

    @cached_property
    def drive(self) -> Floats:
        """Drive, as `sense_V`, in `drive_unit`; zero for a free response recorded without a drive channel."""
        return self._stack([self._pick(prefix) for prefix in self._prefixes("u")])

    @property
    def has_drive(self) -> bool:
        """Whether the record has a drive channel at all."""
        return self._pick("ux_") is not None

    @property
    def drive_unit(self) -> DriveUnit:
        """Unit of `drive`: `mps2`, `N` or `V`."""
        name = self._pick("ux_")
        unit: DriveUnit = "mps2" if name is None else self.header["columns"][name]["unit"]
        return unit

    @cached_property
    def flags(self) -> npt.NDArray[np.uint8]:
        """`RowFlag` bits of each row (n,); a jump in `tick` is flagged whatever caused it."""
        stored = self.columns.get("flags")
        flags = np.zeros(len(self), np.uint8) if stored is None else stored.copy()
        flags[1:][np.diff(self.tick) != 1] |= np.uint8(RowFlag.GAP_BEFORE)
        return flags

    @property
    def lost(self) -> int:
        """How many samples are missing between its first and its last."""
        first, last = self.ends if len(self) else (0, -1)
        return last + 1 - first - len(self)

    @property
    def gaps(self) -> int:
        return int(np.count_nonzero(np.diff(self.tick) > 1))

    @property
    def rate_rad_s(self) -> Floats | None:
        """Reference rate (n,), when the record has one."""
        return self.columns.get("rate_rad_s")

    @property
    def temp_C(self) -> Floats | None:
        """Temperature (n,), when the record has one."""
        return self.columns.get("temp_C")

    def segment(self, name: str) -> Self:
        """The part called `name`. Raises InputError with the names there are."""
        if name not in self.segments:
            known = ", ".join(self.segments) or "none"
            raise InputError(f"segment {name!r}: not in this capture; it has: {known}")
        return self.part(*self.segments[name])

    def _of(self, columns: Columns) -> Self:
        return replace(self, columns=columns, header={k: v for k, v in self.header.items() if k != "segments"})

    def _prefixes(self, stem: str) -> list[str]:
        parts = ("",) if self.carrier_Hz is None else COMPONENTS
        return [f"{stem}{axis}_{part}" for part in parts for axis in _AXES[: self.axes]]

    def _pick(self, prefix: str) -> str | None:
        return next((name for name in self.columns if name.startswith(prefix)), None)

    def _stack(self, names: Sequence[str | None]) -> Floats:
        scales = self.header["columns"]
        values = np.zeros((len(self), len(names)))
        for axis, name in enumerate(names):
            if name is not None:
                np.multiply(self.columns[name], scales[name]["scale"], out=values[:, axis])
        return values

    def _flaw(self) -> str:
        sensed = any(name.startswith("vx_") or re.fullmatch("rate_.+_code", name) for name in self.columns)
        if "tick" not in self.columns or not sensed:
            return "a capture without tick or vx column; record or import it again"
        return ""


read_capture = Capture.read


def board_layout(
    *,
    tick_rate_Hz: float,
    axes: int,
    latency_ticks: int,
    sense_scale_V: float,
    drive_scale: float,
    identity: Mapping[str, Any] | None = None,
    lockstep: bool = False,
    sense_unit: str = "V",
) -> Layout:
    """Layout of a capture recorded from a board: tick, codes (`vx_code`, …, `uy_code`), flags.

    `sense_scale_V` is volts per code, `drive_scale` is m/s² per code, held until the next; `identity` (JSON values) is
    what the board said of itself. `lockstep` says that the board waited for the host at every tick. `sense_unit` is
    what a volt of the board's scale is called, where the sensor has another unit.
    """
    names = _AXES[:axes]
    columns = (
        TICK,
        *(Column(f"v{axis}_code", "i4", sense_unit, sense_scale_V) for axis in names),
        *(Column(f"u{axis}_code", "i4", "mps2", drive_scale) for axis in names),
        Column("flags", "u1"),
    )
    header = {
        "tick_rate_Hz": tick_rate_Hz,
        "axes": axes,
        "hold": "zoh",
        "latency_ticks": latency_ticks,
        "time": TIME_LOCKSTEP if lockstep else TIME_RUNNING,
        "identity": dict(identity) if identity is not None else None,
    }
    return Layout("capture", columns, block_rows_for(tick_rate_Hz), header)


def import_layout(
    names: Sequence[str],
    *,
    tick_rate_Hz: float,
    uniform: bool,
    hold: Hold,
    segments: Mapping[str, tuple[int, int]],
    steady: bool = False,
    sense_unit: str = "V",
    told: Mapping[str, Any] | None = None,
) -> Layout:
    """Layout of an imported capture: tick, then SI columns named as in the interchange CSV (`t_s`, `vx_V`,
    …), of a sensor with a unit of its own `vx_sensed`; `told` goes into the header as it is.
    """
    columns = [TICK]
    for name in names:
        drive = name.startswith(("ux_", "uy_"))
        unit = name.rsplit("_", 1)[1] if drive else sense_unit if name.endswith("_sensed") else unit_of(name)
        columns.append(Column(name, "f8", unit, clock=BENCH if name == "t_s" else ""))
    header = {
        "tick_rate_Hz": tick_rate_Hz,
        "axes": 2 if any(name.startswith("vy_") for name in names) else 1,
        "hold": hold,
        "latency_ticks": 0,
        "time": TIME_IMPORTED,
        "uniform": uniform,
        **({"steady": True} if steady else {}),
        "segments": {name: list(rows) for name, rows in segments.items()},
        **(told or {}),
        "identity": None,
    }
    return Layout("capture", tuple(columns), block_rows_for(tick_rate_Hz), header)


TRIMS = "trims.arrow"
_BLOCK_ROWS = 64


def trims_layout(outputs: Sequence[Mapping[str, Any]], *, tick_rate_Hz: float) -> Layout:
    """Columns tick, acted_tick, and `NAME_V` of each of `outputs`, whose tables stand in the header: name, register,
    lowest_V, highest_V, settling_s, softening_per_s2_per_V2 and softening_u_per_s2_per_V2 as [xx, yy, xy].
    """
    columns = [TICK, Column("acted_tick", "i8", clock=BENCH)]
    columns += [Column(f"{one['name']}_V", "f8", "V") for one in outputs]
    return Layout("trims", tuple(columns), _BLOCK_ROWS, {"tick_rate_Hz": tick_rate_Hz, "outputs": list(outputs)})


class Trims(Table):
    KIND = "trims"

    @property
    def outputs(self) -> list[dict[str, Any]]:
        return list(self.header["outputs"])

    @property
    def volts(self) -> npt.NDArray[np.float64]:
        """(n, outputs)"""
        return np.column_stack([self.columns[f"{one['name']}_V"] for one in self.outputs])


def trims_beside(capture: Path) -> Trims | None:
    """The changes of the run that a capture is of, None where nothing was trimmed."""
    path = capture.parent / TRIMS
    return Trims.read(path) if path.exists() else None
