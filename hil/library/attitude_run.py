"""Several gyros that were run at once, as arrays."""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.library.finished_run import Run
from hil.library.series import Series
from hil.records.attitude import AttitudeRecord, AttitudeResult, load_attitude_result, read_attitude
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from hil.records.result import Result


class AttitudeRun(Run):
    """What `hil.run` of a list of benches gives: the runs, and the attitude of the body that carries them. What a `Run`
    has of one board is in each of `runs`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(RunFolder(path))

    @cached_property
    def runs(self) -> tuple[Run, ...]:
        """The run of each gyro, in the order of the benches."""
        return tuple(Run(RunFolder.open(self.path / axis.run)) for axis in self.figures.axes)

    @cached_property
    def figures(self) -> AttitudeResult:
        """As in attitude.json: verdict, quaternion at the end with its uncertainty, coning, what stopped all."""
        return load_attitude_result(self.path)

    @property
    def result(self) -> "Result":
        """Of one board; raises InputError, as this is of several."""
        from hil.errors import InputError

        raise InputError(f"{self.path}: of several gyros; see figures, and result of each of runs")

    @property
    def verdict(self) -> str:
        """The worst of its runs."""
        return str(self.figures.verdict)

    @cached_property
    def attitude(self) -> Series:
        """`q_w`, `q_x`, `q_y`, `q_z` (body to reference), covariance `c_…_rad2`, standard uncertainty `u_rad`, coning.
        Raises InputError where there is none.
        """
        record = self._record
        told: dict[str, Any] = dict(record.header["columns"])
        names = [name for name in told if name != "tick"]
        return Series(record.t_s, {name: record.columns[name] for name in names}, {n: told[n]["unit"] for n in names})

    @property
    def quaternion(self) -> Any:
        """(n, 4), scalar first. Raises InputError where there is none."""
        return self._record.quaternion

    @cached_property
    def _record(self) -> AttitudeRecord:
        if self.figures.without:
            from hil.errors import InputError

            raise InputError(f"{self.path}: no attitude: {self.figures.without}")
        return read_attitude(self.path / "attitude.arrow")

    def report(self) -> Path:
        """The page of all, report.html."""
        return self.path / "report.html"

    def __repr__(self) -> str:
        return f"<AttitudeRun {self.path}: {self.verdict}>"
