"""Files a verb is given, and files it is to make."""

from pathlib import Path

from hil.errors import InputError


def capture_in(place: Path) -> Path:
    """The capture meant by ``place``: a run folder stands for the one in it."""
    return place / "capture.arrow" if place.is_dir() else place


def fresh(target: Path) -> Path:
    """``target`` itself; `InputError` where it exists, since nothing is overwritten unasked."""
    if target.exists():
        raise InputError(f"{target}: exists already; give another --out, or remove it")
    return target
