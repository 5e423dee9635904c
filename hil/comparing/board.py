"""What the board's own estimator said while a record was made, as a method beside the others."""

import numpy as np

from hil.comparing.course import DAMPING, STIFFNESS, MethodCourse
from hil.records.runfolder import RunFolder

ON_THE_BOARD = "on the board"
"""What the row is called."""


def board_course(folder: RunFolder) -> MethodCourse | None:
    """Of a run in board mode; None where the board said nothing. An entry without a deviation is declared to it."""
    board = folder.board_estimates
    if board is None or not len(board):
        return None
    columns = {label: f"{label}_per_s2" if label in STIFFNESS else f"{label}_per_s" for label in (*STIFFNESS, *DAMPING)}
    deviations = {label: float(board.sd(column)[-1]) for label, column in columns.items()}
    estimated = [label for label, deviation in deviations.items() if deviation > 0.0]
    rate_sd = board.sd("rate_rad_s")
    return MethodCourse(
        name=ON_THE_BOARD,
        kind="observer",
        tick=board.tick,
        angle=np.asarray(board["angle_rad"]),
        rate=np.asarray(board["rate_rad_s"]),
        rate_sd=rate_sd if rate_sd.any() else None,
        parameters={label: float(board[columns[label]][-1]) for label in estimated},
        deviations={label: deviations[label] for label in estimated},
        remark="as the board said while it was recorded",
    )
