"""Files a verb is given, and files it is to make."""

from pathlib import Path

from hil.errors import InputError


def run_folder(place: Path) -> Path:
    """The run folder meant by ``place``: `last` is the newest run in runs/, unless a file or folder has that name."""
    from hil.records.listing import named

    return named(place)


def capture_in(place: Path) -> Path:
    """The capture meant by ``place``: a run folder stands for the one in it, `last` for that of the newest run."""
    place = run_folder(place)
    return place / "capture.arrow" if place.is_dir() else place


def fresh(target: Path, *, replace: bool = False) -> Path:
    """``target`` itself; `InputError` where it exists, since nothing is overwritten unasked: `replace` asks for it."""
    if target.exists() and not (replace and target.is_file()):
        remedy = "give another name" if target.is_dir() else "give another name, or --replace"
        raise InputError(f"{target}: exists already; {remedy}")
    return target
