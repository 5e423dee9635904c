"""Attitude of a body from the angles of three single-axis gyros: rotation vectors, coning, quaternion, uncertainty.

An angle φ_i = ∫ a_i·ω dt about the sensitive axis a_i, fixed to the body, is no angle of the body where it turns about
several axes. Increments are: with the rows a_i of the mount matrix A, A⁻¹ Δφ is the sum of ω dt in the body's frame.
Two of them in a row give the rotation vector of their interval,

    ρ = Δ1 + Δ2 + ⅔ Δ1 × Δ2,

Bortz's equation (IEEE Trans. AES 7, 1971) to second order for a rate that changes linearly (Miller, J. Guidance 6,
1983; Savage, J. Guidance 21, 1998). The last term is the coning: what the integral of the rates misses.

Uncertainty: e_i(t) = z_i u_i(t) of each angle, with z_i of unit variance, gives the small rotation ψ of the reference
frame ∫ C A⁻¹ de; a sensitive axis that is off by δa_i gives -∫ C A⁻¹_i (δa_i·Δ). All of it is linear: one vector for
each z, whose outer products sum to the covariance.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Attitude:
    """After each second interval, from rest at the first: (n,) and (n, …).

    time_s; quaternion (n, 4), scalar first, which turns a vector of the body's frame into the reference frame, that of
    the body at the first row; covariance (n, 3, 3) [rad²] of the small rotation by which it is off, in the reference
    frame; coning (n, 3) [rad], the sum of ⅔ Δ1 × Δ2 so far, in the body's frame.
    """

    time_s: Array
    quaternion: Array
    covariance: Array
    coning: Array

    @property
    def deviation(self) -> Array:
        """Standard uncertainty (n,) [rad] of the attitude: root of the trace, all three axes together."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))


def attitude(time_s: Array, angles: Array, deviations: Array, mount: Array, mount_u: Array) -> Attitude:
    """The attitude from angles (n, 3) [rad] at times (n,) [s], with their standard uncertainties (n, 3) since the first
    row; mount (3, 3): unit vectors of the sensitive axes in the body's frame, a row each; mount_u (3,) [rad]: standard
    uncertainty of each direction, the same across it both ways.

    Raises ValueError for fewer than three rows.
    """
    if len(time_s) < 3:
        raise ValueError("an attitude needs three instants at least")
    n = (len(time_s) - 1) // 2
    inverse = np.linalg.inv(mount)
    turned = np.diff(angles, axis=0)[: 2 * n] @ inverse.T
    first, second = turned[0::2], turned[1::2]
    coning = np.cross(first, second) * (2.0 / 3.0)
    rotation = first + second + coning
    grown = np.diff(deviations[: 2 * n + 1 : 2], axis=0)  # (n, 3)
    across = np.stack([_across(axis) for axis in mount])  # (3, 2, 3)
    off = np.einsum("ikj,nj->nik", across, first + second) * mount_u[:, None]  # (n, 3, 2)
    quaternion = np.zeros((n + 1, 4))
    quaternion[0, 0] = 1.0
    covariance = np.zeros((n + 1, 3, 3))
    by_source = np.zeros((3, 9))
    steps = _quaternions(rotation)
    for k in range(n):
        frame = matrix(quaternion[k]) @ matrix(_half(steps[k]))  # of the middle of the interval
        made = np.hstack([inverse * grown[k], *(-inverse[:, i : i + 1] * off[k, i] for i in range(3))])
        by_source += frame @ made
        covariance[k + 1] = by_source @ by_source.T
        quaternion[k + 1] = product(quaternion[k], steps[k])
    return Attitude(
        time_s[: 2 * n + 1 : 2], quaternion, covariance, np.vstack([np.zeros(3), np.cumsum(coning, axis=0)])
    )


def product(p: Array, q: Array) -> Array:
    """The quaternion of p after q (4,), of unit length."""
    w, v = p[0] * q[0] - p[1:] @ q[1:], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    made = np.array([w, *v])
    return np.asarray(made / np.sqrt(made @ made))


def matrix(q: Array) -> Array:
    """The rotation matrix (3, 3) of a unit quaternion (4,)."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def apart(p: Any, q: Any) -> float:
    """Angle [rad] of the rotation from one unit quaternion to the other."""
    p, q = np.asarray(p, float), np.asarray(q, float)
    between = product(p * np.array([1.0, -1.0, -1.0, -1.0]), q)
    return float(2.0 * np.arctan2(np.sqrt(between[1:] @ between[1:]), abs(between[0])))


def _quaternions(rotation: Array) -> Array:
    """Of rotation vectors (n, 3)."""
    half = 0.5 * np.linalg.norm(rotation, axis=1)
    return np.column_stack([np.cos(half), 0.5 * np.sinc(half / np.pi)[:, None] * rotation])


def _half(q: Array) -> Array:
    """Of half the rotation."""
    made = q + np.array([1.0, 0.0, 0.0, 0.0])
    return np.asarray(made / np.sqrt(made @ made))


def _across(axis: Array) -> Array:
    """Two unit vectors (2, 3) across the axis and each other."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    one = np.cross(axis, helper)
    one /= np.sqrt(one @ one)
    return np.stack([one, np.cross(axis, one)])
