"""report.html of several records traced together: the page of a trace without pictures of one record's course."""

from pathlib import Path

from hil.records.atomic import write_text
from hil.records.diagnosis import Diagnosis
from hil.report.diagnosis.page import Pictures, page_of
from hil.report.numbers import count


def write_pool_report(folder: Path, diagnosis: Diagnosis) -> Path:
    """Write `folder/report.html`, whole or not at all, and return its path."""
    listing = folder / "bench.toml"
    text = listing.read_text(encoding="utf-8") if listing.exists() else ""
    fitted, rest = count(diagnosis.split), count(diagnosis.samples - diagnosis.split)
    record = ("Records", count(diagnosis.samples), f"samples, {fitted} fitted, {rest} held out with their records")
    path = folder / "report.html"
    write_text(path, page_of(diagnosis, Pictures(), text, record, made=path.parent.name))
    return path
