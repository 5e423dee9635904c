"""Forty gyro records with hidden effects, from the equations alone; each effect's size is measured, not guessed.

    python -m evaluation.strangers.cedar --seed S --out DIR [--only NN]
    python -m evaluation.strangers.cedar --check

writes DIR/NN.csv, DIR/NN.bench.toml and DIR/truth.json for NN = 01..40. The motion is integrated in the units of the
device (time in 1/omega0, length in the amplitude A) by an extrapolation method of order 8 with step control, in C. The
loop is a resonator for each channel with energy and quadrature control. A Kalman filter of the model without effects
then tells the ratio of its innovation with the effect to that without; the size is set to a drawn ratio.
"""

from __future__ import annotations

import argparse
import ctypes
import hashlib
import json
import math
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from evaluation.strangers.cedar_effects import NAMED, OUTSIDE, TIED, Effect, parameters, to_si

Array = NDArray[np.float64]
RECORDS = 40
KINDS = ["clean"] * 5 + ["one"] * 14 + ["single-tone"] * 5 + ["two"] * 10 + ["outside"] * 6
LAWS = {**NAMED, **OUTSIDE}
STATES = 14
WARM = 12000
SIZED_ON = 30000
MEMORY = (
    "sense_low_pass", "sense_high_pass", "parasitic_mode", "self_heating", "lagged_drag", "bristle",
)  # fmt: skip


@cache
def library() -> ctypes.CDLL:
    """The compiled part; built at first use into the temporary folder, named by its content."""
    lines = [f"#define I_{name} {place}" for place, name in enumerate(parameters())]
    source = "\n".join(lines) + "\n" + Path(__file__).with_name("cedar.c").read_text(encoding="utf-8")
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    folder = Path(tempfile.gettempdir()) / "gyrohil-cedar"
    folder.mkdir(exist_ok=True)
    target = folder / f"{digest}.so"
    if not target.exists():
        with tempfile.TemporaryDirectory(dir=folder) as work:
            (Path(work) / "cedar.c").write_text(source, encoding="utf-8")
            built = Path(work) / "cedar.so"
            flags = ["-O2", "-shared", "-fPIC", "-ffp-contract=off", "-Wall", "-Wextra"]
            subprocess.run(["gcc", *flags, "-o", str(built), str(Path(work) / "cedar.c"), "-lm"], check=True)
            built.replace(target)
    loaded = ctypes.CDLL(str(target))
    loaded.cedar_judge.restype = ctypes.c_double
    return loaded


def _pointer(values: Array) -> Any:
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


def _vector(values: dict[str, float]) -> Array:
    return np.array([values.get(name, 0.0) for name in parameters()])


