"""Methods that close the loop themselves: a run of their own, on the same emulated device with the same seed."""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hil.bench import Bench, override
from hil.bench.classic import PLUGIN
from hil.boards.emulation import is_emulated, located
from hil.comparing.course import DAMPING, STIFFNESS, MethodCourse, Reference, parameters_of
from hil.comparing.observers import with_observer, with_plugin
from hil.errors import InputError
from hil.progress import alarms_only
from hil.records.estimates import Estimates
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
        request = RunRequest(bench, link, {"truth": Path(place) / "truth.arrow"}, judged=False)
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


ON_THE_BOARD = "on the board"
"""What the row is called."""
_MEANWHILE = "while it was recorded"


def board_course(folder: RunFolder) -> MethodCourse | None:
    """Of a run in board mode; None where the board said nothing. An entry without a deviation is declared to it."""
    board = folder.board_estimates
    return (
        None if board is None or not len(board) else course_in(board, ON_THE_BOARD, f"as the board said {_MEANWHILE}")
    )


def loops_course(folder: RunFolder) -> MethodCourse | None:
    """Of a run in a classic mode, the loops that ran; None of any other."""
    estimates = folder.estimates
    if estimates is None or not len(estimates) or estimates.header.get("plugins", {}).get("observer") != PLUGIN:
        return None
    mode = str(folder.bench.get("controller", {}).get("mode", "classic")).replace("_", " ")
    course = course_in(estimates, f"{mode}, as run", f"as the loops said {_MEANWHILE}")
    return replace(course, angle_u=None if folder.result is None else folder.result.angle_u_rad)


def course_in(board: Estimates, name: str, remark: str) -> MethodCourse:
    """Estimates that were recorded, as a method: of the constants those that have a deviation."""
    columns = {label: f"{label}_per_s2" if label in STIFFNESS else f"{label}_per_s" for label in (*STIFFNESS, *DAMPING)}
    deviations = {label: float(board.sd(column)[-1]) for label, column in columns.items()}
    estimated = [label for label, deviation in deviations.items() if deviation != 0.0]  # NaN: it gave none
    rate_sd = board.sd("rate_rad_s")
    return MethodCourse(
        name=name,
        kind="observer",
        tick=board.tick,
        angle=np.asarray(board["angle_rad"]),
        rate=np.asarray(board["rate_rad_s"]),
        rate_sd=rate_sd if rate_sd.any() else None,
        parameters={label: float(board[columns[label]][-1]) for label in estimated},
        deviations={label: deviations[label] for label in estimated},
        remark=remark,
    )
