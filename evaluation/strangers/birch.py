"""Records of bench-top gyros of 100 Hz to 1 kHz with a hidden effect, written from the equations alone.

A laboratory drives a plate in the plane from a PC: converters of 12 to 16 bits, a drive that comes 0 to 3 samples late,
a turntable below. An energy controller leaves the rest of the motion to itself, or holds the quadrature small. Motion
and laws stand in birch_device.py and birch_laws.py; no code is shared with estimator or device emulator.

    python -m evaluation.strangers.birch --seed 1 --out DIR [--only 07]
    python -m evaluation.strangers.birch --check
"""

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv

from evaluation.strangers.birch_check import check
from evaluation.strangers.birch_device import BURN_IN, Device, draw_device, draw_warmth
from evaluation.strangers.birch_laws import CATALOGUE, OUTSIDE, PAGE_NAMES, SINGLE_TONE, Law, Scales


def add_effect(device: Device, name: str, law: Law, rng: np.random.Generator, largest: float) -> bool:
    """Draw the effect at a size that the residual shows, from 1.3 to `largest` of the noise; False where none does."""
    present: dict[str, float] = {}
    for effect in device.effects:
        present |= effect["values"]
    before = device.run(present)
    drive, peak = before.drive[BURN_IN:], float(np.abs(before.volts / device.values["gain_x"]).max())
    scales = Scales(
        w=2 * math.pi * device.frequency_Hz,
        amplitude=device.values["amp"],
        ts=device.values["ts"],
        duration=device.samples * device.values["ts"],
        peak=peak,
        drive_rms=float(np.sqrt(np.mean(drive**2))),
        drive=np.sort(np.abs(drive).ravel()),
    )
    shape = law.shape(rng)
    parameters = law.parameters(rng, scales) if law.parameters else {}
    if name.startswith("temperature") and "warm_ramp" not in device.values:
        device.values |= draw_warmth(rng, scales.duration)
    wanted, size = 10 ** rng.uniform(math.log10(1.35), math.log10(largest)), 0.1 * law.cap
    for _ in range(6):
        size = float(f"{size:.4g}")  # the same on machines whose linear algebra rounds otherwise
        values = {symbol: size * law.unit(scales) * share for symbol, share in shape.items()} | parameters
        ratio = device.residual_ratio(values)
        if 0.85 * wanted < ratio < 1.15 * wanted or (size == law.cap and ratio < wanted):
            break
        seen = math.sqrt(max(min(ratio, 1e6) ** 2 - 1, 1e-4))
        size = min(law.cap, size * min(max(math.sqrt(wanted**2 - 1) / seen, 0.02), 50.0))
    if not 1.2 < ratio < 28.0 or (present and not 1.2 < device.residual_ratio(present | values) < 28.0):
        return False  # two effects that cancel each other are no test of either
    symbols = law.symbols if name in CATALOGUE else tuple(values)
    told = {symbol: values[symbol] for symbol in symbols}
    page = {PAGE_NAMES.get(k, k): value for k, value in parameters.items()} if name in CATALOGUE else {}
    device.effects.append(
        {
            "name": name if name in CATALOGUE else None,
            "description": law.description,
            "coefficients": told,
            "parameters": page,
            "residual_ratio": round(ratio, 3),
            "values": values,
        }
    )
    return True


def plan(seed: int) -> list[tuple[str, list[str]]]:
    """Kind and effects to try, in their order, of the records 01 to 40."""
    rng = np.random.default_rng([seed, 1])
    names = np.array(list(CATALOGUE))
    weights = np.array([CATALOGUE[name].weight for name in names])
    drawn = [str(name) for name in rng.choice(names, len(names), replace=False, p=weights / weights.sum())]
    steady, strange = ([str(s) for s in rng.permutation(list(of))] for of in (SINGLE_TONE, OUTSIDE))
    records: list[tuple[str, list[str]]] = [("clean", []), ("clean", []), ("clean", []), ("clean single-tone", [])]
    records.append(("clean single-tone", []))
    records += [("one", [drawn[i], *drawn[14:]]) for i in range(14)]
    records += [("single-tone", [steady[i], *steady[5:]]) for i in range(5)]
    records += [("outside", [strange[i], *strange[6:]]) for i in range(6)]
    for _ in range(10):
        pair = [str(s) for s in rng.choice(names, len(names), replace=False, p=weights / weights.sum())]
        records.append(("two", [name for name in pair if not CATALOGUE[name].on_request]))
    return [records[i] for i in rng.permutation(len(records))]


def make_device(seed: int, number: int) -> tuple[str, Device]:
    """Kind and device, with its effects, of a record."""
    kind, names = plan(seed)[number - 1]
    rng = np.random.default_rng([seed, 2, number])
    excited = kind not in ("single-tone", "clean single-tone")
    wanted = {"one": 1, "single-tone": 1, "outside": 1, "two": 2}.get(kind, 0)
    device = draw_device(rng, excited=excited)
    for name in names:
        families = [effect["family"] for effect in device.effects]
        law = (CATALOGUE | OUTSIDE)[name]
        if len(device.effects) == wanted:
            break
        if law.family not in families and add_effect(device, name, law, rng, 12.0 if kind == "two" else 20.0):
            device.effects[-1]["family"] = law.family
    if len(device.effects) < wanted:
        raise RuntimeError(f"record {number:02d} of seed {seed}: no effect of its list can be seen")
    return kind.removesuffix(" single-tone"), device


