"""What the board must have done in a gap, beside a board and a gyro written out in the test."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gain_board import GainBoard
from estimator.gain_matrix import GainMatrix, luenberger, pair
from estimator.observer import Observer
from tests.estimator.test_gain_matrix import QUANTUM, Board, Case, codes_of

Floats = NDArray[np.float64]
LIMIT = 6000
DITHER, SEED = 300, 0xBEEF


class Rounded(Board):
    """The same with dither, rounding and limits."""

    register = SEED
    closed = False

    def drive(self, codes: Floats) -> Floats:
        signs = []
        for _ in range(2):
            signs.append(1 if self.register & 1 else -1)
            self.register = self.register >> 1 ^ (0xA3000000 if self.register & 1 else 0)
        self.s = self.s @ self.a.T + np.outer(codes, self.b) + np.outer(self.past[-1], self.c)
        self.past = [codes, *self.past[:-1]]
        raw = self.closed * np.round(self.gain @ self.s.ravel() + self.bias + DITHER * np.array(signs))
        self.queue.append(np.clip(raw, -LIMIT, LIMIT))
        return self.queue.pop(0)


def record(case: Case, observer: Observer, rows: int, start: int, second: int) -> tuple[Floats, Floats, list[Floats]]:
    """Codes and drives (rows, 2) of a closed loop and the motion at each row; matrices from `start`, `second` on."""
    ad, bd = case.held()
    board = luenberger(observer.h)
    gain, bias = GainMatrix(observer, board).solve(500)
    loop = Rounded(board, np.zeros((2, 4)), np.zeros(2), case.latency)
    motion = np.array([2e-6, 0.0, 0.0, 0.0])
    codes, drives, motions = np.zeros((rows, 2)), np.zeros((rows, 2)), []
    held = np.zeros(2)
    for row in range(rows):
        if row == start:
            loop.gain, loop.bias, loop.closed = gain.copy(), bias.copy(), True
        if row == second:
            loop.gain, loop.bias = 0.5 * gain, 0.5 * bias
        drives[row] = held
        codes[row] = np.round(codes_of(motion))
        motions.append(motion)
        held = loop.drive(codes[row])
        motion = ad @ motion + bd @ (held * QUANTUM)
    return codes, drives, motions


@pytest.mark.moderate
@pytest.mark.parametrize("latency", [0, 1, 3])
def test_a_gap_is_filled_with_what_the_board_did(latency: int) -> None:
    """120 rows missing, six cycles, with a second matrix, sent before, coming into force amid them."""
    case = Case(latency=latency)
    observer = case.observer()
    gap, missing, start, second = 300, 120, 40, 340
    codes, drives, motions = record(case, observer, 500, start, second)
    board = luenberger(observer.h)
    gain, bias = (part.copy() for part in GainMatrix(observer, board).solve(500))
    gain_board = GainBoard(observer, board, LIMIT, (DITHER, SEED))
    gain_board.follow(0, codes[:20].astype(np.int32))
    gain_board.tell(gain, bias, start)
    gain_board.follow(20, codes[20:gap].astype(np.int32))
    gain_board.tell(0.5 * gain, 0.5 * bias, second)
    scale = np.array([2e-6, 2e-6 * observer.scaling.omega0] * 2)
    observer.x[:4] = motions[gap - 1] / scale
    foreseen = gain_board.foresee(gap, missing)
    assert np.abs(drives[gap : gap + missing]).max() == LIMIT
    np.testing.assert_allclose(foreseen, drives[gap : gap + missing], atol=1.0)
    gain_board.follow(gap + missing, codes[gap + missing : 480].astype(np.int32))
    observer.x[:4] = motions[479] / scale
    np.testing.assert_allclose(gain_board.foresee(480, 20), drives[480:], atol=1.0)


def test_a_board_that_is_armed_again_has_forgotten() -> None:
    case = Case()
    observer = case.observer()
    board = pair(5)
    gain_board = GainBoard(observer, board, LIMIT, (DITHER, SEED))
    gain_board.tell(*GainMatrix(observer, board).solve(500), 0)
    gain_board.follow(0, np.full((10, 2), 1000, np.int32))
    assert gain_board.foresee(10, 5).all()
    gain_board.arm()
    gain_board.follow(50, np.full((10, 2), 1000, np.int32))
    assert not gain_board.foresee(60, 5).any()


@pytest.mark.parametrize("delay", [1, 5])
def test_what_a_board_filters_is_this_sample_and_an_earlier_one(delay: int) -> None:
    """A filter with all of its terms, row by row beside the board's law in NumPy."""
    observer = Case().observer()
    board = replace(luenberger(observer.h), c=(0.3, -0.2), delay=delay)
    gain = 0.1 * np.arange(1.0, 9.0).reshape(2, 4)
    gain_board = GainBoard(observer, board, LIMIT, (0, SEED))
    gain_board.tell(gain, np.array([3.0, -4.0]), 0)
    codes = np.random.default_rng(2).integers(-2000, 2000, (40, 2)).astype(np.int32)
    gain_board.follow(0, codes)
    other = Board(board, gain, np.array([3.0, -4.0]), observer.latency)
    for row in codes:
        expected = other.drive(row.astype(float))
    drives = gain_board.foresee(40, 1)
    np.testing.assert_allclose(drives[0], expected, atol=0.5001)
    assert np.abs(expected).max() > 100.0
