"""The loops of [controller] mode on drawn devices: `python -m evaluation.loops margins|start|reversal`.

margins: gain and phase margin of each closed loop at its design frequency, by the probe, over the design.
start: from rest to locked, the frequency unknown to ± 1 %, split up to what half of the drive's full scale holds.
reversal: bias over 60 K of stiffness, damping and gains, with the axes exchanged and without.
"""

import argparse
import math
from typing import Any

import numpy as np

from benchmarks.lockstep import ClosedLoop, bench_of, close_loop, scenario_of
from device_emulator.scenario import Scenario
from hil.errors import InputError
from hil.plugins.parts import Named
from hil.plugins.plugged import Plugged
from hil.plugins.protocol import PluginError

LOOPS = ("amplitude", "phase", "rate", "quadrature", "pattern")
DESIGNS = ((0.5, 60.0), (1.0, 70.0), (2.0, 60.0), (4.0, 50.0), (4.0, 40.0))
"""Bandwidth [Hz] and phase margin [°] of S-slow's loops."""
PLANTS = (("s-slow", None, 4.0), ("s-modern", None, 0.3), ("s-modern-5k", 1e5, 0.4))
"""Devices, another Q than theirs, and how long each may take [s]."""
RATE_RAD_S = 0.5
BIAS_K, BIAS_S, BIAS_SETTLED_S = 94.9, 100.0, 40.0


def closed(scenario: Scenario, mode: str, seconds: float, seed: int, **more: Any) -> ClosedLoop:
    """A run from rest; bench and scenario say the same of all but what `more` changes."""
    name, given = more.pop("name"), more.pop("device")
    controller = {"mode": mode, "virtual_rotation_rad_s": 0.0, "virtual_reversal_s": 0.0, "dither_mps2": 0.0, **more}
    loop = {"mode": "force", "settle_s": 0.5 * seconds}
    declared = bench_of(name, device=given, controller=controller, loop=loop, limits={"residual_safe": 1e6})
    rate_Hz = scenario.board.sample_rate_Hz
    return close_loop(scenario, declared, round(seconds * rate_Hz), seed=seed, every=10)


def figures(found: ClosedLoop) -> list[Named]:
    """What the loops tell of themselves."""
    assert isinstance(found.observer, Plugged)
    return found.observer.figures


def board(name: str, truth: dict[str, Any], rate_rad_s: float, effects: Any = (), **heat: float) -> Scenario:
    """An example's, from rest, at a constant rate, warmed up as `heat` says."""
    rate = {"kind": "constant", "rate_rad_s": rate_rad_s}
    plain = scenario_of(name, truth=truth | {"position_m": (0.0, 0.0)}, rate=rate, temperature=heat)
    return Scenario.model_validate(plain.model_dump() | {"effect": list(effects)})


def margins(seed: int, count: int) -> None:
    """Of S-slow, round."""
    del count
    device = {"stiffness_N_per_m": (1579.1367, 1579.1367, 0.0), "damping_N_s_per_m": (1.25664e-3, 1.25664e-3, 0.0)}
    worst = []
    for loop in LOOPS:
        for bandwidth, margin in DESIGNS:
            mode = "classic_whole_angle" if loop == "pattern" else "force_to_rebalance"
            probe = "rate" if loop == "pattern" else loop
            loops: dict[str, Any] = {f"{one}_Hz": bandwidth for one in LOOPS[:4]}
            loops |= {"probe": probe, "probe_Hz": bandwidth, "phase_margin_deg": margin}
            scenario = board("s-slow", dict(device), 0.0)
            found = closed(scenario, mode, 8.0 + 12.0 / bandwidth, seed, name="s-slow", device=device, loops=loops)
            told = {one.name: one.value for one in figures(found)}
            off = told["loop_gain"] - 1.0, told["phase_margin"] / margin - 1.0
            worst.append(max(map(abs, off)))
            print(
                f"{loop} {bandwidth:g} Hz, {margin:g}°: gain {off[0]:+.1%}, phase margin {off[1]:+.1%} off", flush=True
            )
    print(f"largest {max(worst):.1%} of {len(worst)}")


