"""The figures of the board's own estimates: beside the host's of the same samples."""

import math

import numpy as np

from hil.records.estimates import Estimates
from hil.records.result import OnBoard
from hil.records.runfolder import RunFolder


def on_board(folder: RunFolder) -> OnBoard | None:
    """Over the scored window, of the instants that both have; None where the board said none."""
    board, host = folder.board_estimates, folder.estimates
    if board is None or not len(board):
        return None
    scored = board.t_s >= folder.scored_from_s
    valid = float(np.mean(board.valid[scored])) if scored.any() else None
    found = OnBoard(rows=len(board), valid_fraction=valid)
    if host is None:
        return found
    _, ours, theirs = np.intersect1d(host.tick, board.tick, return_indices=True)
    scored = host.t_s[ours] >= folder.scored_from_s
    ours, theirs = ours[scored], theirs[scored]
    if not ours.size:
        return found
    angle = _difference(board, host, "angle_rad", theirs, ours)
    rate = _difference(board, host, "rate_rad_s", theirs, ours)
    return found.model_copy(
        update={
            "angle_difference_rms_rad": None if angle is None else _rms(angle - angle[0]),
            "angle_difference_end_rad": None if angle is None else _finite(abs(angle[-1] - angle[0])),
            "rate_difference_rms_rad_s": None if rate is None else _rms(rate),
        }
    )


def _difference(
    board: Estimates, host: Estimates, name: str, theirs: np.ndarray, ours: np.ndarray
) -> np.ndarray | None:
    if name not in host or name not in board:
        return None
    return np.asarray(board[name][theirs] - host[name][ours], np.float64)


def _rms(values: np.ndarray) -> float | None:
    return _finite(float(np.sqrt(np.mean(np.square(values)))))


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
