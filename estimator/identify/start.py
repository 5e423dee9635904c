"""Start values: poles from free decays by a subspace, then gains and the delay in whole samples by least squares."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from estimator.identify.model import Array, Physical, Piece, Predictor, constants, delayed
from estimator.spans import spans

_SHIFTS = 24  # samples side by side in the subspace: a cycle or more
_PART = 6_000  # samples over which a first guess of the poles holds
DELAYS = range(-2, 9)
"""Samples by which a drive may act later than its row says."""
_AFTER = 1 + DELAYS.stop


class NoMotionError(Exception):
    """A record that shows no oscillator."""


class Start(NamedTuple):
    """θ, and by whole samples of delay the noise that is left in so many rows."""

    theta: Array
    left_V: dict[int, float]


def free_decays(parts: Sequence[Piece], least: int = 200) -> list[Array]:
    """Stretches (n, 2) of the sense voltages without a drive."""
    found = []
    for piece in parts:
        for begin, end in spans(~piece.drive.any(axis=1)):
            begin = begin + _AFTER if begin else 0
            if end - begin >= least:
                found.append(piece.sense[begin:end])
    return found


def flow_of(decays: Sequence[Array], order: int = 5) -> Array:
    """The matrix (4, 4) by which (v, v̇) flows, per sample, of the oscillator that rings in free decays.

    Ho and Kalman's realisation (Kung, 12th Asilomar Conf., 1978) over all decays at once; the fifth pole is the offset.
    Raises NoMotionError where the decays show no two oscillating modes.
    """
    rows: Array = np.zeros((2 * _SHIFTS, 2 * _SHIFTS))
    for decay in decays:
        block = sliding_window_view(decay - decay.mean(axis=0), (_SHIFTS, 2)).reshape(-1, 2 * _SHIFTS)
        rows += block.T @ block
    values, vectors = np.linalg.eigh(rows)
    space = vectors[:, -order:] * np.sqrt(np.maximum(values[-order:] - np.median(values), 0.0) + 1e-300)
    step = np.linalg.lstsq(space[:-2], space[2:], rcond=None)[0]
    poles, shapes = np.linalg.eig(step)
    pairs = [k for k in range(order) if poles[k].imag > 1e-3 and 0.5 < abs(poles[k]) < 1.2]
    if len(pairs) < 2:
        raise NoMotionError("no two resonances show in the free decays")
    pairs = sorted(pairs, key=lambda k: -float(np.linalg.norm(space[:2] @ shapes[:, k])))[:2]
    chosen = np.log(poles[pairs])
    chosen = np.minimum(chosen.real, -1e-9) + 1j * chosen.imag
    seen = space[:2] @ shapes[:, pairs]
    both, at = np.concatenate([chosen, chosen.conj()]), np.concatenate([seen, seen.conj()], axis=1)
    motion = np.concatenate([at, at * both])
    return np.real(motion @ np.diag(both) @ np.linalg.inv(motion))


def start(parts: Sequence[Piece]) -> Start:
    """From pieces with free decays of motions along both axes.  Raises NoMotionError."""
    decays = free_decays(parts)
    if not decays:
        raise NoMotionError("the drive never rests for 200 samples; a free decay is needed")
    flow = flow_of(decays)
    stiffness, damping = -flow[2:, :2], -flow[2:, 2:]
    found = _driven(parts, stiffness, damping)
    best = min(found, key=lambda whole: found[whole][0])
    return Start(found[best][1], {whole: one[0] for whole, one in found.items()})


def _driven(parts: Sequence[Piece], stiffness: Array, damping: Array) -> dict[int, tuple[float, Array]]:
    """By whole samples of delay, what is left in volts, and θ."""
    of = Predictor(constants(Physical(stiffness, damping, np.eye(2)), 0.0, np.zeros(2)))
    sums = {whole: _Sums() for whole in DELAYS}
    for part in (part for piece in parts for part in piece.parted(_PART) if part.drive.any()):
        free = np.linalg.qr(of.begun(len(part.sense)).reshape(4, -1).T)[0]
        responses = [_response(part, of, into, by) for into in range(2) for by in range(2)]
        steady = [np.broadcast_to(np.eye(2)[axis], part.sense.shape) for axis in range(2)]
        for whole, sum_ in sums.items():
            matrix = np.stack([c.ravel() for c in (*(delayed(r, whole) for r in responses), *steady, part.sense)], 1)
            sum_.add(matrix - free @ (free.T @ matrix))
    found = {}
    for whole, sum_ in sums.items():
        values, left = sum_.solved()
        gain = values[:4].reshape(2, 2)
        if not np.diag(gain).all() or not np.isfinite(gain).all():
            raise NoMotionError("a drive moves nothing")
        found[whole] = left, constants(Physical(stiffness, damping, gain), float(whole), values[4:])
    return found


class _Sums:
    """Normal equations of six unknowns, and of what they are to explain."""

    def __init__(self) -> None:
        self._both: Array = np.zeros((7, 7))
        self._rows = 0

    def add(self, matrix: Array) -> None:
        self._both += matrix.T @ matrix
        self._rows += len(matrix)

    def solved(self) -> tuple[Array, float]:
        if not self._rows:
            raise NoMotionError("nothing was driven")
        normal, target, squares = self._both[:6, :6], self._both[:6, 6], float(self._both[6, 6])
        size = np.sqrt(np.diag(normal)) + 1e-300
        found = np.linalg.lstsq(normal / np.outer(size, size), target / size, rcond=None)[0] / size
        return found, float(np.sqrt(max(squares - float(found @ target), 0.0) / self._rows))


def _response(piece: Piece, of: Predictor, into: int, by: int) -> Array:
    """Volts (n, 2) that one drive makes, of unit gain into one channel, from rest."""
    alone = np.zeros_like(piece.drive)
    alone[:, into] = piece.drive[:, by]
    return of.predicted(Piece(piece.sense, alone, piece.lead), np.zeros(4)) - of.theta[12:14]