@dataclass
class Device:
    """A drawn device: SI scales, and every number of the compiled part (no unit) in `values`."""

    omega0: float
    amplitude_m: float
    mass_kg: float
    gain_V_per_m: float
    rows: int
    latency: int
    noise_sd: float
    values: dict[str, float]
    noise: Array
    steady: bool

    @property
    def sample_rate_Hz(self) -> float:
        return self.omega0 / self.values["h"]


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def draw_device(rng: np.random.Generator, single_tone: bool) -> Device:
    """A device, its electronics, its loop and its rotation; `single_tone`: constant amplitude and rate, no dither."""
    rate_Hz = round(_log(rng, 100.0, 12000.0) * rng.uniform(15.0, 40.0), -1)
    per_cycle = rng.uniform(15.0, 40.0)
    f0 = rate_Hz / per_cycle
    while not 100.0 <= f0 <= 12000.0:
        f0 *= 0.5 if f0 > 12000.0 else 2.0
        rate_Hz = round(f0 * per_cycle, -1)
    omega0, h = 2 * math.pi * f0, 2 * math.pi * f0 / rate_Hz
    rows = int(rng.integers(60_000, 130_001))
    length = rows * h
    amplitude = _log(rng, 10e-6, 100e-6) if f0 < 700.0 else _log(rng, 0.5e-6, 5e-6)
    q = _log(rng, 200.0, 20000.0)
    split = _sign(rng) * _log(rng, 2e-5, 8e-3)
    cross = _sign(rng) * _log(rng, 2e-5, 5e-3)
    p = {"h": h, "kxx": 1.0 + split, "kyy": 1.0 - split, "kxy": cross}
    p |= {"dxx": (1 + rng.uniform(-0.1, 0.1)) / q, "dyy": (1 + rng.uniform(-0.1, 0.1)) / q}
    p["dxy"] = rng.uniform(-0.08, 0.08) / q
    # Electronics: what a channel shows at most is 0.5 to 0.9 of its range.
    p |= {"phi_x": _sign(rng) * _log(rng, 0.005, 0.3), "phi_y": _sign(rng) * _log(rng, 0.005, 0.3)}
    depth = 0.0 if single_tone else rng.uniform(0.2, 0.35)
    p["adc_full"] = (1.0 + depth + 0.3) * rng.uniform(1.15, 1.6)
    bits = int(rng.choice([14, 16, 18, 20, 24]))
    p["adc_lsb"] = 2 * p["adc_full"] / 2**bits
    p["noise_sd"] = max(_log(rng, 5e-5, 4e-3), 0.6 * p["adc_lsb"])
    noise_sd = math.hypot(p["noise_sd"], p["adc_lsb"] / math.sqrt(12.0))
    p["force_sd"] = noise_sd / h * _log(rng, 1e-3, 1e-2)
    # The engineer's loop: he knows the stiffness to some per cent of the split and the damping to a fifth.
    p |= {
        "loop_omega": 1 + rng.normal(0, 2e-4),
        "loop_gain": rng.uniform(0.03, 0.1),
        "loop_energy": rng.uniform(0.01, 0.03),
    }
    p |= {"loop_quadrature": rng.uniform(0.01, 0.04), "loop_damping": rng.uniform(0.8, 1.1) / q}
    p |= {"loop_kd": split * rng.uniform(0.9, 1.05), "loop_kxy": cross * rng.uniform(0.9, 1.05)}
    # Rotation, at most 8 rad/s and 0.4 % of the resonance.
    top = min(_log(rng, 0.3, 8.0) / omega0, 4e-3)
    p |= {"rate_mean": _sign(rng) * top * rng.uniform(0.1, 0.6)}
    if not single_tone:
        turns = _sign(rng) * rng.uniform(2.5, 10.0)
        p |= {"loop_dither": _log(rng, 2e-3, 8e-3), "loop_modulation": depth, "loop_virtual": turns / length}
        p["loop_modulation_omega"] = 2 * math.pi * rng.uniform(4.0, 14.0) / length
        if rng.random() < 0.6:
            p |= {"rate_sine": top * rng.uniform(0.3, 0.7), "rate_phase": rng.uniform(0, 2 * math.pi)}
            p["rate_omega"] = 2 * math.pi * rng.uniform(0.7, 5.0) / length
        else:
            p |= {"rate_step": top * rng.uniform(0.2, 0.5), "rate_at": length * rng.uniform(0.2, 0.8)}
            p["rate_width"] = length * rng.uniform(0.01, 0.1)
    push = abs(p["loop_kd"]) + abs(cross) + p["loop_damping"] + 0.4 * p["loop_energy"] + p["loop_quadrature"] * 0.2
    dac_full = (1.35 * push + 2 * abs(p.get("loop_virtual", 0.0)) + 4 * p.get("loop_dither", 0.0)) * rng.uniform(
        1.1, 1.5
    )
    p |= {"dac_full": dac_full, "dac_lsb": 2 * dac_full / 2 ** int(rng.choice([14, 16, 18]))}
    return Device(
        omega0=omega0,
        amplitude_m=amplitude,
        mass_kg=_log(rng, 1e-4, 2e-3) if f0 < 700.0 else _log(rng, 5e-9, 5e-7),
        gain_V_per_m=_log(rng, 0.1, 2.0) / amplitude,
        rows=rows,
        latency=int(rng.integers(0, 4)),
        noise_sd=noise_sd,
        values=p,
        noise=rng.standard_normal((WARM + rows, 6)),
        steady=single_tone,
    )


def run(device: Device, hidden: dict[str, float], rows: int) -> tuple[Array, Array, Array]:
    """v [rows, 2] in A, u [rows, 2] in A omega0², the state x, vx, y, vy at the first row."""
    v, u, start = np.empty((rows, 2)), np.empty((rows, 2)), np.empty(4)
    angle = 0.6
    s = np.zeros(STATES)
    s[:4] = math.cos(angle), 0.0, math.sin(angle), 0.0
    p = _vector({**device.values, **hidden})
    states = STATES if any(name.startswith(MEMORY) for name in hidden) else 4
    size = ctypes.c_int
    library().cedar_run(
        _pointer(p), size(states), size(WARM), size(rows), size(device.latency), _pointer(s), _pointer(device.noise),
        _pointer(v), _pointer(u), _pointer(start),
    )  # fmt: skip
    if not (np.isfinite(v).all() and np.abs(v).max() < 3.0 * device.values["adc_full"]):
        raise FloatingPointError("the loop diverged")
    return v, u, start


