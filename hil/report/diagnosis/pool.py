"""report.html of several records traced together: the page of a trace without pictures of one record's course."""

from pathlib import Path

from hil.numbers import count, counted
from hil.records.diagnosis import Diagnosis
from hil.report.diagnosis.page import Pictures, write_page


def write_pool_report(folder: Path, diagnosis: Diagnosis) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path."""
    fitted, rest = count(diagnosis.split), count(diagnosis.samples - diagnosis.split)
    record = ("Records", count(diagnosis.samples), f"samples, {fitted} fitted, {rest} held out with their records")
    return write_page(folder, diagnosis, Pictures(), record, counted(diagnosis.samples, "sample"))
