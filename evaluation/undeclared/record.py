"""One record: a device drawn, its hidden effects, the loop closed around it in lockstep, and the files of it.

FOLDER/NAME/capture.arrow   what the bench recorded, in the product's own format
FOLDER/NAME/bench.toml      what the data sheet says
FOLDER/NAME/truth.json      what it really was; only the evaluation reads it
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.lockstep import ClosedLoop, close_loop, rms
from device_emulator.scenario import Scenario
from evaluation.undeclared.device import (
    DrawnDevice,
    bench_table,
    draw_device,
    draw_rate,
    draw_temperature,
    scenario_table,
    temperature_C,
)
from evaluation.undeclared.effects import EFFECTS, Hidden
from evaluation.undeclared.population import Order
from hil.bench import Bench
from hil.bench.template import template, values_of
from hil.errors import InputError
from hil.records.atomic import write_text
from hil.records.capture import board_layout, import_layout
from hil.records.stream import BlockWriter
from hil.toml.reading import parse_table

SAMPLES = 60_000
_ATTEMPTS = 20


@dataclass(frozen=True)
class Drawn:
    """What is behind a record: the device and what is hidden in it, the board that has it, its data sheet."""

    device: DrawnDevice
    hidden: list[Hidden]
    table: dict[str, Any]
    scenario: Scenario
    bench: Bench
    excited: bool


def draw_record(order: Order, samples: int, attempt: int = 0) -> Drawn:
    """The device of `order`, for a record of so many samples; another one for each attempt."""
    rng = np.random.default_rng([order.seed, attempt] if attempt else order.seed)
    drawables = [EFFECTS[name] for name in order.effects]
    excited = order.category not in ("calm", "still")
    thermal = any(drawable.slow for drawable in drawables)
    device = draw_device(rng, crest=1.3 if excited else 1.0, slow=thermal)
    duration_s = samples / device.sample_rate_Hz
    rate = draw_rate(rng, device, duration_s)
    turning = excited or bool(rng.random() < 0.5)
    if order.category == "still":  # on the table: nothing turns, neither the device nor its pattern
        rate, turning = {"kind": "constant", "rate_rad_s": 0.0}, False
    hidden = [drawable.draw(rng, device) for drawable in drawables]
    table = scenario_table(device, rate, order.seed)
    for what in hidden:
        table.setdefault("effect", []).extend(what.effects)
        for section, keys in what.sections.items():
            table[section] = table.get(section, {}) | keys
    # A thermometer is there wherever something depends on it, and beside some devices where nothing does.
    if thermal or (order.category == "clean" and device.slow and rng.random() < 0.4):
        table["temperature"] = draw_temperature(rng, duration_s)
    scenario = Scenario.model_validate(table)
    bench = parse_table(bench_table(device, duration_s, excited, turning), Bench, order.name)
    return Drawn(device, hidden, table, scenario, bench, excited)


def make(order: Order, folder: Path, samples: int = SAMPLES) -> Path:
    """Record `order` below `folder` unless it is there already; returns its folder.  A device whose board flags
    samples as clipped is drawn again: its record is one to be refused, which says nothing of the tracer.  Raises
    InputError where another record of that name is there, or no device that is drawn stays within its converter.
    """
    place = folder / order.name
    if (place / "truth.json").exists():
        return made_of(order, folder, samples)
    for attempt in range(_ATTEMPTS):
        drawn = draw_record(order, samples, attempt)
        loop = recorded(drawn, order, samples)
        if not _clipped(loop):
            return keep(drawn, loop, order, place, attempt)
    raise InputError(f"{place}: {_ATTEMPTS} devices were drawn, and each passes its converter's range")


def made_of(order: Order, folder: Path, samples: int) -> Path:
    """Folder of a record that is there.  Raises InputError where it is not, or is of another draw or length."""
    file = folder / order.name / "truth.json"
    if not file.exists():
        raise InputError(f"{file}: no record is there; `python -m evaluation.undeclared generate` makes it")
    truth = json.loads(file.read_text())
    if (truth["seed"], truth["samples"]) != (order.seed, samples):
        raise InputError(
            f"{file}: of another draw or length (seed {truth['seed']}, {truth['samples']} samples; wanted "
            f"{order.seed}, {samples}); give another --folder, or remove it"
        )
    return file.parent


def recorded(drawn: Drawn, order: Order, samples: int) -> ClosedLoop:
    """The loop closed around what was drawn."""
    return close_loop(drawn.scenario, drawn.bench, samples, seed=order.seed, every=1000)


def keep(drawn: Drawn, loop: ClosedLoop, order: Order, place: Path, attempt: int = 0) -> Path:
    """Write the files of what was drawn, at the attempt of that number, into `place`, which it returns."""
    place.mkdir(parents=True, exist_ok=True)
    write_capture(place / "capture.arrow", loop, drawn.scenario, drawn.table.get("temperature"))
    write_text(place / "bench.toml", template(values_of(drawn.bench), "The data sheet."))
    # Last: a record without it is made again.
    write_text(place / "truth.json", json.dumps(_truth(order, drawn, loop, attempt), indent=1))
    return place


def write_capture(path: Path, loop: ClosedLoop, scenario: Scenario, temperature: dict[str, float] | None) -> None:
    """The record as the loop would have written it; with a thermometer, which the wire does not know, as an import."""
    rate = scenario.board.sample_rate_Hz
    sense_V = 2.0 * scenario.sense.adc_full_scale_V / 2**scenario.sense.adc_bits
    drive_mps2 = math.ldexp(scenario.drive.full_scale_mps2, 1 - scenario.drive.dac_bits)
    if temperature is None:
        layout = board_layout(
            tick_rate_Hz=rate,
            axes=2,
            latency_ticks=scenario.drive.latency_samples,
            sense_scale_V=sense_V,
            drive_scale=drive_mps2,
        )
        columns = list(loop.capture.T)
    else:
        names = ["vx_V", "vy_V", "ux_mps2", "uy_mps2", "temp_C"]
        layout = import_layout(names, tick_rate_Hz=rate, uniform=True, hold="zoh", segments={})
        tick, vx, vy, ux, uy, _ = loop.capture.T
        shown = temperature_C(temperature, tick / rate)
        columns = [tick, vx * sense_V, vy * sense_V, ux * drive_mps2, uy * drive_mps2, shown]
    rows = np.zeros(len(loop.capture), layout.dtype)
    for name, column in zip(rows.dtype.names or (), columns, strict=True):
        rows[name] = column
    with BlockWriter(path, layout) as writer:
        writer.push(rows)


def _clipped(loop: ClosedLoop) -> int:
    return int(np.count_nonzero(loop.capture[:, 5] & 2))


def _truth(order: Order, drawn: Drawn, loop: ClosedLoop, attempt: int) -> dict[str, Any]:
    device, hidden, table, scenario, excited = drawn.device, drawn.hidden, drawn.table, drawn.scenario, drawn.excited
    lsb = 2.0 * scenario.sense.adc_full_scale_V / 2**scenario.sense.adc_bits
    noise = math.hypot(scenario.sense.noise_V, lsb / math.sqrt(12.0))
    flags = loop.capture[:, 5]
    late = slice(len(loop.capture) // 2, None)
    innovation = loop.innovation_V[late]
    true_rate = loop.truth["rate_rad_s"]
    return {
        "name": order.name,
        "category": order.category,
        "effects": [
            {"name": name, "size": what.size, "tables": what.effects, "sections": what.sections}
            for name, what in zip(order.effects, hidden, strict=True)
        ],
        "seed": order.seed,
        "samples": len(loop.capture),
        "excited": excited,
        "noise_V": noise,
        "noise_white_V": scenario.sense.noise_V,
        "noise_quantisation_V": lsb / math.sqrt(12.0),
        # Of the observer in the loop, which did not know the effect, over the second half.
        "innovation_ratio": rms(innovation[np.isfinite(innovation)]) / noise if innovation.size else None,
        "drawn_before": attempt,  # devices that passed their converter's range
        "rows_clipped": _clipped(loop),
        "rows_saturated": int(np.count_nonzero(flags & 4)),
        "device": {
            "frequency_Hz": device.frequency_Hz,
            "omega_rad_s": device.omega,
            "amplitude_m": device.amplitude_m,
            "sample_rate_Hz": device.sample_rate_Hz,
            "mass_kg": device.mass_kg,
            "stiffness_per_s2": device.stiffness,
            "damping_per_s": device.damping,
            "gain_V_per_m": device.gain_V_per_m,
        },
        "rate_rms_rad_s": rms(true_rate),
        "amplitude_peak": float(np.sqrt((loop.truth["x_m"] ** 2 + loop.truth["y_m"] ** 2)[len(true_rate) // 4 :].max()))
        / device.amplitude_m,
        "scenario": table,
    }
