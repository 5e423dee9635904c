"""The proof mass: its motion in the board's frame over one sample interval, integrated at a small fixed step.

    ẍ + dxx ẋ + dxy ẏ + kxx x + kxy y = ux + 2Ω ẏ + Ω² x + Ω̇ y + hidden effects + force noise
    ÿ + dxy ẋ + dyy ẏ + kxy x + kyy y = uy - 2Ω ẋ + Ω² y - Ω̇ x + hidden effects + force noise

per unit mass. Explicit Runge-Kutta of order 6 (Butcher 1964, seven stages) at `substeps` ≥ 8 steps per sample
and ≥ 128 per cycle: its frequency error is below 1e-11, far from what any observer here resolves.

The force noise is white: Brownian, of intensity 2 kB T D / m² for the whole damping matrix D (fluctuation and
dissipation), plus the drive amplifier's. It is drawn once per sub-step and held over it.

Where Ω jumps, Ω̇ is an impulse and turns the velocity seen from the board: ẋ += ΔΩ y, ẏ -= ΔΩ x.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator import effects, rate
from device_emulator.compiled import compiled
from device_emulator.scenario import Scenario

BOLTZMANN_J_PER_K = 1.380649e-23
STEPS_PER_CYCLE = 128

PLANT = np.dtype(
    [
        ("ts_s", "f8"),
        ("substeps", "i8"),
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
    ts = 1.0 / scenario.board.sample_rate_Hz
    substeps = max(8, math.ceil(STEPS_PER_CYCLE * ts * math.sqrt(max(kxx, kyy)) / (2.0 * math.pi)))
    thermal = 2.0 * BOLTZMANN_J_PER_K * truth.temperature_K / truth.mass_kg
    intensity = thermal * np.array([[dxx, dxy], [dxy, dyy]])
    intensity += 0.5 * scenario.drive.noise_mps2_per_rtHz**2 * np.eye(2)
    # By eigenvalues and QR, not `cholesky`: the matrix may be singular (no damping, no noise).
    values, vectors = np.linalg.eigh(intensity * substeps / ts)
    upper: NDArray[np.float64] = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T).R
    constants = np.zeros(1, PLANT)
    constants[0] = (ts, substeps, kxx, kyy, kxy, dxx, dyy, dxy, upper[0, 0], upper[0, 1], upper[1, 1])
    return constants


@compiled
def acceleration(
    plant: Any,
    hidden: NDArray[Any],
    t_s: float,
    rate_rad_s: float,
    slope_rad_s2: float,
    x: float,
    vx: float,
    y: float,
    vy: float,
) -> tuple[float, float]:
    """(ẍ, ÿ) of the undriven, noiseless mass."""
    ax, ay = effects.force(hidden, t_s, x, vx, y, vy)
    centrifugal = rate_rad_s * rate_rad_s
    ax += 2.0 * rate_rad_s * vy + centrifugal * x + slope_rad_s2 * y
    ay += -2.0 * rate_rad_s * vx + centrifugal * y - slope_rad_s2 * x
    ax -= plant.dxx * vx + plant.dxy * vy + plant.kxx * x + plant.kxy * y
    ay -= plant.dxy * vx + plant.dyy * vy + plant.kxy * x + plant.kyy * y
    return ax, ay


@compiled
def step(
    plant: Any,
    hidden: NDArray[Any],
    piece: Any,
    t_s: float,
    h: float,
    ax: float,
    ay: float,
    motion: NDArray[np.float64],
    stages: NDArray[np.float64],
) -> None:
    """Carry `motion` = [x, ẋ, y, ẏ] from t_s over h seconds, back when h < 0.

    (ax, ay) is added to the acceleration throughout; `stages`, shape (7, 4), is scratch.
    """
    for i in range(7):
        x, vx, y, vy = motion[0], motion[1], motion[2], motion[3]
        for j in range(i):
            weight = h * _A[i, j]
            x += weight * stages[j, 0]
            vx += weight * stages[j, 1]
            y += weight * stages[j, 2]
            vy += weight * stages[j, 3]
        t = t_s + _C[i] * h
        rate_rad_s, slope_rad_s2 = rate.rate_at(piece, t)
        sx, sy = acceleration(plant, hidden, t, rate_rad_s, slope_rad_s2, x, vx, y, vy)
        stages[i, 0] = vx
        stages[i, 1] = sx + ax
        stages[i, 2] = vy
        stages[i, 3] = sy + ay
    for i in range(7):
        weight = h * _B[i]
        for j in range(4):
            motion[j] += weight * stages[i, j]
