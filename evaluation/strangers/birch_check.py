"""The motion of birch.c beside SciPy's DOP853, a matrix exponential and a record of twice the rate."""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from evaluation.strangers.birch_device import STATES, Array, draw_device, library, simulate, vector
from evaluation.strangers.birch_laws import CATALOGUE, OUTSIDE, Scales


def check() -> dict[str, float]:
    """Largest difference from SciPy's DOP853 over a sample interval, over the amplitude, for each law.

    Also holds the linear part against a matrix, and a late drive against a record of twice the rate.

    Raises:
        ArithmeticError: where a difference is above 1e-9.
    """
    seen: dict[str, float] = {}
    for i, (name, law) in enumerate((CATALOGUE | OUTSIDE).items()):
        rng = np.random.default_rng([7, i])
        device = draw_device(rng, excited=True)
        w, amplitude, ts = math.sqrt(device.values["kxx"]), device.values["amp"], device.values["ts"]
        push = np.linspace(0, w**2 * amplitude * 0.01, 50)
        scales = Scales(w, amplitude, ts, 4.0, 1.2 * amplitude, 0.5 * float(push[-1]), push)
        values = device.values | (law.parameters(rng, scales) if law.parameters else {})
        values |= {symbol: law.cap * law.unit(scales) * share for symbol, share in law.shape(rng).items()}
        late = {"tux": 0.0, "tuy": 0.0, "tsx": 0.0, "tsy": 0.0}
        p, n = vector(values | late | {"warm_ramp": 1.0}), 6
        motion = simulate(p, n, device.start, 0.0, drive=rng.choice(push, (n, 2)))
        size = np.array([amplitude, amplitude * w])

        def law_of(t: float, s: Array, u: Array, p: Array = p) -> Array:
            d, state = np.zeros(STATES), np.ascontiguousarray(s)
            library().birch_law(p.ctypes.data, t, u[0], u[1], state.ctypes.data, d.ctypes.data)
            return d

        worst = 0.0
        for m in range(1, n):
            span, before = ((m - 1) * ts, m * ts), motion.states[m - 1]
            tight = {"rtol": 1e-12, "atol": 1e-14 * amplitude, "max_step": ts / 8}
            end = solve_ivp(law_of, span, before, method="DOP853", args=(motion.drive[m],), **tight).y[:4, -1]
            worst = max(worst, float(np.abs((end - motion.states[m, :4]) / np.tile(size, 2)).max()))
        seen[name] = worst
    seen["linear part"] = _check_linear()
    seen["late drive"] = _check_late()
    for name, worst in seen.items():
        if not worst < 1e-9:
            raise ArithmeticError(f"{name}: {worst:.1e} of the amplitude in a sample interval")
    return seen


def _check_linear() -> float:
    """Against the matrix exponential of (2) at a constant rate, drive included, over ten intervals."""
    v, start = (
        {"kxx": 1e6, "kyy": 1.02e6, "kxy": 4e3, "dxx": 2.0, "dyy": 3.0, "dxy": 0.5, "rate": 2.0},
        np.zeros(STATES),
    )
    start[:4] = 1e-4, 0.03, -5e-5, 0.05
    drive = np.tile([3.0, -2.0], (11, 1))
    p = vector(v | {"amp": 1e-4, "ts": 4e-4, "gain_x": 1.0, "gain_y": 1.0})
    end = simulate(p, 11, start, 0.0, drive=drive).states[-1, :4]
    rate = v["rate"]
    flow = np.zeros((5, 5))
    flow[0, 1] = flow[2, 3] = 1.0
    flow[1, :] = [rate**2 - v["kxx"], -v["dxx"], -v["kxy"], 2 * rate - v["dxy"], 3.0]
    flow[3, :] = [-v["kxy"], -2 * rate - v["dxy"], rate**2 - v["kyy"], -v["dyy"], -2.0]
    exact = expm(10 * 4e-4 * flow) @ np.append(start[:4], 1.0)
    return float(np.abs((end - exact[:4]) / [1e-4, 0.1, 1e-4, 0.1]).max())


def _check_late() -> float:
    """A drive late by half an interval is that of twice the rate, moved by one sample; so is a reading of the same."""
    device = draw_device(np.random.default_rng(3), excited=True)
    ts, amplitude = device.values["ts"], device.values["amp"]
    u = np.random.default_rng(4).normal(0, 0.01 * device.values["kxx"] * amplitude, (20, 2))
    u[0] = 0.0  # nothing acts before the first row
    halves = {"tux": ts / 2, "tuy": ts / 2, "tsx": ts / 2, "tsy": ts / 2}
    slow = simulate(vector(device.values | halves), 20, device.start, 0.0, drive=u)
    twice = np.repeat(u, 2, axis=0)  # rows 2m and 2m + 1: the halves of the interval behind row m
    fast = simulate(vector(device.values | {"ts": ts / 2}), 40, device.start, 0.0, drive=twice)
    volts = fast.volts[1:-1:2]  # halfway before the rows 1, 2, …
    return float(np.abs(slow.volts[1:] - volts).max()) / (amplitude * abs(device.values["gain_x"]))
