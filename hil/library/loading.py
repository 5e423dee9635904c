"""What is there already is opened at once: neither estimator nor bench files are loaded for it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.errors import InputError
from hil.errors.input import path_of
from hil.library.finished_run import Run
from hil.library.keywords import said_of_arguments
from hil.records.listing import named, named_trace
from hil.records.runfolder import RunFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hil.bench import Bench
    from hil.records.diagnosis import Diagnosis, Effect, Separation


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
