"""Records of a gyro whose one chip measures, converts and closes the loop: 40 devices, most with an undeclared effect.

    python -m evaluation.strangers.alder --seed S --out DIR [--only NN]
    python -m evaluation.strangers.alder --check

writes DIR/NN.csv (interchange), DIR/NN.bench.toml (the data sheet) and DIR/truth.json. Physics: equation (2) with
centrifugal and Euler force (docs/explanation.md), and the effects of `alder_effects`. The chip filters each channel
at the target frequency. Once a block it sets a matrix from factory trims, energy, quadrature and virtual rotation, as
Lynch does (Coriolis gyros, IEEE Std 1431 annex B). An effect's size follows from a fit: equation (2) with constants of
its own is fitted to two windows of the record without noise, by least squares, and what is left is held against the
noise.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from evaluation.strangers.alder_check import check
from evaluation.strangers.alder_device import FORCE_NOISE, Array, Chosen, Device, between, draw_device, simulate
from evaluation.strangers.alder_effects import (
    CATALOGUE,
    COEFFICIENTS,
    EFFECTS,
    OUTSIDE,
    SINGLE_TONE,
    Effect,
    coefficients,
)

TWINS = (  # what no record tells apart where both axes have it (docs/explanation.md): never two of one record
    *({"drive_gain", "sense_gain"}, {"drive_delay", "sense_delay"}, {"drive_misalignment", "sense_cross_coupling"}),
    *({"drive_delay", "sense_low_pass"}, {"base_vibration", "interference"}),
)
SAMPLES_SIZED, WINDOW = 26_000, 9_000


def residual(device: Device, chosen: Chosen) -> float:
    """What equation (2), fitted, leaves of a record with `chosen`, with noise, over the noise.

    Two windows. Fitted in each: start, K, D, offsets, a constant and a slope of the rate beside the true one, by
    Gauss and Newton's method with a Jacobian from differences.
    """
    record = simulate(device, chosen, SAMPLES_SIZED)
    if not np.isfinite(record).all() or np.abs(record[:, [4, 6]]).max() > 1.5 * device.peak:
        return math.inf
    A, w, k = device.A, device.w0, device.k
    scale = np.array([A, A * w, A, A * w, k, k, k, w, w, w, w, w]) * 1e-4
    ramp = np.linspace(0, 1, len(device.rate)) * len(device.rate) / WINDOW
    clean = np.empty(0)
    for first in (6000, SAMPLES_SIZED - WINDOW):
        rows = slice(first, first + WINDOW)

        def free(p: Array, first: int = first, rows: slice = rows) -> Array:
            moved = p * scale
            rate = device.rate + moved[10] + moved[11] * (ramp - ramp[first])
            start = record[first - 1, 4:8] + moved[:4]
            base = device.base + moved[4:10]
            told = {"base": base, "first": first, "state": start, "drive": record[rows, 2:4], "rate": rate}
            return simulate(device, {}, WINDOW, **told, noisy=False, coarse=1e4)[:, 8:]

        p, seen, before, least = np.zeros(12), record[rows, 8:], math.inf, np.empty(0)
        for iteration in range(7):
            here = free(p)
            left = seen - here
            left -= left.mean(axis=0)
            if not np.isfinite(left).all():
                return math.inf
            spread, before = before, float(np.std(left))
            least = left if before < spread else least
            if before > 0.8 * spread:
                break
            if iteration % 3 == 0:
                J = np.stack([(free(p + 0.1 * row) - here) / 0.1 for row in np.eye(12)], axis=-1)
                J = (J - J.mean(axis=0)).reshape(-1, 12)
                if not np.isfinite(J).all():
                    return math.inf
            p = p + np.linalg.solve(J.T @ J, J.T @ left.ravel())
        clean = np.append(clean, least * device.config["Gx"])
    return float(np.sqrt(1 + np.mean(clean**2) / device.noise_all**2))


def sized(effect: Effect, device: Device, target: float) -> tuple[dict[str, float], float]:
    """Coefficients with which the residual is about `target` times the noise, and what it is; as near as can be."""
    parts = (device.rng.uniform(0.4, 1, COEFFICIENTS) * device.rng.choice([-1, 1], COEFFICIENTS)).tolist()
    size, below, above = 0.1, 0.0, math.inf
    best = (coefficients(effect, device, size, parts), math.inf)
    for _ in range(7):
        values = coefficients(effect, device, size, parts)
        ratio = residual(device, {effect.key: values})
        if abs(math.log(ratio / target)) < abs(math.log(best[1] / target)):
            best = (values, ratio)
        if abs(math.log(ratio / target)) < 0.4 or (size == 1 and ratio < target):
            break
        below, above = (size, above) if ratio < target else (below, size)
        wanted = size * min(30.0, max(0.03, math.sqrt((target**2 - 1) / max(ratio**2 - 1, 1e-6))))
        if not below < wanted < above:
            wanted = math.sqrt(max(below, above / 30) * min(above, 30 * size))
        size = min(1.0, max(wanted, 1e-4))
    return best


def plan(seed: int) -> list[tuple[str, list[Effect]]]:
    """Kind and effects of each of the 40 records, in the order of their numbers."""
    rng = np.random.default_rng([seed, 0])

    def some(pool: Iterable[Effect], n: int) -> list[Effect]:
        listed = list(pool)
        return [listed[i] for i in rng.permutation(len(listed))[:n]]

    force = [e for e in CATALOGUE if e.group == "mechanics"]
    drives, senses = ([e for e in CATALOGUE if e.group == group] for group in ("drive", "sense"))
    ones = some(force, 6) + some(drives, 5) + some(senses, 3)
    tones = [EFFECTS[key] for key in SINGLE_TONE]
    pairs: list[tuple[Effect, Effect]] = []
    while not pairs or any({a.key, b.key} in TWINS for a, b in pairs):
        springs, forcers, seconds = some(force, 8), some(drives, 6), some(senses, 6)
        pairs = list(zip(springs + forcers[4:], forcers[:4] + seconds, strict=True))
    records: list[tuple[str, list[Effect]]] = [("clean" if i < 3 else "clean single-tone", []) for i in range(5)]
    records += [("one", [e]) for e in ones] + [("single-tone", [e]) for e in some(tones, 5)]
    records += [("two", list(pair)) for pair in pairs] + [("outside", [e]) for e in some(OUTSIDE, 6)]
    return [records[i] for i in rng.permutation(len(records))]


def drawn(seed: int, number: int, kind: str, effects: list[Effect]) -> tuple[Device, Chosen, dict[str, float]]:
    """Device, effects and residuals of a record: devices are drawn until what they hide shows, and not too much."""
    tone, slow = "single-tone" in kind, any(e.slow for e in effects)
    drive = any(e.group == "drive" for e in effects)
    for attempt in range(12):
        rng = np.random.default_rng([seed, number, attempt])
        device, chosen, ratios = draw_device(rng, tone, slow, drive), {}, {}
        for effect in effects:
            chosen[effect.key], ratios[effect.key] = sized(
                effect, device, between(rng, 1.5, 10 if kind == "two" else 16)
            )
        together = residual(device, chosen) if len(effects) > 1 else 2.0
        if all(1.25 < ratio < 24 for ratio in ratios.values()) and 1.5 < together < 28:
            break
    else:
        raise RuntimeError(
            f"record {number:02d}: no device of twelve shows what it hides between 1.25 and 24 times its noise"
        )
    return device, chosen, ratios


def bench_text(device: Device, number: int) -> str:
    """The data sheet as a bench file: typical constants with their tolerances, chain, limits."""
    rng, g, k = device.rng, device.config, device.k
    spread = between(rng, 1.5e-3, 1.5e-2)
    stiffness = (device.base[:3] + rng.normal(size=3) * 0.7 * spread * k * np.array([1, 1, 0.5])) * device.mass
    damping = device.base[3:].mean() * between(rng, 0.65, 1.5) * device.mass * np.array([1, 1, 0])
    memory = min(between(rng, 300, 800) / device.f, 0.25 * device.samples * device.Ts)
    brownian = math.sqrt(FORCE_NOISE * device.base[3:5].mean() / device.mass)
    gains = [g["Gx"]] if g["Gx"] == g["Gy"] else [g["Gx"], g["Gy"]]

    def row(values: Iterable[float]) -> str:
        return "[" + ", ".join(f"{v:.5g}" if v else "0.0" for v in values) + "]"

    return f"""# Data sheet of {device.f / 1000:.2f} kHz, one chip, gain mode
