"""A run that has been recorded, as arrays."""

from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy.typing as npt

from hil.bench import Bench, load_bench
from hil.errors import InputError
from hil.library.series import Floats, Series
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.records.units import unit_of

_Record = TypeVar("_Record")


class Run:
    """The run in a folder. What is large is read when asked for."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder

    @property
    def path(self) -> Path:
        """Its folder."""
        return self._folder.path

    @cached_property
    def bench(self) -> Bench:
        """The bench file as run."""
        return load_bench(self._folder.bench_path)

    @property
    def result(self) -> Result:
        """Figures, verdict and its parts, as in result.json. Raises InputError where the run has none yet."""
        if (found := self._folder.result) is None:
            raise InputError(f"{self.path}: no result.json; hil.replay works its figures out")
        return found

    @property
    def verdict(self) -> str:
        """`good`, `failed`, `interrupted` or `unsafe`."""
        return str(self.result.verdict)

    @cached_property
    def capture(self) -> Series:
        """What was sensed and driven: `vx_V`, `vy_V`, `ux_…`, `uy_…`, and reference rate and temperature if any."""
        from hil.interchange.exported import channels

        capture = self._there(self._folder.capture, "capture.arrow")
        columns = channels(capture)
        units = {name: capture.drive_unit if name[:2] in ("ux", "uy") else unit_of(name) for name in columns}
        return Series(columns.pop("t_s"), columns, units, {"run": self.path.name, "hold": capture.hold})

    @cached_property
    def estimates(self) -> Series:
        """Every state and its standard deviation (`sd_…`), and of two axes the angle with all that belongs to it."""
        estimates = self._there(self._folder.estimates, "estimates.arrow")
        columns = {name: values for name, values in estimates.columns.items() if name != "tick"}
        return self._series(estimates.t_s, columns, {name: estimates.unit(name) for name in columns})

    @cached_property
    def angle(self) -> Series:
        """`angle_rad`, its standard uncertainty `angle_u_rad` (k = 1), and `valid`, where the angle means something."""
        return self._some("angle_rad", "angle_u_rad", "valid")

    @cached_property
    def rate(self) -> Series:
        """`rate_rad_s` and its standard deviation `sd_rate_rad_s`."""
        return self._some("rate_rad_s", "sd_rate_rad_s")

    @cached_property
    def innovation(self) -> Series:
        """Measured minus predicted voltage of every sample, `nu_x_V` …, and its predicted deviation, `s_x_V` …"""
        innovation = self._there(self._folder.innovation, "innovation.arrow")
        columns = {name: values for name, values in innovation.columns.items() if name != "tick"}
        return self._series(innovation.t_s, columns, dict.fromkeys(columns, "V"))

    def report(self) -> Path:
        """The page of the run, report.html; written where it is missing."""
        if not self._folder.report_path.exists():
            from hil.report import write_report

            write_report(self.path)
        return self._folder.report_path

    def _some(self, first: str, *more: str) -> Series:
        every = self.estimates
        if first not in every:
            raise InputError(f"{self.path}: its model has no {first}; it has {', '.join(every)}")
        names = [name for name in (first, *more) if name in every]
        return self._series(every.t_s, {n: every[n] for n in names}, {n: every.units[n] for n in names})

    def _series(self, t_s: Floats, columns: dict[str, npt.NDArray[Any]], units: dict[str, str]) -> Series:
        return Series(t_s, columns, units, {"run": self.path.name})

    def _there(self, record: _Record | None, name: str) -> _Record:
        if record is None:
            raise InputError(f"{self.path / name}: not there; the run has not recorded it")
        return record

    def __repr__(self) -> str:
        result = self._folder.result
        return f"<Run {self.path}: {'no result yet' if result is None else result.verdict}>"
