"""The integrator of alder.c beside SciPy's DOP853 and the matrix exponential."""

from __future__ import annotations

import ctypes
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import expm

from evaluation.strangers.alder_device import (
    STATES,
    Array,
    Chosen,
    Device,
    draw_device,
    kernel,
    placed,
    pointers,
    simulate,
)
from evaluation.strangers.alder_effects import EFFECTS, coefficients


def check() -> list[str]:
    """What is wrong with the integrator: each effect against DOP853, the linear part against the matrix exponential."""
    faults = []
    device = draw_device(np.random.default_rng([3, 1]), False, True, True)
    device = replace(device, noise=0.0, rng=np.random.default_rng(5))
    for effect in (None, *EFFECTS.values()):
        parts = [0.9, -0.6, 0.7, -0.8, 0.5, 0.6]
        chosen = {} if effect is None else {effect.key: coefficients(effect, device, 0.5, parts)}
        error = against_dop853(device, chosen)
        if not error < 1e-9:
            faults.append(f"{effect.key if effect else 'base model'}: {error:.1e} of the amplitude from DOP853")
    still = replace(device, rate=0 * device.rate, warm=0 * device.warm)
    n, u = 40, np.array([0.02, -0.01]) * device.k * device.A
    rows = simulate(still, {}, n, drive=np.tile(u, (n, 1)), noisy=False)
    kxx, kyy, kxy, dxx, dyy, dxy = still.base
    F = np.zeros((6, 6))
    F[0, 1] = F[2, 3] = 1
    F[1], F[3] = [-kxx, -dxx, -kxy, -dxy, 1, 0], [-kxy, -dxy, -kyy, -dyy, 0, 1]
    a = math.radians(still.start_deg)
    end = expm(F * still.Ts * n) @ np.array([still.A * math.cos(a), 0, still.A * math.sin(a), 0, *u])
    error = float(np.abs(rows[-1, [4, 6]] - end[[0, 2]]).max() / still.A)
    return faults + ([f"linear part: {error:.1e} of the amplitude from exp(F t)"] if not error < 1e-9 else [])


def against_dop853(device: Device, chosen: Chosen) -> float:
    """Largest difference from DOP853 per sample interval, over amplitude, in 12 intervals without noise."""
    on, numbers, config, tolerance, states = placed(device, chosen)
    held, worst, slope = np.zeros(8), 0.0, np.zeros(STATES)
    quiet = replace(device, config=device.config | {"armed": 0.0})
    drive = np.random.default_rng(8).normal(size=(12, 2)) * 0.02 * device.k * device.A
    rows = simulate(quiet, chosen, 12, drive=drive, noisy=False)
    truth = np.zeros(states)
    a = math.radians(device.start_deg)
    truth[[0, 2]] = device.A * math.cos(a), device.A * math.sin(a)
    truth[4:6] = truth[[0, 2]][: len(truth[4:6])]
    delays = (chosen.get("drive_delay", {}).get("tux", 0.0), chosen.get("drive_delay", {}).get("tuy", 0.0))
    limit, last = chosen.get("slew", {}).get("slew", 0.0) * device.Ts, np.zeros(2)

    def f(t: float, s: Array) -> Array:
        state = np.ascontiguousarray(s)
        kernel().slope(
            *pointers((config, base, on, numbers)),
            *(states, ctypes.c_double(t0), *pointers([held]), ctypes.c_double(t), *pointers((state, slope))),
        )
        return slope[:states].copy()

    base = device.base
    for m, row in enumerate(rows):
        t0 = m * device.Ts
        turn = (device.rate[m + 1] - device.rate[m]) / device.Ts
        warming = (device.warm[m + 1] - device.warm[m]) / device.Ts
        held[:4], held[6:] = (device.rate[m], turn, device.warm[m], warming), last
        before = drive[m - 1] if m else np.zeros(2)
        cuts = sorted({0.0, *delays, device.Ts})
        for begin, end in pairwise(cuts):
            held[4:6] = [drive[m, i] if delays[i] <= begin else before[i] for i in range(2)]
            solver = DOP853(f, t0 + begin, truth, t0 + end, rtol=1e-13, atol=tolerance[:states] * 1e-3)
            while solver.status == "running":
                solver.step()
            truth = solver.y
        last = last + np.clip(drive[m] - last, -limit, limit)
        worst = max(worst, float(np.abs(truth[[0, 2]] - row[[4, 6]]).max()) / device.A / (m + 1))
    return worst
