"""Records that hardly excite anything: constant amplitude, constant rate, no dither, no virtual rotation.

Many effects look alike there.  A trace must end all the same: adequate with a bound that holds, or with a class whose
look-alikes hold the truth.  Records and answers are kept in a folder and made once; `CALM` replaces it, and
`CALM_ONLY` takes those whose name contains it.
"""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.row import Row, Say
from device_emulator.scenario import Scenario
from evaluation.undeclared.device import bench_table, draw_device, scenario_table
from evaluation.undeclared.effects import EFFECTS, Hidden
from evaluation.undeclared.judging import Judgement, judge
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import Drawn, keep, recorded
from evaluation.undeclared.tracing import trace_all
from hil.bench import Bench
from hil.toml.strict import parse_table

SAMPLES, DRAW = 80_000, 1
FOLDER = Path("runs/calm")

ONE_AXIS = {
    "sense_gain": ({"name": "sense_gain", "gy": 0.012}, {"name": "sense_gain", "gy": 0.008}),
    "drive_gain": ({"name": "drive_gain", "hx": 0.056}, {"name": "drive_gain", "hx": 0.0, "hy": 0.056}),
}
"""Of fixed sizes, beside those that are drawn."""

DRAWN = (
    "sense_gain", "drive_gain", "sense_cross_coupling", "drive_misalignment", "nonreciprocal_stiffness",
    "cubic_stiffness", "cubic_isotropic", "nonlinear_damping", "dry_friction", "quadratic_stiffness",
    "sense_quadratic", "sense_cubic", "sense_delay", "drive_delay", "drive_feedthrough", "sense_low_pass",
)  # fmt: skip


def orders() -> list[Order]:
    """Every record: two without anything hidden, those of fixed size, one of each that is drawn."""
    fixed = [Order("fixed", (name,), number, DRAW) for name, all_ in ONE_AXIS.items() for number in range(len(all_))]
    clean = [Order("clean", (), number, DRAW) for number in range(2)]
    return [*fixed, *clean, *(Order("calm", (name,), 0, DRAW) for name in DRAWN)]


def draw_single_tone_record(order: Order) -> Drawn:
    """A device near S-slow, its hidden effect, the calmest of benches."""
    rng = np.random.default_rng(order.seed)
    device = draw_device(rng, crest=1.0, slow=True)
    duration_s = SAMPLES / device.sample_rate_Hz
    rate: dict[str, Any] = {"kind": "constant", "rate_rad_s": device.rate_rad_s * float(rng.uniform(-1.0, 1.0))}
    hidden = [
        Hidden([ONE_AXIS[name][order.number]], 0.0) if order.category == "fixed" else EFFECTS[name].draw(rng, device)
        for name in order.effects
    ]
    table = scenario_table(device, rate, order.seed)
    for what in hidden:
        table.setdefault("effect", []).extend(what.effects)
        for section, keys in what.sections.items():
            table[section] = table.get(section, {}) | keys
    bench = parse_table(bench_table(device, duration_s, excited=False, turning=False), Bench, order.name)
    return Drawn(device, hidden, table, Scenario.model_validate(table), bench, False)


def made(folder: Path, say: Say) -> list[Path]:
    """The folder of every record, each made unless it is there."""
    places = []
    for order in orders():
        place = folder / order.name
        if os.environ.get("CALM_ONLY", "") not in order.name:
            continue
        if not (place / "truth.json").exists():
            drawn = draw_single_tone_record(order)
            keep(drawn, recorded(drawn, order, SAMPLES), order, place)
            say(f"{order.name}: recorded")
        places.append(place)
    return places


def holds(judged: Judgement) -> bool:
    """Whether the answer ends as it must."""
    if not judged.truth:
        return judged.verdict == "adequate"
    return judged.first_class or (judged.verdict == "adequate" and judged.bounded)


def rows(say: Say) -> list[Row]:
    """How many end, and how many are named wrong without reserve."""
    places = made(Path(os.environ.get("CALM", FOLDER)), say)
    trace_all(places, 1, keep=False, say=say)
    judged = []
    for place in places:
        said = place / "diagnosis.json"
        truth = json.loads((place / "truth.json").read_text())
        judged.append(one := judge(truth, json.loads(said.read_text()) if said.exists() else None))
        took = json.loads((place / "traced.json").read_text())["seconds"]
        say(f"{'holds' if holds(one) else 'FAILS'} {one.name}: {one.verdict} {' + '.join(one.named)}, {took:.0f} s")
    n = len(judged)
    return [
        Row("calm records", n, "records"),
        Row("adequate with a bound that holds, or a class that holds the truth", sum(map(holds, judged)), "records"),
        Row("a wrong name without look-alikes", sum(one.misnamed for one in judged), "records"),
    ]
