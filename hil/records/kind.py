"""What a folder of this bench holds, known by its files, and which files are its own."""

import re
from pathlib import Path
from typing import Annotated

from annotated_types import MaxLen

from hil.errors import InputError
from hil.options import Help, Like

TRACE, CAMPAIGN = "a trace", "a campaign"
_MARKS = {
    "diagnosis.json": TRACE,
    "comparison.json": "a comparison",
    "characteristics.json": "a data sheet",
    "campaign.json": CAMPAIGN,
    "identified.json": "an identification",
    "attitude.json": "several gyros run at once",
    "result.json": "a run",
    "estimates.arrow": "a run",
}
_RECORDS = ("capture", "innovation", "estimates", "board_estimates", "covariance", "timing", "clock", "force")
_OWN = {*_MARKS, "bench.toml", "report.html", "changes.jsonl", "marks.json", *(f"{name}.arrow" for name in _RECORDS)}


def kind_of(folder: Path) -> str:
    """`a run`, `a trace`, `a comparison` or `a campaign`; "" for any other folder."""
    return next((kind for mark, kind in _MARKS.items() if (folder / mark).exists()), "")


def require_unowned(file: Path, place: str = "") -> None:
    """InputError for an existing file that a folder of this bench cannot do without; `place` in front of its name."""
    file_here = file.resolve()
    kind = kind_of(file_here.parent) if file_here.name in _OWN else ""
    if kind and file.exists():
        owner = f"part of {kind}, {file_here.parent.name}"
        raise InputError(f"{place}{file}: is {owner}, and is not written over; give another name")


def fresh(target: Path, *, replace: bool = False, source: Path | None = None, place: str = "") -> Path:
    """``target`` itself; `InputError` where it exists, since nothing is overwritten unasked: `replace` asks for it.

    Never overwritten is what a run or a trace is made of, nor `source`, from which the file is made; `place` is put in
    front of its name.
    """
    if not target.exists():
        return target
    if source is not None and source.exists() and target.samefile(source):
        raise InputError(f"{place}{target}: is what is read; give another name")
    require_unowned(target, place)
    if not target.is_file():
        raise InputError(f"{place}{target}: exists already; give another name")
    if not replace:
        raise InputError(f"{place}{target}: exists already; give another name, or --replace")
    return target


RUN_NAME = r"^[A-Za-z0-9][A-Za-z0-9._-]*$"
RunNameOption = Annotated[
    Annotated[str, MaxLen(60), Like(RUN_NAME)] | None, Help("Last part of the run's name; by default the bench's.")
]
_MOST, _OF_A_FILE = 100, 60


def named_by(file: Path) -> str:
    """What a run is called by its bench file: the file's name without what says its kind."""
    stem = file.name.removesuffix(".toml").removesuffix(".bench")
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).lstrip("._-")[:_OF_A_FILE] or "bench"


def checked_name(name: str) -> str:
    """`name` itself.  Raises ValueError in words where no folder should be called so."""
    if re.fullmatch(RUN_NAME[1:-1], name) is None:
        raise ValueError(f"{name!r} is no name of a run; take letters, digits, '.', '-', '_', a letter or digit first")
    if len(name) > _MOST:
        raise ValueError(f"a name of {len(name)} letters; a run's has {_MOST} at most")
    return name
