"""The proof mass: its motion in the board's frame over one sample interval, integrated at a small fixed step.

    ẍ + dxx ẋ + dxy ẏ + kxx x + kxy y = ux + 2Ω ẏ + Ω² x + Ω̇ y + hidden effects + force noise
    ÿ + dxy ẋ + dyy ẏ + kxy x + kyy y = uy - 2Ω ẋ + Ω² y - Ω̇ x + hidden effects + force noise

per unit mass. Explicit Runge-Kutta of order 6 (Butcher 1964, seven stages) at 8 steps per sample; more where these
would be fewer than 128 per cycle, less where 256 per cycle are enough. Its frequency error is below 1e-11, far from
what any observer here resolves. While dry friction turns over, within some v0 of rest, a step is cut until the velocity
moves by half of v0 in each part; else what friction gives in the sample of a turn would be off by up to 4 %. Effects
with states of their own (a parasitic mode, a support) have them integrated along, at ≥ 32 steps per cycle of theirs.
Where the mass takes along the foot of an element with play, or leaves it, a step ends (native/play.h).

The force noise is white: Brownian, of intensity 2 kB T D / m² for the whole damping matrix D (fluctuation and
dissipation), plus the drive amplifier's. It is drawn once per sub-step and held over it.

A bias that wanders turns the pattern as a rate would that the device does not have: it is added to Ω here, and is no
part of the true rate.

Where Ω jumps, Ω̇ is an impulse and turns the velocity seen from the board: ẋ += ΔΩ y, ẏ -= ΔΩ x.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device_emulator.effects.catalogue import inner_states, resonance_Hz
from device_emulator.effects.declaration import MAX_INNER
from device_emulator.flicker import FLICKER, flicker_constants
from device_emulator.scenario import Scenario
from device_emulator.temperature import TEMPERATURE, temperature_constants
from device_emulator.trim import TRIM, trim_constants

BOLTZMANN_J_PER_K = 1.380649e-23
STEPS_PER_CYCLE = 128
STEPS_PER_INNER_CYCLE = 32
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
        ("flicker", FLICKER),  # of the device's own rotation
        ("trim", TRIM),
    ],
    align=True,
)


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
    constants["trim"] = trim_constants(scenario.trim, truth.mass_kg)
    constants["temperature"] = temperature_constants(scenario.temperature)
    constants["flicker"] = flicker_constants(truth.bias_flicker_rad_s_at_1Hz, scenario.true_rate_Hz)
    return constants