[device]
name = "alder-{number:02d}"
mass_kg = {device.mass!r}
stiffness_N_per_m = {row(stiffness)}
damping_N_s_per_m = {row(damping)}
amplitude_m = {device.A!r}
sample_rate_Hz = {1 / g["Ts"]:.6f}

[device.sense]
gain_V_per_m = {gains[0] if len(gains) == 1 else gains}
noise_V = {device.noise_all * rng.uniform(0.97, 1.03):.4g}
offset_sd_V = {0.2 * abs(g["Gx"]) * device.A:.3g}

[device.drive]
unit = "mps2"
full_scale = {g["full_scale"]!r}

[loop]
name = "alder-{number:02d}"
duration_s = {device.samples * device.Ts:.6f}
settle_s = {0.1 * device.samples * device.Ts:.6f}

[observer]
memory_s = {memory:.4g}

[observer.initial_sd]
rate_rad_s = {max(3.0, 1.5 * float(np.abs(device.rate).max())):.3g}
stiffness = {spread:.3g}
damping = 1.0

[observer.process_noise]
force_mps2_per_rtHz = {1.1 * brownian:.3g}
rate_rad_s_per_rts = {1.2 * device.steps:.3g}

[controller]
enabled = false
"""


def written(device: Device, chosen: Chosen, number: int, folder: Path) -> None:
    """Writes the record and the bench file of a device."""
    rows = simulate(device, chosen, device.samples)
    if not np.isfinite(rows).all():
        raise RuntimeError(f"record {number:02d} left all bounds: {sorted(chosen)}")
    columns = {"t_s": np.arange(1, device.samples + 1) * device.Ts}
    columns |= {name: rows[:, i] for i, name in enumerate(("vx_V", "vy_V", "ux_mps2", "uy_mps2"))}
    if device.warm.any():
        columns["temp_C"] = np.round(device.warm[1:] + 24.5, 4)
    (folder / f"{number:02d}.bench.toml").write_text(bench_text(device, number))
    with (folder / f"{number:02d}.csv").open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        pa.csv.write_csv(pa.table(columns), file, pa.csv.WriteOptions(include_header=False))


def make(seed: int, folder: Path, only: int | None = None) -> None:
    """Writes records, bench files and truth.json of a seed; with `only`, those of one number."""
    folder.mkdir(parents=True, exist_ok=True)
    truth_file = folder / "truth.json"
    truth: dict[str, Any] = json.loads(truth_file.read_text()) if only is not None and truth_file.exists() else {}
    for number, (kind, effects) in enumerate(plan(seed), start=1):
        if only in (None, number):
            device, chosen, ratios = drawn(seed, number, kind, effects)
            written(device, chosen, number, folder)
            truth[f"{number:02d}"] = {
                "kind": kind.split()[0],
                "effects": [
                    {
                        "name": effect.key if effect.catalogue else None,
                        "description": f"{effect.words}; residual without it {ratios[effect.key]:.2f} x noise",
                        "coefficients": page_symbols(chosen[effect.key]),
                    }
                    for effect in effects
                ],
            }
    truth_file.write_text(json.dumps(dict(sorted(truth.items())), indent=1) + "\n")


def page_symbols(values: dict[str, float]) -> dict[str, float]:
    """Coefficients by the symbols of docs/reference/effects.md, where leak and hp are one number."""
    return values | {symbol.replace("leak_", "hp"): v for symbol, v in values.items() if symbol.startswith("leak_")}


def main(arguments: list[str] | None = None) -> int:
    """Command line; exit code 1 where the self-check fails."""
    parser = argparse.ArgumentParser(description="records of emulated gyros with effects nobody declared")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of the records")
    parser.add_argument("--only", type=int, help="number of the one record to write, 1 to 40")
    parser.add_argument("--check", action="store_true", help="hold the integrator against SciPy's")
    told = parser.parse_args(arguments)
    if told.check:
        faults = check()
        print(
            "\n".join(faults) or "the integrator agrees with DOP853 and with exp(F t) to 1e-9 of the amplitude a sample"
        )
        return int(bool(faults))
    if told.out is None or (told.only is not None and not 1 <= told.only <= 40):
        parser.error("--out DIR is needed, and --only is 1 to 40")
    make(told.seed, told.out, told.only)
    return 0


if __name__ == "__main__":
    sys.exit(main())
