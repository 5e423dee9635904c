"""How effects enter the flow of two axes: impulses between exact drifts, each a matrix that takes every column along.

The scheme is the symmetric one of orders (8, 6, 4) of Blanes, Casas, Farrés, Laskar, Makazaga & Murua (Appl. Numer.
Math. 68, 2013).
"""

import math

import numpy as np

from estimator.kernel.compiled import compiled, generated, inlined
from estimator.kernel.lanes import put, take
from estimator.kernel.layout import Floats
from estimator.kernel.structures import Push
from estimator.kernel.taylor import LONGEST, LONGEST_WITHIN, MOST_TERMS, taylor_terms

_powers = generated().gyro_powers
DRIFTS = (
    0.07113342649822312,
    0.24115342795664010,
    0.52141176177281479,
    -0.33369861622767801,
    -0.33369861622767801,
    0.52141176177281479,
    0.24115342795664010,
    0.07113342649822312,
)
KICKS = (
    0.18308368747219722,
    0.31078285989857487,
    -0.02656461851195880,
    0.06539614228237342,
    -0.02656461851195880,
    0.31078285989857487,
    0.18308368747219722,
)
LENGTHS = 4
"""Of a drift: those of the second half are those of the first."""
OF_A_LENGTH = 80
_NODES = (1.0, 0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15))
_WEIGHTS = (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
"""Of Gauss's rule of three points, which follow the end of an interval."""
_ONE_OVER = 1.0 / np.arange(1, MOST_TERMS + 2)


@compiled
def drift_matrices(c: Floats, u: Floats, h: float, powers: Floats, out: Floats) -> None:
    """out (LENGTHS, OF_A_LENGTH) ← how two axes move over each length of a drift, in parts of h: the columns of
    exp(M t) and what the drive u (2, 1) adds; then both for Gauss's points within it.  powers is scratch.
    """
    order = taylor_terms(LONGEST, DRIFTS[2] * h, powers.shape[0] - 1)  # of the longest
    _powers(c, h, order, powers)
    ux, uy = u[0, 0], u[1, 0]
    for which in range(LENGTHS):
        for node in range(4):
            length = DRIFTS[which] * _NODES[node]
            share, t = 1.0, length * h
            f0, f1, f2, f3 = take(powers, 0, 4), take(powers, 4, 4), take(powers, 8, 4), take(powers, 12, 4)
            driven = (t * ux) * f1 + (t * uy) * f3
            for n in range(1, taylor_terms(LONGEST if node == 0 else LONGEST_WITHIN, t, order) + 1):
                share *= length
                at = 16 * n
                q1, q3 = take(powers, at + 4, 4), take(powers, at + 12, 4)
                f0, f1 = f0 + share * take(powers, at, 4), f1 + share * q1
                f2, f3 = f2 + share * take(powers, at + 8, 4), f3 + share * q3
                since = share * t * _ONE_OVER[n]
                driven = driven + (since * ux) * q1 + (since * uy) * q3
            at = OF_A_LENGTH * which + 20 * node
            put(out, at, f0)
            put(out, at + 4, f1)
            put(out, at + 8, f2)
            put(out, at + 12, f3)
            put(out, at + 16, driven)


@inlined
def drift(which: int, drifts: Floats, out: Floats) -> None:
    """The columns of out ← where the drift of one length, with no drive in it, takes them."""
    columns = out.shape[1]
    m = drifts[which]
    m0, m4, m8, m12, m1, m5, m9, m13 = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7]
    m2, m6, m10, m14, m3, m7, m11, m15 = m[8], m[9], m[10], m[11], m[12], m[13], m[14], m[15]
    fours = columns - columns % 4
    for j in range(0, fours, 4):
        o0, o1 = take(out, j, 4), take(out, columns + j, 4)
        o2, o3 = take(out, 2 * columns + j, 4), take(out, 3 * columns + j, 4)
        put(out, j, m0 * o0 + m1 * o1 + m2 * o2 + m3 * o3)
        put(out, columns + j, m4 * o0 + m5 * o1 + m6 * o2 + m7 * o3)
        put(out, 2 * columns + j, m8 * o0 + m9 * o1 + m10 * o2 + m11 * o3)
        put(out, 3 * columns + j, m12 * o0 + m13 * o1 + m14 * o2 + m15 * o3)
    for j in range(fours, columns):
        p0, p1, p2, p3 = out[0, j], out[1, j], out[2, j], out[3, j]
        out[0, j] = m0 * p0 + m1 * p1 + m2 * p2 + m3 * p3
        out[1, j] = m4 * p0 + m5 * p1 + m6 * p2 + m7 * p3
        out[2, j] = m8 * p0 + m9 * p1 + m10 * p2 + m11 * p3
        out[3, j] = m12 * p0 + m13 * p1 + m14 * p2 + m15 * p3


@inlined
def drift_entries(which: int, t: float, drifts: Floats, out: Floats, entries: Floats) -> None:
    """entries (4, 8) ← what each state, added to the force of each axis all along this drift, too, does by its end;
    out's first column is the state at its start.
    """
    drift(which, drifts, entries)
    for point in range(3):
        at = OF_A_LENGTH * which + 20 * (1 + point)
        s = out[0, 0] * take(drifts, at, 4) + out[1, 0] * take(drifts, at + 4, 4)
        s = s + out[2, 0] * take(drifts, at + 8, 4) + out[3, 0] * take(drifts, at + 12, 4)
        s = (_WEIGHTS[point] * t) * (s + take(drifts, at + 16, 4))
        rest = 20 * (3 - point)  # the points lie as far from the end as from the start
        for i in range(4):
            of_x, of_y = drifts[which, rest + 4 + i], drifts[which, rest + 12 + i]
            put(entries, 8 * i, take(entries, 8 * i, 4) + of_x * s)
            put(entries, 8 * i + 4, take(entries, 8 * i + 4, 4) + of_y * s)


@inlined
def push_entries(weight: float, push: Push, entries: Floats) -> None:
    """The velocities in entries ← what weight × the forces in push, by the states, leave of them."""
    by_states = push.by_states
    x0, x1, x2, x3 = by_states[0, 0], by_states[0, 1], by_states[0, 2], by_states[0, 3]
    y0, y1, y2, y3 = by_states[1, 0], by_states[1, 1], by_states[1, 2], by_states[1, 3]
    for j in range(0, 8, 4):
        o0, o1, o2, o3 = (
            take(entries, j, 4),
            take(entries, 8 + j, 4),
            take(entries, 16 + j, 4),
            take(entries, 24 + j, 4),
        )
        put(entries, 8 + j, o1 + weight * (x0 * o0 + x1 * o1 + x2 * o2 + x3 * o3))
        put(entries, 24 + j, o3 + weight * (y0 * o0 + y1 * o1 + y2 * o2 + y3 * o3))
