"""Files a verb is given, and files it is to make."""

import shlex
from pathlib import Path

from hil.errors import InputError


def run_folder(place: Path) -> Path:
    """The folder meant by ``place``: `last` is the newest run in runs/, `last-trace` the newest trace, unless a file or
    folder has that name.
    """
    from hil.records.listing import named

    return named(place)


def capture_in(place: Path) -> Path:
    """The capture meant by ``place``: a run folder stands for the one in it, `last` for that of the newest run."""
    place = run_folder(place)
    return place / "capture.arrow" if place.is_dir() else place


def bench_file(given: str | None, capture: Path, verb: str) -> Path:
    """The bench file that is ``given``, or else the one by which the run was made that ``capture`` belongs to.

    Raises InputError where a record has none of its own, with the command that names one.
    """
    from hil.bench.examples import find
    from hil.records.runfolder import bench_of_record

    if given is not None:
        return find("bench", given)
    if not capture.exists():
        raise InputError(f"{capture}: no such record; give a capture.arrow, or the run folder it is in")
    if (own := bench_of_record(capture)) is None:
        command = f"hil {verb} {shlex.quote(str(capture))} --bench FILE"
        raise InputError(f"{capture}: no bench file belongs to it; name one: {command}")
    return own