def start(seed: int, count: int) -> None:
    """Of three devices, `count` draws each."""
    for name, q, seconds in PLANTS:
        plant = name if q is None else f"{name} at Q = {q:,.0f}"
        rng = np.random.default_rng([seed, len(name)])
        plain, sheet = scenario_of(name), bench_of(name)
        mass, amplitude = plain.truth.mass_kg, sheet.device.amplitude_m
        nominal = 0.5 * sum(plain.truth.stiffness_N_per_m[:2])
        damping = plain.truth.damping_N_s_per_m
        if q is not None:
            damping = (math.sqrt(nominal * mass) / q, math.sqrt(nominal * mass) / q, 0.0)
        device = {"stiffness_N_per_m": (nominal, nominal, 0.0), "damping_N_s_per_m": damping}
        took, locked = [], 0
        for number in range(count):
            mean = nominal * (1.0 + rng.uniform(-0.01, 0.01)) ** 2
            half = 0.5 * mass * plain.drive.full_scale_mps2 / amplitude * rng.uniform(-1.0, 1.0)
            twice = rng.uniform(0.0, math.tau)
            stiffness = (mean + half * math.cos(twice), mean - half * math.cos(twice), half * math.sin(twice))
            truth = {"stiffness_N_per_m": stiffness, "damping_N_s_per_m": damping}
            scenario = board(name, truth, RATE_RAD_S)
            try:
                found = closed(scenario, "force_to_rebalance", seconds, number, name=name, device=device)
            except (InputError, PluginError) as error:
                print(f"{plant}, draw {number}: {error}", flush=True)
                continue
            told = {one.name: one for one in figures(found)}
            phases = [told[phase].value for phase in ("search", "ring_up", "lock", "null")]
            last = found.estimates["energy_ratio"][-100:], found.estimates["quadrature_ratio"][-100:]
            held = abs(float(np.mean(last[0])) - 1.0) < 0.01 and float(np.max(np.abs(last[1]))) < 0.05
            resonance = math.sqrt(stiffness[0] / mass) / math.tau
            right = abs(told["frequency_scored_mean"].value / resonance - 1.0) < 0.01
            if min(phases) > 0.0 and held and right:
                locked += 1
                took.append(phases)
            else:
                print(f"{plant}, draw {number}: phases {phases}, held {held}, resonance right {right}", flush=True)
        if took:
            each = " + ".join(f"{phase * 1e3:.3g}" for phase in np.median(took, axis=0))
            whole = np.sum(took, axis=1)
            print(
                f"{plant}: {locked} of {count}; median {1e3 * np.median(whole):.3g} ms (search, ring-up, lock, null: "
                f"{each}), longest {1e3 * whole.max():.3g} ms",
                flush=True,
            )


def reversal(seed: int, count: int) -> None:
    """Of S-slow: stiffness -60 ppm/K, damping 0.4 %/K from 25 °C to 85 °C; drive and sense gains off by 2 and 3 %."""
    del count
    device = {
        "stiffness_N_per_m": (1610.7194, 1547.554, 15.7914),
        "damping_N_s_per_m": (1.3823e-3, 1.13097e-3, 6.2832e-5),
    }
    effects: list[dict[str, Any]] = [
        {"name": "temperature_stiffness", "tc": -6e-5},
        {"name": "temperature_damping", "tc": 4e-3},
        {"name": "drive_gain", "hx": 0.02, "hy": -0.03},
        {"name": "sense_gain", "gx": 0.0, "gy": 0.02},
    ]
    bias = []
    for mode in ("force_to_rebalance", "mode_reversal"):
        scenario = board("s-slow", dict(device), 0.0, effects, warm_up_K=BIAS_K, time_constant_s=BIAS_S)
        found = closed(scenario, mode, BIAS_S, seed, name="s-slow", device=device, loops={"exchange_s": 6.0})
        rate = found.estimates["rate_rad_s"][found.tick > BIAS_SETTLED_S * scenario.board.sample_rate_Hz]
        tenths = rate[: len(rate) // 10 * 10].reshape(10, -1).mean(axis=1)
        bias.append(float(np.sqrt(np.mean(tenths**2))))
        print(f"{mode}: {bias[-1] * 1e3:.3g} mrad/s rms of tenths", flush=True)
    print(f"factor {bias[0] / bias[1]:.3g}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.loops", description=__doc__)
    parser.add_argument("what", choices=["margins", "start", "reversal"])
    parser.add_argument("--draw", type=int, default=41)
    parser.add_argument("--count", type=int, default=50)
    given = parser.parse_args()
    {"margins": margins, "start": start, "reversal": reversal}[given.what](given.draw, given.count)


if __name__ == "__main__":
    main()
