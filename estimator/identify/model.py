"""A linear oscillator of two axes behind a delay: what its constants make of a drive, sample by sample, exactly.

    ẍ + (D + 2 Ω J) ẋ + K x = S u(t − τ) + w,    v = G x + o + e

x (2,) [m], u (2,) the drive by the board's own scale [m/s²], v (2,) [V]; K and D symmetric, J = [[0, −1], [1, 0]],
S = [[1, s_xy], [s_yx, 1]] what a drive pushes of the other axis, G diagonal.  One record tells the product of sense and
drive gain only: the drive's is taken as the board states it, and G is that product.
Time is counted in samples here, so that constants of any device are of order one.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter

from estimator.spans import spans

Array = NDArray[np.float64]
NAMES = (
    "kxx", "kyy", "kxy", "dxx", "dyy", "dxy", "rate", "gain_x", "gain_y", "share_xy", "share_yx", "delay",
    "offset_x", "offset_y",
)  # fmt: skip
"""Entries of θ, per sample: k in rad², d and rate in rad, gains in V per (m/s²), delay in samples, offsets in V."""
_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


class Piece(NamedTuple):
    """Samples without a gap: sense (n, 2) [V]; drive (lead + n, 2) [m/s²], held over the interval before a row."""

    sense: Array
    drive: Array
    lead: int = 0

    def parted(self, length: int, lead: int = 16) -> "Iterator[Piece]":
        """The same in parts of about so many samples, each with the drives before it."""
        count = max(round(len(self.sense) / length), 1)
        for begin, end in pairwise(np.linspace(0, len(self.sense), count + 1).astype(int).tolist()):
            before = min(lead, begin + self.lead)
            yield Piece(self.sense[begin:end], self.drive[begin + self.lead - before : end + self.lead], before)


class Physical(NamedTuple):
    """Matrices of the equation for the volts v − o: v̈ + damping v̇ + stiffness v = gain u."""

    stiffness: Array
    damping: Array
    gain: Array


def physical(theta: Array) -> Physical:
    """Of the constants, for volts in the place of displacements."""
    kxx, kyy, kxy, dxx, dyy, dxy, rate, gx, gy, sxy, syx = theta[:11]
    gains = np.array([gx, gy])
    there = gains[:, None] / gains[None, :]
    return Physical(
        np.array([[kxx, kxy], [kxy, kyy]]) * there,
        (np.array([[dxx, dxy], [dxy, dyy]]) + 2.0 * rate * _TURN) * there,
        gains[:, None] * np.array([[1.0, sxy], [syx, 1.0]]),
    )


def constants(found: Physical, delay: float, offset: Array) -> Array:
    """The θ that comes closest to these matrices: what is not of one form with it is left out."""
    gains = np.diag(found.gain).copy()
    back = gains[None, :] / gains[:, None]
    stiffness, damping, share = found.stiffness * back, found.damping * back, found.gain / gains[:, None]
    return np.array([
        stiffness[0, 0], stiffness[1, 1], 0.5 * (stiffness[0, 1] + stiffness[1, 0]),
        damping[0, 0], damping[1, 1], 0.5 * (damping[0, 1] + damping[1, 0]), 0.25 * (damping[1, 0] - damping[0, 1]),
        *gains, share[0, 1], share[1, 0], delay, *offset,
    ])  # fmt: skip


class Discrete(NamedTuple):
    """From one sample to the next: state (v, v̇) by `step` (4, 4), the drives of this row and of the two around the
    delay by `late` and `early` (4, 2), `whole` samples of delay; covariance (4, 4) of a unit force noise.
    """

    step: Array
    early: Array
    late: Array
    whole: int
    disturbed: Array


def discrete(theta: Array) -> Discrete:
    """Exact for a held drive: matrix exponentials (Van Loan, IEEE Trans. Automatic Control 23, 1978)."""
    of = physical(theta)
    flow, push = np.zeros((4, 4)), np.zeros((4, 2))
    flow[:2, 2:] = np.eye(2)
    flow[2:, :2], flow[2:, 2:] = -of.stiffness, -of.damping
    push[2:] = of.gain
    whole = int(np.floor(theta[11]))
    part = float(theta[11]) - whole

    def held(length: float) -> tuple[Array, Array]:
        block = np.zeros((6, 6))
        block[:4, :4], block[:4, 4:] = flow, push
        out = expm(length * block)
        return out[:4, :4], out[:4, 4:]

    (_, first), (rest_step, rest) = held(part), held(1.0 - part)
    block = np.zeros((8, 8))
    force = np.zeros((4, 4))
    force[2:, 2:] = np.diag(np.square(theta[7:9]))
    block[:4, :4], block[:4, 4:], block[4:, 4:] = -flow, force, flow.T
    both = expm(block)
    step = both[4:, 4:].T
    return Discrete(step, rest_step @ first, rest, whole, step @ both[:4, 4:])


class Stage(NamedTuple):
    """From row `begin` of a piece on, the filter's gain (4, 2), and the standard deviation (2,) of an innovation over
    that of the sense noise.
    """

    begin: int
    gain: Array
    wider: Array


AT_REST: tuple[Stage, ...] = (Stage(0, np.zeros((4, 2)), np.ones(2)),)
"""Without force noise nothing is to be followed: the motion is the first one's."""
_CHANGE = 1.25  # of a gain, from one stage to the next


