"""What the estimator of a run said while it was recorded, as a method beside the others: that of the board, or the
loops of a classic mode."""

from dataclasses import replace

import numpy as np

from hil.bench.classic import PLUGIN
from hil.comparing.course import DAMPING, STIFFNESS, MethodCourse
from hil.records.estimates import Estimates
from hil.records.runfolder import RunFolder

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
