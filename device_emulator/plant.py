"""The proof mass: its motion in the board's frame over one sample interval, integrated at a small fixed step.

    ẍ + dxx ẋ + dxy ẏ + kxx x + kxy y = ux + 2Ω ẏ + Ω² x + Ω̇ y + hidden effects + force noise
    ÿ + dxy ẋ + dyy ẏ + kxy x + kyy y = uy - 2Ω ẋ + Ω² y - Ω̇ x + hidden effects + force noise

per unit mass. Explicit Runge-Kutta of order 6 (Butcher 1964, seven stages) at 8 steps per sample; more where these
would be fewer than 128 per cycle, less where 256 per cycle are enough. Its frequency error is below 1e-11, far from
what any observer here resolves. While dry friction turns over, within some v0 of rest, a step is cut until the velocity
moves by half of v0 in each part; else what friction gives in the sample of a turn would be off by up to 4 %. Effects
with states of their own (a parasitic mode, a support) have them integrated along, at ≥ 32 steps per cycle of theirs.
Where the mass takes along the foot of an element with play, or leaves it, a step ends (`device_emulator.play`).

The force noise is white: Brownian, of intensity 2 kB T D / m² for the whole damping matrix D (fluctuation and
dissipation), plus the drive amplifier's. It is drawn once per sub-step and held over it.

Where Ω jumps, Ω̇ is an impulse and turns the velocity seen from the board: ẋ += ΔΩ y, ẏ -= ΔΩ x.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator import rate
from device_emulator.compiled import compiled
from device_emulator.effects.catalogue import inner_states, resonance_Hz
from device_emulator.effects.declaration import MAX_INNER
from device_emulator.effects.force import ForceKind, force
from device_emulator.scenario import Scenario
from device_emulator.temperature import TEMPERATURE, temperature_constants, warmer

_State = tuple[float, float, float, float]
BOLTZMANN_J_PER_K = 1.380649e-23
STEPS_PER_CYCLE = 128
STEPS_PER_INNER_CYCLE = 32
TURNOVER = 6.0
PARTS_PER_REST = 2.0
MOST_PARTS = 256.0
"""Of a step in which friction turns over: in v0, how near to rest that is; parts while the velocity moves by v0; and no
more than that, for a v0 of next to nothing.
"""
_TURNING_OVER = (
    ForceKind.DRY_FRICTION,
    ForceKind.DRY_FRICTION_ASYMMETRIC,
    ForceKind.STRIBECK_FRICTION,
    ForceKind.DRY_FRICTION_RADIAL,
)
STATES = 4 + MAX_INNER
"""Longest state vector: x, ẋ, y, ẏ and what the effects have of their own."""

PLANT = np.dtype(
    [
        ("ts_s", "f8"),
        ("substeps", "i8"),
        ("states", "i8"),  # of the mass and the effects
        ("kxx", "f8"),
        ("kyy", "f8"),
        ("kxy", "f8"),
        ("dxx", "f8"),
        ("dyy", "f8"),
        ("dxy", "f8"),
        # Lower Cholesky factor of the force noise's covariance over one sub-step, m/s².
        ("noise_xx", "f8"),
        ("noise_yx", "f8"),
        ("noise_yy", "f8"),
        ("temperature", TEMPERATURE),
    ],
    align=True,
)

# Butcher's sixth-order tableau: nodes C, coefficients A, weights B.
_C = np.array([0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1])
_A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 3, 0, 0, 0, 0, 0],
        [0, 2 / 3, 0, 0, 0, 0],
        [1 / 12, 1 / 3, -1 / 12, 0, 0, 0],
        [-1 / 16, 9 / 8, -3 / 16, -3 / 8, 0, 0],
        [0, 9 / 8, -3 / 8, -3 / 4, 1 / 2, 0],
        [9 / 44, -9 / 11, 63 / 44, 18 / 11, 0, -16 / 11],
    ]
)
_B = np.array([11 / 120, 0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120])


def plant_constants(scenario: Scenario) -> NDArray[Any]:
    """The plant as its kernel reads it, shape (1,) of dtype `PLANT`, everything per unit mass."""
    truth = scenario.truth
    kxx, kyy, kxy = (k / truth.mass_kg for k in truth.stiffness_N_per_m)
    dxx, dyy, dxy = (d / truth.mass_kg for d in truth.damping_N_s_per_m)
    ts = 1.0 / scenario.true_rate_Hz
    own = STEPS_PER_CYCLE * math.sqrt(max(kxx, kyy)) / (2.0 * math.pi)
    needed = math.ceil(ts * max(own, STEPS_PER_INNER_CYCLE * resonance_Hz(scenario.effect)))
    substeps = max(needed, min(8, math.ceil(2.0 * ts * own)))
    thermal = 2.0 * BOLTZMANN_J_PER_K * truth.temperature_K / truth.mass_kg
    intensity = thermal * np.array([[dxx, dxy], [dxy, dyy]])
    intensity += 0.5 * scenario.drive.noise_mps2_per_rtHz**2 * np.eye(2)
    # By eigenvalues and QR, not `cholesky`: the matrix may be singular (no damping, no noise).
    values, vectors = np.linalg.eigh(intensity * substeps / ts)
    upper: NDArray[np.float64] = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T).R
    constants = np.zeros(1, PLANT)
    c = constants[0]
    c["ts_s"], c["substeps"], c["states"] = ts, substeps, 4 + inner_states(scenario.effect)
    c["kxx"], c["kyy"], c["kxy"] = kxx, kyy, kxy
    c["dxx"], c["dyy"], c["dxy"] = dxx, dyy, dxy
    c["noise_xx"], c["noise_yx"], c["noise_yy"] = upper[0, 0], upper[0, 1], upper[1, 1]
    constants["temperature"] = temperature_constants(scenario.temperature)
    return constants


@compiled
def acceleration(
    plant: Any,
    rate_rad_s: float,
    slope_rad_s2: float,
    ux: float,
    uy: float,
    x: float,
    vx: float,
    y: float,
    vy: float,
) -> tuple[float, float]:
    """(ẍ, ÿ) of the noiseless mass under the force ux, uy, without hidden effects."""
    centrifugal = rate_rad_s * rate_rad_s
    ax = ux + 2.0 * rate_rad_s * vy + centrifugal * x + slope_rad_s2 * y
    ay = uy - 2.0 * rate_rad_s * vx + centrifugal * y - slope_rad_s2 * x
    ax -= plant.dxx * vx + plant.dxy * vy + plant.kxx * x + plant.kxy * y
    ay -= plant.dxy * vx + plant.dyy * vy + plant.kxy * x + plant.kyy * y
    return ax, ay


@compiled
def derivative(
    plant: Any,
    hidden: NDArray[Any],
    t_s: float,
    rate_rad_s: float,
    slope_rad_s2: float,
    ux: float,
    uy: float,
    s: NDArray[np.float64],
    ds: NDArray[np.float64],
) -> None:
    """ds ← derivative of s = [x, ẋ, y, ẏ, …] of the noiseless mass under the force ux, uy."""
    x, vx, y, vy = s[0], s[1], s[2], s[3]
    ds[0] = vx
    ds[2] = vy
    ds[1], ds[3] = acceleration(plant, rate_rad_s, slope_rad_s2, ux, uy, x, vx, y, vy)
    if len(hidden) > 0:
        force(plant, hidden, t_s, warmer(plant.temperature, t_s), rate_rad_s, slope_rad_s2, ux, uy, s, ds)


@compiled
def parts(
    plant: Any,
    hidden: NDArray[Any],
    piece: Any,
    t_s: float,
    h: float,
    push: NDArray[np.float64],
    motion: NDArray[np.float64],
) -> int:
    """Into how many equal parts a step has to be cut for dry friction that turns over in it; 1 where none does."""
    most = 1.0
    for effect in hidden:
        if effect.kind not in _TURNING_OVER:
            continue
        radial = effect.kind == ForceKind.DRY_FRICTION_RADIAL
        rest = effect.c[1 if radial else 2]
        rate_rad_s, slope_rad_s2 = rate.rate_at(piece, t_s)
        x, vx, y, vy = motion[0], motion[1], motion[2], motion[3]
        ax, ay = acceleration(plant, rate_rad_s, slope_rad_s2, push[0], push[1], x, vx, y, vy)
        near = TURNOVER * rest
        if radial:
            moved_by = h * math.hypot(ax, ay)
            if math.hypot(vx + 0.5 * ax * h, vy + 0.5 * ay * h) < 0.5 * moved_by + near:
                most = max(most, PARTS_PER_REST * moved_by / rest)
            continue
        for friction, v, a in ((effect.c[0], vx, ax), (effect.c[1], vy, ay)):
            moved_by = abs(a * h)
            if friction != 0.0 and abs(v + 0.5 * a * h) < 0.5 * moved_by + near:
                most = max(most, PARTS_PER_REST * moved_by / rest)
    return math.ceil(min(most, MOST_PARTS))


@compiled
def step(
    plant: Any,
    hidden: NDArray[Any],
    piece: Any,
    t_s: float,
    h: float,
    push: NDArray[np.float64],
    n: int,
    motion: NDArray[np.float64],
    stages: NDArray[np.float64],
) -> None:
    """Carry the first n entries of `motion` = [x, ẋ, y, ẏ, …] from t_s over h seconds, back when h < 0.

    push (6,) is the drive ux, uy at t_s, its slopes, and a force on the mass alone, held; `stages`, shape
    (8, STATES), is scratch.
    """
    s = stages[7]
    for i in range(7):
        for k in range(motion.shape[0]):
            s[k] = motion[k]
        for j in range(i):
            weight = h * _A[i, j]
            for k in range(n):
                s[k] += weight * stages[j, k]
        since = _C[i] * h
        rate_rad_s, slope_rad_s2 = rate.rate_at(piece, t_s + since)
        ux, uy = push[0] + since * push[2], push[1] + since * push[3]
        derivative(plant, hidden, t_s + since, rate_rad_s, slope_rad_s2, ux, uy, s, stages[i])
        stages[i, 1] += push[4]
        stages[i, 3] += push[5]
    for i in range(7):
        weight = h * _B[i]
        for k in range(n):
            motion[k] += weight * stages[i, k]


@compiled
def flow(plant: Any, piece: Any, t_s: float, since: float, push: NDArray[np.float64], s: _State) -> _State:
    """Derivative of s = (x, ẋ, y, ẏ) of the mass without hidden effects, `since` seconds after t_s, as in `step`."""
    rate_rad_s, slope_rad_s2 = rate.rate_at(piece, t_s + since)
    ux, uy = push[0] + since * push[2], push[1] + since * push[3]
    ax, ay = acceleration(plant, rate_rad_s, slope_rad_s2, ux, uy, s[0], s[1], s[2], s[3])
    return s[1], ax + push[4], s[3], ay + push[5]


@compiled
def moved(s: _State, weight: float, k: _State) -> _State:
    """s + weight · k."""
    return s[0] + weight * k[0], s[1] + weight * k[1], s[2] + weight * k[2], s[3] + weight * k[3]


@compiled
def step_alone(
    plant: Any, piece: Any, t_s: float, h: float, push: NDArray[np.float64], motion: NDArray[np.float64]
) -> None:
    """`step` for a mass without hidden effects: the same arithmetic, to the last bit, all of it in registers."""
    s = motion[0], motion[1], motion[2], motion[3]
    k0 = flow(plant, piece, t_s, 0.0, push, s)
    k1 = flow(plant, piece, t_s, _C[1] * h, push, moved(s, h * _A[1, 0], k0))
    k2 = flow(plant, piece, t_s, _C[2] * h, push, moved(s, h * _A[2, 1], k1))
    at = moved(moved(moved(s, h * _A[3, 0], k0), h * _A[3, 1], k1), h * _A[3, 2], k2)
    k3 = flow(plant, piece, t_s, _C[3] * h, push, at)
    at = moved(moved(moved(s, h * _A[4, 0], k0), h * _A[4, 1], k1), h * _A[4, 2], k2)
    k4 = flow(plant, piece, t_s, _C[4] * h, push, moved(at, h * _A[4, 3], k3))
    at = moved(moved(moved(s, h * _A[5, 1], k1), h * _A[5, 2], k2), h * _A[5, 3], k3)
    k5 = flow(plant, piece, t_s, _C[5] * h, push, moved(at, h * _A[5, 4], k4))
    at = moved(moved(moved(s, h * _A[6, 0], k0), h * _A[6, 1], k1), h * _A[6, 2], k2)
    k6 = flow(plant, piece, t_s, _C[6] * h, push, moved(moved(at, h * _A[6, 3], k3), h * _A[6, 5], k5))
    s = moved(moved(moved(s, h * _B[0], k0), h * _B[2], k2), h * _B[3], k3)
    s = moved(moved(moved(s, h * _B[4], k4), h * _B[5], k5), h * _B[6], k6)
    motion[0], motion[1], motion[2], motion[3] = s
