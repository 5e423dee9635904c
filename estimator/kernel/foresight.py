"""The law of a board in gain mode, on the host: what it did while nothing was heard of it."""

from typing import Any

import numpy as np

from estimator.kernel.compiled import compiled
from estimator.kernel.layout import MAX_LATENCY, PHI_X, Floats, Record
from estimator.kernel.taylor import taylor

HISTORY = 64
QUEUE = MAX_LATENCY + 2
_TAPS = 0xA3000000

BOARD = np.dtype(
    [
        ("a", "f8", (2, 2)),
        ("b", "f8", 2),
        ("c", "f8", 2),
        ("delay", "i8"),
        ("latency", "i8"),
        ("limit", "f8"),  # drive codes
        ("dither", "f8"),
        ("closed", "i8"),
        ("gain", "f8", (2, 4)),
        ("bias", "f8", 2),
        ("waiting", "i8"),  # 1: the matrix below waits for its tick
        ("effective", "i8"),
        ("next_gain", "f8", (2, 4)),
        ("next_bias", "f8", 2),
        ("s", "f8", (2, 2)),  # of each axis
        ("past", "f8", (HISTORY, 2)),  # sense codes, by tick
        ("shift", "u4"),  # register of the dither
        ("queue", "f8", (QUEUE, 2)),  # drive codes, by the tick at which their interval ends
    ],
    align=True,
)


@compiled
def sampled(board: Record, tick: int, vx: float, vy: float) -> None:
    """Carry the board over the tick at which the codes vx, vy were sampled."""
    if board.waiting == 1 and board.effective <= tick:
        board.gain[:] = board.next_gain
        board.bias[:] = board.next_bias
        board.waiting = 0
        board.closed = 1
    board.past[tick % HISTORY, 0] = vx
    board.past[tick % HISTORY, 1] = vy
    for axis in range(2):
        now = board.past[tick % HISTORY, axis]
        then = board.past[(tick - board.delay) % HISTORY, axis]
        s0 = board.s[axis, 0]
        s1 = board.s[axis, 1]
        for i in range(2):
            board.s[axis, i] = board.a[i, 0] * s0 + board.a[i, 1] * s1 + board.b[i] * now + board.c[i] * then
    for axis in range(2):
        bit = board.shift & np.uint32(1)
        board.shift = board.shift >> np.uint32(1)
        if bit:
            board.shift ^= np.uint32(_TAPS)
        code = 0.0
        if board.closed == 1:
            code = board.bias[axis] + (board.dither if bit else -board.dither)
            for i in range(4):
                code += board.gain[axis, i] * board.s[i // 2, i % 2]
            code = min(max(np.rint(code), -board.limit), board.limit)
        board.queue[(tick + board.latency + 1) % QUEUE, axis] = code


@compiled
def follow(boards: Record, first: int, codes: Any) -> None:
    """Carry the board over rows that were received: codes (n, ≥ 2) from tick `first` on."""
    board = boards[0]
    for row in range(codes.shape[0]):
        sampled(board, first + row, codes[row, 0], codes[row, 1])


@compiled
def foresee(settings_record: Record, boards: Record, x: Floats, first: int, drives: Floats) -> None:
    """Carry the board over rows that were not, from tick `first` on, by what the model says it sampled.

    x is the state vector at the row before; drives (n, 2) receives the drive codes over the interval that ends at each.
    """
    settings = settings_record[0]
    board = boards[0]
    states = settings.states
    constants = x[states:].copy()
    motion, term = np.zeros((states, 1)), np.zeros((states, 1))
    motion[:, 0] = x[:states]
    u = np.zeros((2, 1))
    for row in range(drives.shape[0]):
        tick = first + row
        for axis in range(2):
            drives[row, axis] = board.queue[tick % QUEUE, axis]
            u[axis, 0] = drives[row, axis] * settings.quantum
        taylor(settings.model, constants, u, settings.h, settings.order, 1, term, motion)
        vx = np.rint((motion[settings.sensed[0], 0] + constants[PHI_X]) / settings.sense_scale[0])
        vy = np.rint((motion[2 + settings.sensed[1], 0] + constants[PHI_X + 1]) / settings.sense_scale[1])
        sampled(board, tick, vx, vy)
