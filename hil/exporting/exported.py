"""What `hil export` writes: tables of columns with units, read piece by piece from a run folder or a record file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from hil.errors import InputError
from hil.importing.read_back import HEADER, header_of, not_carried
from hil.records.blocks import scan_blocks
from hil.records.capture import COMPONENTS, Capture, RowFlag, read_capture
from hil.records.estimates import Estimates, Innovation
from hil.records.rates import beside_rates, rates_rad_s
from hil.records.units import unit_of

What = Literal["capture", "estimates", "angle", "rate", "board_estimates", "innovation", "force"]
WHAT: tuple[What, ...] = get_args(What)
Columns = dict[str, npt.NDArray[Any]]

_ANGLE = ("angle_rad", "angle_u_rad", "valid")
_RATE = ("rate_rad_s", "sd_rate_rad_s")


@dataclass(frozen=True)
class Exported:
    """A table: `t_s` first, then columns (n,) with a unit each, "" where it is a number.

    pieces: its rows from the first to the last, in parts that memory has room for; about: what the numbers mean, as
    JSON has it.
    """

    name: What
    rows: int
    units: Mapping[str, str]
    pieces: Callable[[], Iterator[Columns]]
    about: Mapping[str, Any] = field(default_factory=dict)
    beside: tuple[str, ...] = ()
    """What a file of columns alone does not carry, in words."""
    cut: str = ""
    """That the record was interrupted, where it was."""


def tables_of(place: Path, wanted: Sequence[What]) -> list[Exported]:
    """The tables called `wanted` of a run folder, a record file, or the force.arrow of a trace; without a name all that
    are there of capture, estimates, the board's own, innovation and force.

    Raises InputError for one that is not there, and for a file that is no record.
    """
    names: Sequence[What] = wanted or ("capture", "estimates", "board_estimates", "innovation", "force")
    found = [table for name in dict.fromkeys(names) if (table := _table(place, name, asked=bool(wanted))) is not None]
    if not found:
        raise InputError(f"{place}: nothing to export; give a run folder, or one of its .arrow files")
    return found


def channels(capture: Capture) -> Columns:
    """The interchange columns of a capture, in SI units and in the order of the file."""
    axes = "xy"[: capture.axes]
    columns: Columns = {"t_s": capture.t_s}
    suffix = "V" if capture.sense_unit == "V" else "sensed"  # in the sensor's own unit, which its header says
    parts = ("",) if capture.carrier_Hz is None else COMPONENTS
    named = [f"{axis}_{part}" for part in parts for axis in axes]
    columns |= {f"v{name}{suffix}": capture.sense_V[:, index] for index, name in enumerate(named)}
    if capture.has_drive:
        columns |= {f"u{name}{capture.drive_unit}": capture.drive[:, index] for index, name in enumerate(named)}
    columns |= {f"rate_{axis}_rad_s": values for axis, values in rates_rad_s(capture).items()}
    columns |= beside_rates(capture)
    for name, values in (("rate_rad_s", capture.rate_rad_s), ("temp_C", capture.temp_C)):
        if values is not None:
            columns[name] = values
    return columns


def _table(place: Path, name: What, *, asked: bool) -> Exported | None:
    """The table, or None where it is not there and was not asked for."""
    home = "estimates" if name in ("angle", "rate") else name
    path = place / f"{home}.arrow" if place.is_dir() else place
    kind = home if place.is_dir() else _kind(place)
    if not path.exists() or kind != home:
        if asked:
            held = f"there is no {home}.arrow in it" if place.is_dir() else f"it holds {kind}"
            raise InputError(f"{place}: no {name} to export: {held}; give the run folder that has one")
        return None
    return _READERS[name](path)


def _kind(path: Path) -> str:
    from hil.records.force import is_force

    return "force" if is_force(path) else str(scan_blocks(path, None).header["kind"])


def _capture(path: Path) -> Exported:
    capture = read_capture(path)
    about = {
        "kind": "capture",
        "tick_rate_Hz": capture.tick_rate_Hz,
        "hold": capture.hold,
        "latency_ticks": capture.latency_ticks,
        "segments": capture.segments,
        "sense_unit": capture.sense_unit,
        "covariates": capture.covariates,
        "prepared": capture.prepared,
        "complete": capture.complete,
        "identity": capture.header.get("identity"),
        HEADER: header_of(capture),
    }
    units = {name: _capture_unit(name, capture) for name in ("tick", *channels(capture.part(0, 0)), "flags")}
    return Exported(
        "capture", len(capture), units, lambda: _capture_pieces(capture), about, not_carried(capture), capture.cut
    )


def _capture_unit(name: str, capture: Capture) -> str:
    return capture.sense_unit if name.endswith("_sensed") else unit_of(name)


def _capture_pieces(capture: Capture) -> Iterator[Columns]:
    before = None
    for piece in capture.pieces():
        columns = {"tick": piece.tick, **channels(piece), "flags": piece.flags}
        if before is not None and columns["tick"][0] != before + 1:  # the gap that lies between two pieces
            columns["flags"][0] |= np.uint8(RowFlag.GAP_BEFORE)
        before = columns["tick"][-1]
        yield columns


def _estimates(path: Path, name: What = "estimates", only: Sequence[str] = ()) -> Exported:
    estimates = Estimates.read(path)
    if only and only[0] not in estimates:
        raise InputError(f"{path}: its model has no {only[0]}; export the estimates")
    names = [column for column in (only or estimates.columns) if column in estimates and column != "tick"]
    units = {"tick": "", "t_s": "s", **{column: estimates.unit(column) for column in names}}
    about = {
        "kind": name,
        "tick_rate_Hz": estimates.tick_rate_Hz,
        "states": estimates.states,
        "complete": estimates.complete,
        "sd_": "standard deviation of the state",
        "angle_u_rad": "standard uncertainty of the angle, k = 1",
        "angle_zero": estimates.zero,
    }

    def pieces() -> Iterator[Columns]:
        for piece in estimates.pieces():
            yield {"tick": piece.tick, "t_s": piece.t_s, **{column: piece[column] for column in names}}

    return Exported(name, len(estimates), units, pieces, about, cut=estimates.cut)


def _board(path: Path) -> Exported:
    return _estimates(path, "board_estimates")


def _angle(path: Path) -> Exported:
    return _estimates(path, "angle", _ANGLE)


def _rate(path: Path) -> Exported:
    return _estimates(path, "rate", _RATE)


def _innovation(path: Path) -> Exported:
    innovation = Innovation.read(path)
    names = [name for name in innovation.columns if name != "tick"]
    about = {"kind": "innovation", "tick_rate_Hz": innovation.tick_rate_Hz, "complete": innovation.complete}

    def pieces() -> Iterator[Columns]:
        for piece in innovation.pieces():
            yield {"tick": piece.tick, "t_s": piece.t_s, **{name: piece.columns[name] for name in names}}

    units = {"tick": "", "t_s": "s", **{name: str(innovation.header["columns"][name]["unit"]) for name in names}}
    return Exported("innovation", len(innovation), units, pieces, about, cut=innovation.cut)


def _force(path: Path) -> Exported:
    from hil.records.force import load_force

    force = load_force(path)
    units = {name: unit_of(name) for name in force.column_names}

    def pieces() -> Iterator[Columns]:
        for batch in force.to_batches():
            yield {name: batch.column(name).to_numpy(zero_copy_only=False) for name in force.column_names}

    return Exported("force", int(force.num_rows), units, pieces, {"kind": "force", "per": "mass"})


_READERS: Mapping[What, Callable[[Path], Exported]] = {
    "capture": _capture,
    "estimates": _estimates,
    "angle": _angle,
    "rate": _rate,
    "board_estimates": _board,
    "innovation": _innovation,
    "force": _force,
}
