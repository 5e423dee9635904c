"""What a folder of this bench holds, known by its files, and which files are its own."""

from pathlib import Path

TRACE, CAMPAIGN = "a trace", "a campaign"
_MARKS = {
    "diagnosis.json": TRACE,
    "comparison.json": "a comparison",
    "campaign.json": CAMPAIGN,
    "result.json": "a run",
    "estimates.arrow": "a run",
}
_RECORDS = ("capture", "innovation", "estimates", "covariance", "timing", "clock", "force")
_OWN = {*_MARKS, "bench.toml", "report.html", "changes.jsonl", "marks.json", *(f"{name}.arrow" for name in _RECORDS)}


def kind_of(folder: Path) -> str:
    """`a run`, `a trace`, `a comparison` or `a campaign`; "" for any other folder."""
    return next((kind for mark, kind in _MARKS.items() if (folder / mark).exists()), "")


def owner_of(file: Path) -> str:
    """What an existing file is part of, in words, where a folder of this bench cannot do without it; else ""."""
    file = file.resolve()
    kind = kind_of(file.parent) if file.name in _OWN else ""
    return kind and f"part of {kind}, {file.parent.name}"
