"""The folder a run leaves, and what is in it."""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from hil.errors import InputError
from hil.records.atomic import require_unchanged
from hil.records.capture import TRIMS, Capture, Trims
from hil.records.clock import ClockRecord
from hil.records.estimates import Covariance, Estimates, Innovation
from hil.records.kind import TRACE, kind_of
from hil.records.table import scored_from_s
from hil.records.timing import Timing
from hil.wire.regular_file import require_regular

if TYPE_CHECKING:
    from hil.records.result import Result

_Record = TypeVar("_Record")
_LONGEST_S = 1e9


class _File:
    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, folder: "RunFolder", _: object) -> Path:
        return folder.file(self._name)


class _Part(Generic[_Record]):
    """A record of a run folder, read the first time it is asked for; None where it is not there."""

    def __init__(self, name: str, read: Callable[[Path], _Record]) -> None:
        self._name, self._read = name, read

    def __set_name__(self, _: object, attribute: str) -> None:
        self._attribute = attribute

    def __get__(self, folder: "RunFolder", _: object) -> _Record | None:
        path = folder.file(self._name)
        found = folder.__dict__[self._attribute] = self._read(path) if path.exists() else None
        return found


class RunFolder:
    """A run folder `<time>-<name>/`. Its parts are read when asked for; an absent part is None."""

    bench_path = _File("bench.toml")
    """The bench file as run."""
    capture_path = _File("capture.arrow")
    """Codes of every sample."""
    estimates_path = _File("estimates.arrow")
    """States and angle, decimated."""
    innovation_path = _File("innovation.arrow")
    """Innovation of every sample."""
    timing_path = _File("timing.arrow")
    """Wall times."""
    clock_path = _File("clock.arrow")
    """Exchanges of time with the board."""
    reference_path = _File("reference.arrow")
    """A commercial gyro that was recorded beside the run."""
    result_path = _File("result.json")
    """Figures of the run."""
    report_path = _File("report.html")
    """The page for people."""
    capture = _Part("capture.arrow", Capture.read)
    estimates = _Part("estimates.arrow", Estimates.read)
    board_estimates = _Part("board_estimates.arrow", Estimates.read)  # what its own estimator said, in board mode
    covariance = _Part("covariance.arrow", Covariance.read)  # whole, of the estimates, further decimated
    innovation = _Part("innovation.arrow", Innovation.read)
    timing = _Part("timing.arrow", Timing.read)
    clock = _Part("clock.arrow", ClockRecord.read)
    trims = _Part(TRIMS, Trims.read)
    reference = _Part("reference.arrow", Capture.read)

    def __init__(self, path: Path) -> None:
        self.path = path

    def file(self, name: str) -> Path:
        """Where a file of it is, or would be."""
        return self.path / name

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

    @property
    def cut(self) -> dict[str, str]:
        """Which of both were interrupted, by the name of the file: `Table.cut`."""
        records = {"capture.arrow": self.capture, "estimates.arrow": self.estimates}
        return {name: record.cut for name, record in records.items() if record is not None and record.cut}

    @cached_property
    def result(self) -> "Result | None":
        """The figures written when the run ended or was scored, or None."""
        from hil.records.result import load_result  # its models take as long to build as all else to load

        return load_result(self.result_path) if self.result_path.exists() else None

    @cached_property
    def scored_from_s(self) -> float:
        """Bench time at which the scored window begins: `settle_s` after the first row that was recorded.  A board's
        time goes on from one run to the next."""
        for record in (self.estimates, self.innovation, self.capture):
            if record is not None and len(record):
                return scored_from_s(record.ends_s[0], self.settle_s, record.tick_rate_Hz)
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


def run_of(record: Path) -> Path:
    """The folder of the run that a capture belongs to; any other record as it is."""
    return record.parent if record.name == "capture.arrow" else record


def bench_of_record(record: Path) -> Path | None:
    """The bench file by which a run was made, given its folder or the capture in it; None for any other record.

    Raises InputError when it is not what was run.
    """
    run = RunFolder(run_of(record))
    return run.bench_path if run.bench_text else None