def judged(device: Device, record: tuple[Array, Array, Array]) -> float:
    """Innovation of the model without effects, in units of its expected deviation (1: the model suffices)."""
    v, u, start = record
    p = device.values
    e = np.array(
        [*start, p["phi_x"], p["phi_y"], p["rate_mean"], *(p[k] for k in ("kxx", "kyy", "kxy", "dxx", "dyy", "dxy"))]
    )
    damping = 0.5 * (p["dxx"] + p["dyy"])
    sd = np.array([*[0.05] * 4, 0.2, 0.2, 5e-3, 0.02, 0.02, 0.02, damping, damping, damping])
    walk = 0.0 if device.steady else (p.get("rate_sine", 0.0) + p.get("rate_step", 0.0) + 1e-7) ** 2 * 6.0 / len(v)
    number = ctypes.c_double
    ratio = library().cedar_judge(
        ctypes.c_int(len(v)), number(p["h"]), _pointer(v), _pointer(u), _pointer(e), _pointer(sd**2),
        number(device.noise_sd**2), number(p["force_sd"] ** 2), number(walk),
    )  # fmt: skip
    return float(ratio)


@dataclass
class Hidden:
    """An effect as it is in a device: `values` by symbol, without unit."""

    name: str
    values: dict[str, float]
    ratio: float

    def settings(self) -> dict[str, float]:
        return {f"{self.name}_{symbol}": value for symbol, value in self.values.items()}


def sized(
    rng: np.random.Generator, device: Device, name: str, before: float, target: float, rows: int
) -> Hidden | None:
    """The effect at a size that lifts the innovation by `target`; None where no plausible size does by 1.25."""
    law: Effect = LAWS[name]
    v, u, _ = run(device, {}, 8000)
    scales = {
        "one": 1.0,
        "drive": float(np.abs(u).max()),
        "seen": float(np.abs(v).max()),
        "length": device.rows * device.values["h"],
    }
    shares, drawn = law.draw(rng, scales)
    rows = device.rows if law.scale == "length" else rows
    cap = min(law.cap, 0.8 * device.values["h"]) if name.endswith("_delay") else law.cap
    size, best = min(law.guess, cap, key=abs), None
    for _ in range(5):
        hidden = Hidden(name, {**{symbol: size * share for symbol, share in shares.items()}, **drawn}, 0.0)
        try:
            hidden.ratio = judged(device, run(device, hidden.settings(), rows)) / before
        except FloatingPointError:
            size *= 0.25
            continue
        if not math.isfinite(hidden.ratio):
            size *= 0.25
            continue
        if 1.2 <= hidden.ratio <= 25.0 and (
            best is None or abs(math.log(hidden.ratio / target)) < abs(math.log(best.ratio / target))
        ):
            best = hidden
            if 0.7 < hidden.ratio / target < 1.4:
                break
        step = math.sqrt((target**2 - 1.0) / max(hidden.ratio**2 - 1.0, 0.02))
        new = math.copysign(min(max(abs(size) * min(max(step, 0.03), 12.0), law.floor), abs(cap)), size)
        if new == size:
            break
        size = new
    return best


@dataclass
class Record:
    """A device with its effects, and what was recorded of it."""

    kind: str
    device: Device
    effects: list[Hidden]
    v: Array
    u: Array
    ratio: float


def _settings(effects: list[Hidden]) -> dict[str, float]:
    return {key: value for hidden in effects for key, value in hidden.settings().items()}


def _family(name: str) -> str:
    """Laws of one family differ by the shape of the orbit only: a pair of them is one effect told twice."""
    if "damping" in name or "drag" in name:
        return "damping"
    if "friction" in name:
        return "friction"
    if name.startswith(("cubic_", "quintic_")):
        return "spring"
    return name


def _names(seed: int) -> list[list[str]]:
    """For each record the names to try in turn: the first one, of a pair the first two, that its device shows."""
    rng = np.random.default_rng([seed, 0])
    named, quiet = list(rng.permutation(list(NAMED))), [n for n in NAMED if NAMED[n].single_tone]
    spare, outside = named[14:], list(rng.permutation(list(OUTSIDE)))
    tone = list(rng.permutation(quiet))
    lists: list[list[str]] = [[] for _ in range(5)]
    lists += [[named[i], spare[i], spare[14 + i % 7]] for i in range(14)]
    lists += [[tone[i], *tone[5:]] for i in range(5)]
    lists += [list(rng.permutation(list(NAMED))[:10]) for _ in range(10)]
    lists += [[outside[i], *outside[6:]] for i in range(6)]
    return [[str(name) for name in names] for names in lists]


