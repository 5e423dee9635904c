"""The folder a run leaves, and what is in it."""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from hil.errors import InputError
from hil.records.capture import Capture, read_capture
from hil.records.clock import ClockRecord, read_clock
from hil.records.covariance import Covariance, read_covariance
from hil.records.estimates import Estimates, read_estimates
from hil.records.innovation import Innovation, read_innovation
from hil.records.kind import TRACE, kind_of
from hil.records.table import scored_from_s
from hil.records.text_seal import require_unchanged
from hil.records.timing import Timing, read_timing
from hil.records.trims import TRIMS, Trims, read_trims
from hil.wire.regular_file import require_regular

if TYPE_CHECKING:
    from hil.records.result import Result

_Record = TypeVar("_Record")
_LONGEST_S = 1e9


class RunFolder:
    """A run folder `<time>-<name>/`. Its parts are read when asked for; an absent part is None."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def open(cls, path: Path) -> "RunFolder":
        """The run at `path`. Raises InputError when that is no folder with a record in it."""
        folder = cls(path)
        if not any(part.exists() for part in (folder.capture_path, folder.estimates_path)):
            if kind := kind_of(path):
                page = folder.report_path if folder.report_path.exists() else path
                shown = f"hil show {path} shows it" if kind == TRACE else f"look at {page}"
                raise InputError(f"{path}: no run folder but {kind}; {shown}")
            raise InputError(f"{path}: no run folder (no capture.arrow or estimates.arrow); give one made by hil run")
        return folder

    @property
    def bench_path(self) -> Path:
        """The bench file as run."""
        return self.path / "bench.toml"

    @property
    def capture_path(self) -> Path:
        """Codes of every sample."""
        return self.path / "capture.arrow"

    @property
    def estimates_path(self) -> Path:
        """States and angle, decimated."""
        return self.path / "estimates.arrow"

    @property
    def board_estimates_path(self) -> Path:
        """What the board's own estimator said, in board mode."""
        return self.path / "board_estimates.arrow"

    @property
    def covariance_path(self) -> Path:
        """Whole covariance of the estimates, further decimated."""
        return self.path / "covariance.arrow"

    @property
    def innovation_path(self) -> Path:
        """Innovation of every sample."""
        return self.path / "innovation.arrow"

    @property
    def timing_path(self) -> Path:
        """Wall times."""
        return self.path / "timing.arrow"

    @property
    def clock_path(self) -> Path:
        """Exchanges of time with the board."""
        return self.path / "clock.arrow"

    @property
    def trims_path(self) -> Path:
        """Voltages of the trim outputs."""
        return self.path / TRIMS

    @property
    def reference_path(self) -> Path:
        """A commercial gyro that was recorded beside the run."""
        return self.path / "reference.arrow"

    @property
    def result_path(self) -> Path:
        """Figures of the run."""
        return self.path / "result.json"

    @property
    def report_path(self) -> Path:
        """The page for people."""
        return self.path / "report.html"

    @cached_property
    def bench_text(self) -> str:
        """The bench file as run, "" when there is none. Raises InputError when it is no text, or not what was run."""
        if not self.bench_path.exists():
            return ""
        try:
            require_regular(self.bench_path)
            data = self.bench_path.read_bytes()
            text = data.decode("utf-8")
        except (OSError, UnicodeDecodeError):
            raise InputError(f"{self.bench_path}: cannot be read as text; restore the file as run") from None
        require_unchanged(data, self.bench_path, "restore it as run; to try another, copy it and give --bench")
        return text

    @cached_property
    def bench(self) -> dict[str, Any]:
        """The bench file as plain tables: old runs stay readable when the bench file's rules change. Raises InputError
        when it is none at all: neither [device] nor [loop] is in it; or when it is not what was run.
        """
        from hil.toml.reading import read_table  # and the library that checks what is written there

        if not self.bench_path.exists():
            return {}
        _ = self.bench_text  # which refuses a file that is not what was run
        table = read_table(self.bench_path)
        if not any(isinstance(table.get(section), dict) for section in ("device", "loop")):
            raise InputError(f"{self.bench_path}: no bench file: [device] and [loop] are missing; restore it as run")
        return table

    @cached_property
    def capture(self) -> Capture | None:
        """The capture, or None."""
        return _read_if_there(self.capture_path, read_capture)

    @cached_property
    def estimates(self) -> Estimates | None:
        """The estimates, or None."""
        return _read_if_there(self.estimates_path, read_estimates)

    @property
    def cut(self) -> dict[str, str]:
        """Which of both were interrupted, by the name of the file: `Table.cut`."""
        records = {"capture.arrow": self.capture, "estimates.arrow": self.estimates}
        return {name: record.cut for name, record in records.items() if record is not None and record.cut}

    @cached_property
    def board_estimates(self) -> Estimates | None:
        """What the board's own estimator said, or None."""
        return _read_if_there(self.board_estimates_path, read_estimates)

    @cached_property
    def covariance(self) -> Covariance | None:
        """The covariances, or None."""
        return _read_if_there(self.covariance_path, read_covariance)

    @cached_property
    def innovation(self) -> Innovation | None:
        """The innovation, or None."""
        return _read_if_there(self.innovation_path, read_innovation)

    @cached_property
    def timing(self) -> Timing | None:
        """The wall times, or None."""
        return _read_if_there(self.timing_path, read_timing)

    @cached_property
    def clock(self) -> ClockRecord | None:
        """The exchanges of time, or None."""
        return _read_if_there(self.clock_path, read_clock)

    @cached_property
    def trims(self) -> Trims | None:
        """The changes of the trim outputs, or None."""
        return _read_if_there(self.trims_path, read_trims)

    @property
    def reference(self) -> Capture | None:
        """The commercial gyro beside the run, or None."""
        return _read_if_there(self.reference_path, read_capture)

    @cached_property
    def result(self) -> "Result | None":
        """The figures written when the run ended or was scored, or None."""
        from hil.records.result import load_result  # its models take as long to build as all else to load

        return _read_if_there(self.result_path, load_result)

    @cached_property
    def scored_from_s(self) -> float:
        """Bench time at which the scored window begins: `settle_s` after the first row that was recorded.  A board's
        time goes on from one run to the next."""
        for record in (self.estimates, self.innovation, self.capture):
            if record is not None and len(record):
                return scored_from_s(float(record.part(0, 1).t_s[0]), self.settle_s, record.tick_rate_Hz)
        return self.settle_s

    @property
    def settle_s(self) -> float:
        """What the observer has to settle (bench file, `[loop] settle_s`), 0 when not stated."""
        loop = self.bench.get("loop", {})
        stated = loop.get("settle_s", 0.0) if isinstance(loop, dict) else None
        if not isinstance(stated, int | float) or not abs(stated) <= _LONGEST_S:
            raise InputError(
                f"{self.bench_path}: [loop] settle_s: expected a number of seconds; restore the file as run"
            )
        return float(stated)


def _read_if_there(path: Path, read: Callable[[Path], _Record]) -> _Record | None:
    return read(path) if path.exists() else None


def run_of(record: Path) -> Path:
    """The folder of the run that a capture belongs to; any other record as it is."""
    return record.parent if record.name == "capture.arrow" else record


def bench_of_record(record: Path) -> Path | None:
    """The bench file by which a run was made, given its folder or the capture in it; None for any other record.

    Raises InputError when it is not what was run.
    """
    run = RunFolder(run_of(record))
    return run.bench_path if run.bench_text else None
