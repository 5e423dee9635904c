"""What a trace came to, and what its record is called."""

from dataclasses import dataclass
from pathlib import Path

from hil.records.diagnosis import Diagnosis


@dataclass(frozen=True)
class Traced:
    """Where a trace was written (diagnosis.json, report.html, bench.toml), and what it came to."""

    folder: Path
    diagnosis: Diagnosis


def called(capture: Path) -> str:
    """What a record is called: its run folder's name, or its own."""
    return capture.resolve().parent.name if capture.name == "capture.arrow" else capture.stem