def make(seed: int, number: int) -> Record:
    """Record `number` (1..40) of a seed."""
    order = np.random.default_rng([seed, 99]).permutation(RECORDS)
    which = int(order[number - 1])
    kind, names = KINDS[which], _names(seed)[which]
    for attempt in range(20):
        rng = np.random.default_rng([seed, number, attempt])
        device = draw_device(rng, kind == "single-tone" or which < 2)
        rows = min(device.rows, SIZED_ON)
        try:
            before = judged(device, run(device, {}, rows))
        except FloatingPointError:
            continue
        if not before < 1.12:  # the loop or the excitation is not one that the plain model can follow
            continue
        effects: list[Hidden] = []
        wanted = {"clean": 0, "two": 2}.get(kind, 1)
        for name in names:
            if len(effects) == wanted:
                break
            if any(_family(name) == _family(hidden.name) for hidden in effects):
                continue
            found = sized(rng, device, name, before, _log(rng, 1.25, 12.0 if kind == "two" else 20.0), rows)
            if found is not None:
                effects.append(found)
        if len(effects) < wanted:
            continue
        for _ in range(3):
            try:
                record = run(device, _settings(effects), device.rows)
                ratio = judged(device, record)
                if wanted == 2:
                    for hidden in effects:
                        hidden.ratio = judged(device, run(device, hidden.settings(), device.rows))
                elif wanted == 1:
                    effects[0].ratio = ratio
            except FloatingPointError:
                break
            clipped = float(np.abs(record[0]).max()) > device.values["adc_full"] - device.values["adc_lsb"]
            seen = [ratio, *(hidden.ratio for hidden in effects)]
            if not clipped and (ratio < 1.1 if wanted == 0 else min(seen) > 1.15 and max(seen) < 30.0):
                return Record(kind, device, effects, record[0], record[1], ratio)
            if max(seen) < 30.0:
                break
            for hidden in effects:
                for symbol in LAWS[hidden.name].sized:
                    hidden.values[symbol] *= 0.4
    raise RuntimeError(f"no device shows the effects of record {number:02d} of seed {seed}")


def csv_text(record: Record) -> str:
    """The interchange CSV: ux of row m acted over the interval that ended at t_m."""
    device = record.device
    volts, force = device.gain_V_per_m * device.amplitude_m, device.amplitude_m * device.omega0**2
    t = np.arange(len(record.v)) / device.sample_rate_Hz
    table = np.column_stack([t, record.v * volts, record.u * force])
    rows = [f"{a:.12g},{b:.11g},{c:.11g},{d:.11g},{e:.11g}" for a, b, c, d, e in table.tolist()]
    return "\n".join(["t_s,vx_V,vy_V,ux_mps2,uy_mps2", *rows, ""])


