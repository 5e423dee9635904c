"""What is there already is opened at once: neither estimator nor bench files are loaded for it."""

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy.typing as npt

from hil.errors import InputError
from hil.errors.input import path_of
from hil.library.keywords import said_of_arguments
from hil.library.series import Series
from hil.records.capture import Capture
from hil.records.estimates import Estimates, Innovation
from hil.records.runfolder import RunFolder
from hil.records.runs import named, named_trace
from hil.records.units import unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hil.bench import Bench
    from hil.records.attitude import AttitudeRecord, AttitudeResult
    from hil.records.diagnosis import Diagnosis, Effect, Separation
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


ANGLE = ("angle_rad", "angle_u_rad", "valid")
RATE = ("rate_rad_s", "sd_rate_rad_s")


def of_capture(capture: Capture, run: str) -> Series:
    """What was sensed and driven, and reference rate and temperature if any."""
    from hil.exporting.exported import channels

    columns = channels(capture)
    units = {name: capture.sense_unit if name.endswith("_sensed") else unit_of(name) for name in columns}
    carrier = {} if capture.carrier_Hz is None else {"demodulated": str(capture.carrier_Hz)}
    return Series(columns.pop("t_s"), columns, units, {"run": run, "hold": capture.hold, **carrier})


def of_estimates(estimates: Estimates, run: str) -> Series:
    """States, standard deviations, and of two axes the angle with all that belongs to it."""
    columns = {name: values for name, values in estimates.columns.items() if name != "tick"}
    if "valid" in columns:
        columns["valid"] = estimates.valid  # true or false, as the file has it in bytes, which would be places of rows
    return Series(estimates.t_s, columns, {name: estimates.unit(name) for name in columns}, {"run": run})


def of_innovation(innovation: Innovation, run: str) -> Series:
    """Measured minus predicted voltage, and its predicted deviation."""
    columns: dict[str, npt.NDArray[Any]] = {n: v for n, v in innovation.columns.items() if n != "tick"}
    return Series(innovation.t_s, columns, dict.fromkeys(columns, innovation.unit), {"run": run})


def chosen(every: Series, names: tuple[str, ...]) -> Series:
    """Those columns of estimates that are there.  Raises InputError where the first is not."""
    if names[0] not in every:
        raise InputError(f"{every.header.get('run')}: its model has no {names[0]}; it has {', '.join(every)}")
    there = [name for name in names if name in every]
    return Series(every.t_s, {n: every[n] for n in there}, {n: every.units[n] for n in there}, every.header)


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
    def figures(self) -> "AttitudeResult":
        """As in attitude.json: verdict, quaternion at the end with its uncertainty, coning, what stopped all."""
        from hil.records.attitude import load_attitude_result  # models, which arrays do not need

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
    def _record(self) -> "AttitudeRecord":
        if self.figures.without:
            from hil.errors import InputError

            raise InputError(f"{self.path}: no attitude: {self.figures.without}")
        from hil.records.attitude import AttitudeRecord

        return AttitudeRecord.read(self.path / "attitude.arrow")

    def report(self) -> Path:
        """The page of all, report.html."""
        return self.path / "report.html"

    def __repr__(self) -> str:
        return f"<AttitudeRun {self.path}: {self.verdict}>"


class Trace:
    """The answer of a trace, and the folder where it is kept."""

    def __init__(self, folder: Path, diagnosis: "Diagnosis") -> None:
        self._folder = folder
        self.diagnosis = diagnosis

    @property
    def path(self) -> Path:
        """Folder with diagnosis.json, bench.toml and report.html."""
        return self._folder

    @property
    def verdict(self) -> str:
        """`adequate`, `explained`, `partly explained` or `unexplained`."""
        return str(self.diagnosis.verdict)

    @property
    def effects(self) -> "tuple[Effect, ...]":
        """What acts, or acts like it, in the order of what it explains; coefficients with their 95 % intervals."""
        return self.diagnosis.effects

    @property
    def ambiguity_groups(self) -> tuple[tuple[str, ...], ...]:
        """Effects that the record cannot tell apart, the named one first."""
        return self.diagnosis.ambiguity_groups

    @property
    def separations(self) -> "tuple[Separation, ...]":
        """Of each group, the named effect with every other member, and the experiment that separates them."""
        return self.diagnosis.separations

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the verdict is what it is, a sentence each."""
        return self.diagnosis.reasons

    def add_to(self, bench: "Bench") -> "Bench":
        """`bench` with the effects found declared, for the next run.  Raises InputError where there is nothing to add:
        only what is explained is declared.
        """
        from hil.tracing.addition import additions

        found = additions(self.diagnosis)
        if self.diagnosis.fault:
            raise InputError(f"there is nothing to add: {self.diagnosis.reasons[0]}")
        if not found:
            raise InputError(f"{self.verdict}: there is nothing to add; only what is explained is declared")
        effects = {one.name: {symbol: value for symbol, (value, _) in one.coefficients.items()} for one in found}
        return bench.with_(effects=effects)

    def report(self) -> Path:
        """The page of the trace.  Raises InputError where it was not drawn."""
        page = self._folder / "report.html"
        if not page.exists():
            raise InputError(f"{page}: not there; trace again with report=True")
        return page

    def plot(self) -> "Figure":
        """Innovation over its floor on the part that was held out, before and after, and what each candidate would
        have explained by itself.
        """
        from hil.library.trace_figure import trace_figure

        return trace_figure(self.diagnosis)

    def __repr__(self) -> str:
        named = ", ".join(effect.name for effect in self.effects)
        return f"<Trace of {self.diagnosis.record}: {self.verdict}{': ' + named if named else ''}>"


@said_of_arguments
def load(run: Run | Path | str) -> Run:
    """The run in a folder; `last` is the newest in runs/.  Raises InputError where there is none, or a trace."""
    folder = folder_of("run", run, "a Run or the path of its folder")
    if (folder / "diagnosis.json").exists():
        raise InputError(f"{folder}: a trace, no run; hil.load_trace opens it")
    return Run(RunFolder.open(folder))


@said_of_arguments
def load_trace(trace: Trace | Path | str) -> Trace:
    """The trace in a folder; `last` is the newest in runs/.  Raises InputError where there is none, or a run."""
    from hil.records.diagnosis import load_diagnosis  # knows the estimator's words, which a run does without

    given = trace.path if isinstance(trace, Trace) else trace
    folder = named_trace(path_of("trace", given, "a Trace or the path of its folder"))
    if not (folder / "diagnosis.json").exists():
        if RunFolder(folder).capture_path.exists():
            raise InputError(f"{folder}: a run, no trace; hil.load opens it, hil.trace traces it")
        raise InputError(f"{folder}: no trace; give the folder that hil trace made")
    return Trace(folder, load_diagnosis(folder / "diagnosis.json"))


def folder_of(argument: str, given: Any, wanted: str = "a Run, a Trace or the path of its folder") -> Path:
    """Where a run or a trace is kept; also a record file, by its path.  Raises InputError for anything else."""
    return given.path if isinstance(given, Run | Trace) else named(path_of(argument, given, wanted))
