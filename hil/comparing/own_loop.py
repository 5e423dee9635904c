"""Methods that close the loop themselves: a run of their own, on the same emulated device with the same seed."""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hil.bench import Bench, override
from hil.boards.emulation import is_emulated, located
from hil.comparing.board import course_in
from hil.comparing.course import MethodCourse, Reference, parameters_of
from hil.comparing.observers import with_observer
from hil.comparing.prior_art import with_plugin
from hil.errors import InputError
from hil.progress import alarms_only
from hil.records.runfolder import RunFolder
from hil.records.truth import read_truth
from hil.running.request import RunRequest
from hil.running.run import run

ADAPTIVE = "(d) Park–Horowitz"
WITHOUT_OFFSETS = "(c) control law without sense errors, its own loop"


def require_emulated(link: str) -> str:
    """The link with its scenario as a path.  Raises InputError for a board that may move something real."""
    if not is_emulated(link):
        raise InputError(
            f"{link}: a comparison closes the loop with emulated boards only; give inproc:SCENARIO or pty:SCENARIO, or "
            "leave --link out"
        )
    return located(link)


def own_runs(
    bench: Bench, link: str, seconds: float
) -> Iterator[tuple[str, Callable[[], tuple[MethodCourse, Reference]]]]:
    """Names, and what runs each for so long, with the truth of that run."""
    loop = {"clock": "lockstep", "duration_s": seconds, "mode": "force"}
    bench = override(bench, {"loop": loop, "reference": {"link": None}}, bench.device.name or "bench")
    yield WITHOUT_OFFSETS, partial(_run, with_observer(bench, "gyro", bench.observer.gain), link, WITHOUT_OFFSETS)
    adaptive = with_plugin(bench, "park_horowitz.py:ParkHorowitz", controls=True)
    yield ADAPTIVE, partial(_run, adaptive, link, ADAPTIVE)


def _run(bench: Bench, link: str, name: str) -> tuple[MethodCourse, Reference]:
    with tempfile.TemporaryDirectory() as place:
        request = RunRequest(bench, link, truth=Path(place) / "truth.arrow", judged=False)
        done = run(request, Path(place), report=False, progress=alarms_only)
        assert done.folder is not None
        stopped, estimates = str(done.outcome.get("stopped") or ""), RunFolder(done.folder).estimates
        if estimates is None or not len(estimates):
            raise InputError(f"{name}: nothing was estimated; {stopped}")
        course = course_in(estimates, name, stopped)
        found = read_truth(Path(place) / "truth.arrow")
        tick, angle, rate = (np.array(found[label]) for label in ("tick", "angle_rad", "rate_rad_s"))  # the file goes
        lost = int(course.tick[-1]) if stopped else None
        course = replace(course, kind="prior art", own_record=True, lost_tick=lost)
        return course, Reference("truth", tick, angle, rate, parameters_of(found))