def bench_text(record: Record, name: str, seed: int) -> str:
    """The data sheet: the device's constants with the errors of a data sheet, and their tolerances."""
    d, p = record.device, record.device.values
    rng = np.random.default_rng([seed, int(name), 7])
    k, volts, force = d.mass_kg * d.omega0**2, d.gain_V_per_m * d.amplitude_m, d.amplitude_m * d.omega0**2
    sd_k, sd_d = _log(rng, 4e-3, 2e-2), rng.uniform(0.4, 1.0)
    split = 0.5 * (p["kxx"] - p["kyy"])
    mean = 1.0 + 0.5 * sd_k * rng.normal()
    stiff = [k * mean * (1 + split * 0.8), k * mean * (1 - split * 0.8), k * p["kxy"] * 0.8]
    loss = d.mass_kg * d.omega0 * 0.5 * (p["dxx"] + p["dyy"]) * (1 + 0.2 * float(np.clip(rng.normal(), -1.5, 1.5)))
    duration = d.rows / d.sample_rate_Hz
    swing = (p.get("rate_sine", 0.0) + p.get("rate_step", 0.0)) * d.omega0
    top = abs(p["rate_mean"]) * d.omega0 + swing
    periods = max(1.0, p.get("rate_omega", 0.0) * p["h"] * d.rows / (2 * math.pi))
    walk = 2.5 * swing * math.sqrt(periods / duration) if swing else 1e-3 * top / math.sqrt(duration)
    density = p["force_sd"] * force * math.sqrt(2.0 / d.sample_rate_Hz)
    sheet: dict[str, dict[str, object]] = {
        "device": {
            "name": f"cedar-{name}", "axes": 2, "mass_kg": d.mass_kg, "stiffness_N_per_m": stiff,
            "damping_N_s_per_m": [loss, loss, 0.0], "amplitude_m": d.amplitude_m,
            "sample_rate_Hz": round(d.sample_rate_Hz, 6),
        },
        "device.sense": {
            "gain_V_per_m": d.gain_V_per_m, "noise_V": d.noise_sd * volts * rng.uniform(0.97, 1.05),
            "offset_sd_V": 0.2 * volts,
        },
        "device.drive": {"unit": "mps2", "full_scale": p["dac_full"] * force, "hold": "zoh"},
        "loop": {"duration_s": duration, "settle_s": 0.1 * duration},
        "observer": {"memory_s": 0.2 * duration},
        "observer.initial_sd": {"rate_rad_s": 1.5 * top, "stiffness": sd_k, "damping": sd_d},
        "observer.process_noise": {"force_mps2_per_rtHz": density * rng.uniform(0.9, 1.15), "rate_rad_s_per_rts": walk},
        "controller": {"enabled": False},
    }  # fmt: skip
    lines = []
    for section, keys in sheet.items():
        lines.append(f"[{section}]")
        lines += [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
        lines.append("")
    return "\n".join(lines)


def truth_of(record: Record) -> dict[str, object]:
    """Kind and effects, in SI units per unit mass."""
    d, told = record.device, []
    for hidden in record.effects:
        law = LAWS[hidden.name]
        units = {**law.sized, **{symbol: unit for symbol, (unit, _, _) in law.drawn.items()}}
        values = {s: to_si(value, units[s], d.amplitude_m, d.omega0) for s, value in hidden.values.items()}
        values |= {TIED[s]: values[s] for s in list(values) if s in TIED}
        inside = hidden.name in NAMED
        words = law.told or hidden.name.replace("_", " ")
        told.append(
            {
                "name": hidden.name if inside else None,
                "description": words,
                "coefficients": values,
                "ratio": hidden.ratio,
            }
        )
    return {"kind": record.kind, "single_tone": d.steady, "effects": told, "ratio": record.ratio}


def check() -> float:
    """Largest error of one interval against SciPy's DOP853, in A, over every effect; raises where it exceeds 1e-9."""
    rng, worst = np.random.default_rng(5), 0.0
    lib, size, number = library(), ctypes.c_int, ctypes.c_double
    for name, law in LAWS.items():
        device = draw_device(rng, False)
        shares, drawn = law.draw(rng, {"one": 1.0, "drive": 0.02, "seen": 1.3, "length": 1e4})
        hidden = Hidden(name, {**{s: law.cap * share for s, share in shares.items()}, **drawn}, 0.0)
        p, h = _vector({**device.values, **hidden.settings()}), device.values["h"]
        for part in range(2):
            s = np.zeros(STATES)
            s[:4] = rng.uniform(-1, 1, 4) * [1, 1, 1, 0.05]
            force, t = rng.normal(0, 0.01, 2), 100.0 * part

            def slope(at: float, y: Array, p: Array = p, force: Array = force) -> Array:
                d = np.empty(STATES)
                lib.cedar_rhs(
                    _pointer(p),
                    size(STATES),
                    number(at),
                    _pointer(np.ascontiguousarray(y)),
                    _pointer(force),
                    _pointer(d),
                )
                return d

            exact = solve_ivp(slope, (t, t + h), s, method="DOP853", rtol=1e-13, atol=1e-14, max_step=h / 30).y[:, -1]
            lib.cedar_advance(_pointer(p), size(STATES), number(t), number(h), _pointer(s), _pointer(force))
            worst = max(worst, float(np.abs(s - exact)[:4].max()))
    if not worst < 1e-9:
        raise ArithmeticError(f"an interval is off by {worst:.2e} of the amplitude, more than 1e-9")
    return worst


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m evaluation.strangers.cedar", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", type=int, choices=range(1, RECORDS + 1), metavar="NN", help="one record, 1 to 40")
    parser.add_argument("--check", action="store_true", help="integrator against SciPy's DOP853")
    options = parser.parse_args(arguments)
    if options.check:
        print(f"largest error of an interval: {check():.1e} of the amplitude")
        return 0
    if options.out is None:
        parser.error("--out DIR is needed")
    options.out.mkdir(parents=True, exist_ok=True)
    truth = {}
    for number in [options.only] if options.only else range(1, RECORDS + 1):
        record, name = make(options.seed, number), f"{number:02d}"
        (options.out / f"{name}.csv").write_text(csv_text(record), encoding="utf-8")
        (options.out / f"{name}.bench.toml").write_text(bench_text(record, name, options.seed), encoding="utf-8")
        truth[name] = truth_of(record)
        print(name, file=sys.stderr)
    (options.out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
