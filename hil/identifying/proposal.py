"""Settings proposed for a device that was identified: what its drive, its noise and its frequency allow."""

from typing import Any

import numpy as np

from hil.identifying.findings import Findings
from hil.wire.messages import Capabilities

# In cycles of the vibration, as all of this scales with it.
MEMORY, SETTLE, LENGTH, TURN = 400.0, 2000.0, 5500.0, 3000.0
_SWING = 0.45  # of the limit of the sense voltages
_HOLDING = 0.5  # of the drive, to make the springs alike and replace what damping takes
_TURNING = 0.1  # of it, for the virtual rotation
_DITHER = 0.04  # of it, rms
_GAIN = 0.02
_LEAST_STIFFNESS, _LEAST_DAMPING = 1e-5, 0.02
_WIDER = 3.0  # than the uncertainty: what a temperature moves meanwhile


def settings_of(found: Findings, amplitude_m: float | None) -> dict[str, dict[str, Any]]:
    """By section of the bench file and key; SI per unit mass."""
    omega, drive = found.omega, found.largest_mps2
    hertz, rate = omega / (2.0 * np.pi), found.identity.tick_rate_Hz
    amplitude = amplitude_of(found) if amplitude_m is None else amplitude_m
    rotation = min(2.0 * np.pi * hertz / TURN, _TURNING * drive / (2.0 * omega * amplitude))
    k, d = omega**2, 0.5 * (found.value("dxx") + found.value("dyy"))
    stiffness = max(_WIDER * max(found.u(name) for name in ("kxx", "kyy", "kxy")) / k, _LEAST_STIFFNESS)
    damping = max(_WIDER * max(found.u(name) for name in ("dxx", "dyy", "dxy")) / d, _LEAST_DAMPING)
    force = max(found.force_mps2_per_rtHz, 1e-12 * k * amplitude / np.sqrt(hertz))
    in_blocks = Capabilities.LOCKSTEP not in Capabilities(found.identity.capabilities)
    every = max(round(rate / hertz), 1)
    return {
        "device": {"amplitude_m": amplitude},
        "loop": {
            "mode": "gain"
            if in_blocks and Capabilities.GAIN_MODE in Capabilities(found.identity.capabilities)
            else "force",
            "clock": "real" if in_blocks else "lockstep",
            "duration_s": LENGTH / hertz,
            "settle_s": SETTLE / hertz,
            "estimate_every": every,
        },
        "observer": {"memory_s": MEMORY / hertz, "acquisition_s": 20.0 / hertz},
        "observer.initial_sd": {"stiffness": stiffness, "damping": damping, "rate_rad_s": 2.0},
        "observer.process_noise": {
            "force_mps2_per_rtHz": float(force),
            "rate_rad_s_per_rts": float(0.05 * np.sqrt(hertz / 200.0)),
        },
        "controller": {
            "energy_gain": _GAIN,
            "quadrature_gain": _GAIN,
            "virtual_rotation_rad_s": float(rotation),
            "dither_mps2": _DITHER * drive,
            "force_limit_mps2": drive,
        },
    }


def amplitude_of(found: Findings) -> float:
    """Where neither the sense voltages nor the drive that holds it come near their ends."""
    swing = min(
        (_SWING * limit - abs(found.value(f"offset_{axis}"))) / abs(found.value(f"gain_{axis}"))
        for axis, limit in zip("xy", found.limit_V, strict=True)
    )
    k = found.omega**2
    uneven = max(abs(found.value("kxx") - k), abs(found.value("kyy") - k)) + abs(found.value("kxy"))
    damped = found.omega * max(found.value("dxx"), found.value("dyy"), 0.0)
    return float(min(swing, _HOLDING * found.largest_mps2 / max(uneven + damped, 1e-300)))
