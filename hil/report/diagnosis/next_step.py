"""The command that comes after a trace."""

import shlex
from pathlib import Path

from hil.records.diagnosis import Diagnosis


def next_of(folder: Path, diagnosis: Diagnosis, added: Path | None = None) -> str | None:
    """The command that comes next: a run with what was found, a bench file that declares it, the experiment that tells
    look-alikes apart, or a bench file with the form of the missing force where no effect accounts for it. None where
    there is none.
    """
    quoted = shlex.quote
    if added is not None:
        return f"hil run {quoted(str(added))}"
    record, bench = folder.parent / diagnosis.record, folder / "bench.toml"
    again = f"hil trace {quoted(str(record))} --bench {quoted(str(bench))}"
    if record.is_dir() and bench.exists():
        if diagnosis.verdict == "explained":
            return f"{again} --add better.bench.toml"
        if any(pair.separate_by is not None for pair in diagnosis.confusable):
            return f"{again} --live"
        missing = diagnosis.missing_force
        if diagnosis.verdict == "unexplained" and missing is not None and any(term.laws for term in missing.form):
            return f"{again} --add better.bench.toml"
    return None
