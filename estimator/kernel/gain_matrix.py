"""The control law as one matrix on a board's filtered signals, exact for the motion it aims at.

The motion X = (x, ẋ, y, ẏ) aimed at is linear, Ẋ = M X: an isotropic oscillator that turns, with the holds' damping of
the moment.  In it everything that the board does is linear in X[m] too.  Its filter gives s[m] = S X[m] with

    S E = A S + (b + c E⁻ᴰ) v E,        E = exp(M h), v the row that picks an axis' code out of X

and a drive F X[m], held over the interval that begins L samples later, keeps the sampled positions on that motion when

    N E = Ad N + Bd F E⁻ᴸ               the rows of N that belong to positions being those of X itself

with the exact flow Ad, Bd of the estimated gyro.  Both are linear equations; G = F S⁻¹.  So filter, delay and hold are
exact at the frequencies of that motion, (1 ± (Ω + Ωv)) ω0, and nothing is approximated but by the estimates themselves.
"""

from typing import NamedTuple

import numpy as np

from estimator.kernel.compiled import compiled
from estimator.kernel.controller import holds, virtual_rate
from estimator.kernel.layout import RATE, Floats, Record
from estimator.kernel.taylor import taylor


class Filter(NamedTuple):
    """Of a board: s[m] = a s[m − 1] + b v[m] + c v[m − delay] for each axis; a (2, 2), b and c (2,)."""

    a: Floats
    b: Floats
    c: Floats
    delay: int


@compiled
def target_motion(settings: Record, memory: Record, x: Floats, fastest: float, ahead: float = 0.0) -> Floats:
    """M (4, 4) for the state vector x, `ahead` of it in time; no hold acts faster than `fastest`."""
    rate = x[settings.states + RATE]
    w = rate + virtual_rate(settings, memory.time + ahead)
    hold, square = holds(settings, memory, x, rate, w, fastest)
    k = settings.stiffness - rate * rate
    m = np.zeros((4, 4))
    m[0, 1] = 1.0
    m[2, 3] = 1.0
    m[1, 0] = -k
    m[1, 1] = hold
    m[1, 2] = -square - hold * w
    m[1, 3] = 2.0 * w
    m[3, 0] = square + hold * w
    m[3, 1] = -2.0 * w
    m[3, 2] = -k
    m[3, 3] = hold
    return m


@compiled
def exponential(m: Floats, h: float, order: int) -> Floats:
    """exp(m h) as a Taylor series of a short step."""
    out = np.eye(m.shape[0])
    term = np.eye(m.shape[0])
    for n in range(order):
        term = (term @ m) * (h / (n + 1.0))
        out += term
    return out


@compiled
def sylvester(p: Floats, e: Floats, q: Floats, r: Floats) -> Floats:
    """y (2, 4) with p y e + q y = r, for 2 × 2 p and q."""
    a = np.zeros((8, 8))
    for i in range(2):
        for j in range(4):
            for k in range(2):
                a[4 * i + j, 4 * k + j] += q[i, k]
                for n in range(4):
                    a[4 * i + j, 4 * k + n] += p[i, k] * e[n, j]
    y = np.zeros((2, 4))
    y.reshape(8)[:] = np.linalg.solve(a, r.copy().reshape(8))
    return y


@compiled
def power(e: Floats, n: int) -> Floats:
    """eⁿ for n ≥ 0."""
    out = np.eye(e.shape[0])
    for _ in range(n):
        out = out @ e
    return out


@compiled
def exact_flow(settings: Record, c: Floats) -> Floats:
    """[Ad, Bd] (4, 6) of the gyro with constants c over one sample."""
    out = np.zeros((4, 6))
    column, term = np.zeros((4, 1)), np.zeros((4, 1))
    u = np.zeros((2, 1))
    for j in range(6):
        column[:] = 0.0
        u[:] = 0.0
        if j < 4:
            column[j, 0] = 1.0
        else:
            u[j - 4, 0] = 1.0
        taylor(settings.model, c, u, settings.h, settings.order, 1, term, column)
        out[:, j] = column[:, 0]
    return out


@compiled
def force_of_motion(settings: Record, c: Floats, e: Floats) -> Floats:
    """F (2, 4): the drive that keeps the sampled motion of the gyro with constants c on X[m + 1] = e X[m]."""
    flow = exact_flow(settings, c)
    app, apv, avp, avv = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2))
    bp, bv = np.zeros((2, 2)), np.zeros((2, 2))
    places, sampled = np.zeros((2, 4)), np.zeros((2, 4))
    for i in range(2):
        places[i, 2 * i] = 1.0
        sampled[i] = e[2 * i]
        for j in range(2):
            app[i, j] = flow[2 * i, 2 * j]
            apv[i, j] = flow[2 * i, 2 * j + 1]
            avp[i, j] = flow[2 * i + 1, 2 * j]
            avv[i, j] = flow[2 * i + 1, 2 * j + 1]
            bp[i, j] = flow[2 * i, 4 + j]
            bv[i, j] = flow[2 * i + 1, 4 + j]
    # The rows of positions give the velocities, V = bare − reach F', with F' = F E⁻ᴸ; those of velocities then give F'.
    bare = np.linalg.solve(apv, sampled - app @ places)
    reach = np.linalg.solve(apv, bp)
    drive = sylvester(-reach, e, avv @ reach - bv, avp @ places - bare @ e + avv @ bare)
    force: Floats = drive @ power(e, settings.latency)
    return force


@compiled
def filtered_motion(settings: Record, e: Floats, board: Filter) -> Floats:
    """S (4, 4): what the board's filter makes of the motion X[m + 1] = e X[m], in sense codes."""
    s = np.zeros((4, 4))
    before = power(np.linalg.inv(e), board.delay)
    for axis in range(2):
        row = np.zeros((1, 4))
        row[0, 2 * axis + settings.sensed[axis]] = 1.0 / settings.sense_scale[axis]  # displacement, or velocity
        heard = board.b.reshape((2, 1)) * row + board.c.reshape((2, 1)) * (row @ before)
        s[2 * axis : 2 * axis + 2] = sylvester(np.eye(2), e, -board.a, heard @ e)
    return s


@compiled
def gain_matrix(
    settings_record: Record,
    memory_record: Record,
    x: Floats,
    board: Filter,
    fastest: float,
    ahead: float,
    gain: Floats,
    bias: Floats,
) -> None:
    """gain (2, 4) and bias (2,) in drive codes for the state vector x and the board's filter, in force from `ahead` of
    it in time on.
    """
    settings = settings_record[0]
    e = exponential(target_motion(settings, memory_record[0], x, fastest, ahead), settings.h, settings.order)
    constants = x[settings.states :].copy()
    force = force_of_motion(settings, constants, e)
    signals = filtered_motion(settings, e, board)
    gain[:] = np.linalg.solve(signals.T.copy(), force.T.copy()).T / settings.quantum
    still = np.linalg.solve(np.eye(2) - board.a, board.b + board.c)
    for i in range(2):
        bias[i] = 0.0
        for axis in range(2):
            offset = constants[axis] / settings.sense_scale[axis]
            bias[i] -= (gain[i, 2 * axis] * still[0] + gain[i, 2 * axis + 1] * still[1]) * offset