def write_record(seed: int, number: int, out: Path) -> dict[str, Any]:
    """Write NN.csv and NN.bench.toml into `out`; the truth of the record."""
    kind, device = make_device(seed, number)
    added = {symbol: value for effect in device.effects for symbol, value in effect["values"].items()}
    peak = float(np.abs(device.run(added).volts).max()) + 4 * device.noise_V
    device.values["adc"] = float(f"{2 * 1.15 * peak:.2g}") / 2**device.bits
    rng = np.random.default_rng([seed, 3, number])
    motion = device.run(added, rng)
    volts, drive = motion.volts[BURN_IN:], motion.drive[BURN_IN:]
    time = np.arange(device.samples) / round(1 / device.values["ts"])
    columns = {"t_s": time, "vx_V": volts[:, 0], "vy_V": volts[:, 1], "ux_mps2": drive[:, 0], "uy_mps2": drive[:, 1]}
    if "warm_ramp" in device.values:
        v = device.values
        warm = 23.0 + v["warm_ramp"] * time + v["warm_amp"] * np.sin(v["warm_w"] * time)
        columns["temp_C"] = np.round(warm + rng.normal(0, 5e-4, len(time)), 3)
    with (out / f"{number:02d}.csv").open("wb") as file:
        file.write((",".join(columns) + "\n").encode())
        csv.write_csv(pa.table(columns), file, csv.WriteOptions(include_header=False))
    (out / f"{number:02d}.bench.toml").write_text(bench_text(device, number, rng, peak), "utf-8")
    public = ("name", "description", "coefficients", "parameters", "residual_ratio")
    return {"kind": kind, "effects": [{key: effect[key] for key in public} for effect in device.effects]}


def bench_text(device: Device, number: int, rng: np.random.Generator, peak_V: float) -> str:
    """The bench file: constants as a data sheet has them, off by less than its tolerances."""
    v, mass = device.values, device.mass_kg
    w = 2 * math.pi * device.frequency_Hz
    damping = 0.5 * (v["dxx"] + v["dyy"]) * rng.uniform(0.75, 1.3)
    if device.resonances:
        resonance, q = device.frequency_Hz * (1 + rng.normal(0, 0.002)), w / damping
        constants = f"resonance_Hz = {resonance:.5g}\nq = {q:.3g}"
    else:
        springs = [mass * (v[k] + w**2 * rng.normal(0, 0.004)) for k in ("kxx", "kyy")] + [0.0]
        dampers = [mass * damping, mass * damping, 0.0]
        constants = "stiffness_N_per_m = [{}]\ndamping_N_s_per_m = [{}]".format(
            *(", ".join(f"{value:.5g}" for value in values) for values in (springs, dampers))
        )
    noise = device.floor_V(peak_V) * rng.uniform(0.96, 1.06)
    gains = [float(v["gain_x"]), float(v["gain_y"])]
    turning = f"\n[controller]\nvirtual_rotation_rad_s = {v['virtual']!r}\n" if v.get("virtual") else ""
    return f"""[device]
name = "bench-top gyro {number:02d}"
mass_kg = {mass!r}
{constants}
amplitude_m = {v["amp"]:.4g}
sample_rate_Hz = {round(1 / v["ts"])}.0

[device.sense]
gain_V_per_m = {gains}
noise_V = {noise:.3g}
offset_sd_V = {device.offset_sd_V!r}

[device.drive]
unit = "mps2"
full_scale = {v["full_scale"]!r}
noise_mps2_per_rtHz = {device.force_density:.3g}

[observer]
memory_s = {300 / device.frequency_Hz:.3g}

[observer.initial_sd]
stiffness = 0.03
rate_rad_s = 4.0

[observer.process_noise]
rate_rad_s_per_rts = {device.rate_walk:.3g}
{turning}"""


def main(arguments: list[str] | None = None) -> int:
    """Write records, or check the integrator."""
    parser = argparse.ArgumentParser(
        prog="python -m evaluation.strangers.birch", description="Records of bench-top gyros with a hidden effect."
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", type=int, help="number of the one record to write, 1 to 40")
    parser.add_argument("--check", action="store_true", help="hold the integrator against SciPy's DOP853")
    given = parser.parse_args(arguments)
    if given.check:
        for name, worst in check().items():
            print(f"{name:28s} {worst:.1e}")
        return 0
    if given.out is None or (given.only is not None and not 1 <= given.only <= 40):
        parser.error("--out DIR is needed, and --only is 1 to 40")
    given.out.mkdir(parents=True, exist_ok=True)
    numbers = [given.only] if given.only else list(range(1, 41))
    truth = {f"{number:02d}": write_record(given.seed, number, given.out) for number in numbers}
    (given.out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", "utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