def stages(model: Discrete, force: float, noise: Array, rows: int) -> tuple[Stage, ...]:
    """The Kalman filter over a piece that begins with a known motion, in stages of about the same gain.

    force: variance of the force noise over a sample's time [(m/s²)²]; noise (2,) [V].  The covariance is carried on in
    strides of samples, in which it hardly changes.
    """
    if force == 0.0:
        return AT_REST
    sense, scale = np.eye(2, 4), float(np.mean(noise)) ** 2
    stride = max(int(2.0 * np.pi / max(float(np.max(np.abs(np.angle(np.linalg.eigvals(model.step))))), 1e-3)), 1)
    told, step, grown = np.zeros((4, 4)), np.eye(4), np.zeros((4, 4))
    weight = np.diag(scale / noise**2)
    for _ in range(stride):
        told += step.T @ sense.T @ weight @ sense @ step
        step = model.step @ step
        grown = model.step @ grown @ model.step.T + force / scale * model.disturbed
    spread, found, size = np.zeros((4, 4)), [AT_REST[0]], 0.0
    for begin in range(stride, rows, stride):
        spread = step @ np.linalg.solve(np.eye(4) + spread @ told, spread) @ step.T + grown
        seen = spread[:2, :2] + np.diag(noise**2) / scale
        now = float(np.trace(spread[:2, :2] @ weight))
        if now > _CHANGE * size:
            size = now
            wider = np.sqrt(np.diag(seen) * scale) / noise
            found.append(Stage(begin, np.asarray(np.linalg.solve(seen, spread[:2]).T), wider))
        elif begin > 50 * stride and now < 1.0001 * size:
            break
    return tuple(found)


def delayed(drive: Array, whole: int) -> Array:
    """Rows of a drive so many samples later; zero before the first."""
    if whole == 0:
        return drive
    moved = np.zeros_like(drive)
    if whole > 0:
        moved[whole:] = drive[:-whole]
    else:
        moved[:whole] = drive[-whole:]
    return moved


class Predictor:
    """The one-step predictor of a θ with a filter's stages, in coordinates in which its four states are independent."""

    def __init__(self, theta: Array, course: tuple[Stage, ...] = AT_REST) -> None:
        self.theta, self.course = theta, course
        self._model = discrete(theta)
        self._modes = [_Modes(self._model.step, stage.gain) for stage in course]

    def predicted(self, piece: Piece, motion: Array) -> Array:
        """Volts (n, 2) predicted from the samples before, with the state (4,) `motion` at the first row."""
        model, offset = self._model, self.theta[12:14]
        recent, older = (delayed(piece.drive, model.whole + more)[piece.lead :] for more in (0, 1))
        return self._run(recent @ model.late.T + older @ model.early.T, piece.sense - offset, motion) + offset

    def begun(self, count: int) -> Array:
        """What each entry of the state at the first row makes of `count` rows (4, count, 2)."""
        nothing = np.zeros((count, 4)), np.zeros((count, 2))
        return np.stack([self._run(nothing[0].copy(), nothing[1], motion) for motion in np.eye(4)])

    def wider(self, count: int) -> Array:
        """Standard deviations (count, 2) of the innovations over those of the sense noise."""
        wider = np.ones((count, 2))
        for stage in self.course:
            wider[stage.begin :] = stage.wider
        return wider

    def _run(self, entered: Array, sense: Array, motion: Array) -> Array:
        volts = np.empty((len(entered), 2))
        ends = [*(stage.begin for stage in self.course[1:]), len(entered)]
        before: _Modes | None = None
        for stage, modes, until in zip(self.course, self._modes, ends, strict=True):
            begin, end = stage.begin, min(until, len(entered))
            if begin >= end:
                break
            part = entered[begin:end]
            if before is None:
                part[0] = motion
            else:
                part[0] += before.step @ motion + before.onward @ sense[begin - 1]
            if modes.followed:
                part[1:] += sense[begin : end - 1] @ modes.onward.T
            volts[begin:end], motion = modes.rung(part)
            before = modes
        return volts


class _Modes:
    """A stage of the filter: x[m + 1] = step x[m] + onward v[m] + …"""

    def __init__(self, step: Array, gain: Array) -> None:
        self.onward = step @ gain
        self.followed = bool(gain.any())
        self.step = step - self.onward @ np.eye(2, 4)
        self._poles, self._shapes = np.linalg.eig(self.step)
        self._inverse = np.linalg.inv(self._shapes)

    def rung(self, entered: Array) -> tuple[Array, Array]:
        """Volts (n, 2) of what enters row by row, and the last state (4,)."""
        volts, last = np.zeros((len(entered), 2)), np.zeros(4)
        for at, pole in enumerate(self._poles):
            if pole.imag < 0.0:  # the other of a pair
                continue
            states = lfilter([1.0], [1.0, -pole], entered @ self._inverse[at])
            weight = (2.0 if pole.imag > 0.0 else 1.0) * self._shapes[:, at]
            for axis in range(2):
                volts[:, axis] += weight[axis].real * states.real - weight[axis].imag * states.imag
            last += (weight * states[-1]).real
        return volts, last


def pieces(sense: Array, drive: Array, least: int = 64) -> Iterator[Piece]:
    """A record (n, 2), NaN where samples are missing, cut at its gaps; what is shorter than `least` is left out."""
    there = np.isfinite(sense).all(axis=1) & np.isfinite(drive).all(axis=1)
    for begin, end in spans(there):
        if end - begin >= least:
            yield Piece(sense[begin:end], drive[begin:end])
