"""What is there already is opened at once: neither estimator nor bench files are loaded for it."""

from pathlib import Path

from hil.library.finished_run import Run
from hil.library.tracing import Trace
from hil.records.listing import named
from hil.records.runfolder import RunFolder


def load(place: Path | str) -> Run | Trace:
    """What `hil run`, `hil replay` or `hil trace` left in a folder; `last` is the newest run in runs/."""
    folder = named(place)
    if (folder / "diagnosis.json").exists():
        from hil.records.diagnosis import load_diagnosis

        return Trace(folder, load_diagnosis(folder / "diagnosis.json"))
    return Run(RunFolder.open(folder))
