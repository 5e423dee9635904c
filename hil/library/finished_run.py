"""A run that has been recorded, as arrays."""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from hil.errors import InputError
from hil.library.as_series import ANGLE, RATE, chosen, of_capture, of_estimates, of_innovation
from hil.library.series import Series
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from hil.bench import Bench
    from hil.records.result import Result

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
    def bench(self) -> "Bench":
        """The bench file as run."""
        from hil.bench import load_bench

        return load_bench(self._folder.bench_path)

    @property
    def result(self) -> "Result":
        """Figures, verdict and its parts, as in result.json. Raises InputError where the run has none yet."""
        if (found := self._folder.result) is None:
            raise InputError(f"{self.path}: no result.json; hil.replay computes its figures")
        return found

    @property
    def verdict(self) -> str:
        """`good`, `failed`, `interrupted` or `unsafe`."""
        return str(self.result.verdict)

    @cached_property
    def capture(self) -> Series:
        """What was sensed and driven: `vx_V`, `vy_V`, `ux_…`, `uy_…`, and reference rate and temperature if any."""
        return of_capture(self._there(self._folder.capture, "capture.arrow"), self.path.name)

    @cached_property
    def estimates(self) -> Series:
        """Every state and its standard deviation (`sd_…`), and of two axes the angle with all that belongs to it."""
        return of_estimates(self._there(self._folder.estimates, "estimates.arrow"), self.path.name)

    @cached_property
    def angle(self) -> Series:
        """`angle_rad`, its standard uncertainty `angle_u_rad` (k = 1), and `valid`, where the angle means something."""
        return chosen(self.estimates, ANGLE)

    @cached_property
    def rate(self) -> Series:
        """`rate_rad_s` and its standard deviation `sd_rate_rad_s`."""
        return chosen(self.estimates, RATE)

    @cached_property
    def innovation(self) -> Series:
        """Measured minus predicted voltage of every sample, `nu_x_V` …, and its predicted deviation, `s_x_V` …"""
        return of_innovation(self._there(self._folder.innovation, "innovation.arrow"), self.path.name)

    def report(self) -> Path:
        """The page of the run, report.html; written where it is missing."""
        if not self._folder.report_path.exists():
            from hil.report.page import write_report

            write_report(self.path)
        return self._folder.report_path

    def _there(self, record: _Record | None, name: str) -> _Record:
        if record is None:
            raise InputError(f"{self.path / name}: not there; the run has not recorded it")
        return record

    def __repr__(self) -> str:
        result = self._folder.result
        return f"<Run {self.path}: {'no result yet' if result is None else result.verdict}>"
