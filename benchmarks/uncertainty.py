"""Is the angle's uncertainty honest?  Devices whose calibration scatters as their bench files declare.

Each device is an emulated board of its own: gains, misalignment, cross-coupling, delays, clock and angular gain are
drawn from normal distributions with the standard uncertainties of [device.calibration]; nothing else is amiss.  A whole
`hil run` of it in lockstep gives the angle at the end of the scored window and U (k = 2); the truth, which only the
score reads, gives the error.  Told: the share of errors within U, and U over the rms error (2 for a U that is neither
too large nor too small), plant by plant and of all.

A plant is a shipped example with the usual uncertainties (assumed), or calibrated ten times better: then what nobody
declared, and only the record excludes, is the larger part of U.

Then each device is run once more with the setting that its first run proposes for the largest row of U, and that row is
held against the one before.  What is to be calibrated better is drawn anew, ten times nearer to what is declared.

Results are kept in runs/uncertainty, two files a device; what is there is not run again.  GYROHIL_DEVICES is the number
of devices of each plant.  The figures stand in evaluation/results/verdicts.md too, whose table is written here
(GYROHIL_PAGE=evaluation/results/verdicts.md).
"""

import json
import math
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.row import Row, Say
from hil.bench import Bench, load_bench, override
from hil.bench.calibration import ASSUMED
from hil.bench.examples import find
from hil.records.atomic import write_text
from hil.records.result import Contribution
from hil.verdict.angle import remedy

DEVICES = 10
"""Of each plant."""
DRAW = 716
"""Figures are published of devices that nothing was developed on: those have draws below 100."""
PROCESSES = 2
KEPT = Path("runs/uncertainty")
BEGIN, END = "<!-- python -m benchmarks uncertainty -->", "<!-- end -->"
_NEARER = 10.0
"""How much better a constant is known where that is what is proposed."""


class Plant(NamedTuple):
    """An example, what is changed of its bench file, and by how much better it is calibrated than is assumed."""

    example: str
    changes: Mapping[str, Mapping[str, Any]]
    better: float = 1.0


_SLOW, _CLASSIC, _MODERN = (
    {"loop": {"duration_s": seconds, "settle_s": settle}} for seconds, settle in ((12.0, 4.0), (1.6, 0.8), (1.0, 0.4))
)
PLANTS: Mapping[str, Plant] = {
    "S-slow": Plant("s-slow", _SLOW),
    "S-slow one way": Plant("s-slow", _SLOW | {"controller": {"virtual_reversal_s": 0.0}}),
    "S-slow calibrated": Plant("s-slow", _SLOW, 10.0),
    "S-classic calibrated": Plant("s-classic", _CLASSIC, 100.0),
    "S-modern": Plant("s-modern", _MODERN),
    "S-modern calibrated": Plant("s-modern", _MODERN, 10.0),
}


def bench_of(plant: Plant, seed: int) -> Bench:
    """Its bench file, in lockstep."""
    bench = load_bench(Path(find("bench", plant.example)))
    changes = {name: dict(table) for name, table in plant.changes.items()}
    changes["loop"] = changes.get("loop", {}) | {"clock": "lockstep", "seed": seed}
    if plant.better != 1.0:
        known = bench.device.calibration.known(bench.device.resonance_rad_s)
        declared = {f"{name}_u{'_s' if ASSUMED[name].unit == 's' else ''}": known[name].u for name in known}
        changes["device"] = {"calibration": {key: u / plant.better for key, u in declared.items()}}
    return override(bench, changes, plant.example)


def scenario_text(plant: Plant, seed: int, bench: Bench) -> str:
    """A device drawn as the bench file declares.  Of delays only the difference between two channels is drawn, as the
    later one's: no channel of an emulated board answers before it is asked.
    """
    rng = np.random.default_rng([seed, 0x0CA1])
    known = {name: item.u for name, item in bench.device.calibration.known(bench.device.resonance_rad_s).items()}

    def drawn(name: str) -> float:
        return float(known[name] * rng.standard_normal())

    def delays(name: str, x: str, y: str) -> dict[str, float]:
        apart = drawn(name) - drawn(name)
        return {x: max(apart, 0.0), y: max(-apart, 0.0)}

    effects = {
        "drive_gain": {"hx": drawn("drive_gain"), "hy": drawn("drive_gain")},
        "sense_gain": {"gy": drawn("sense_gain_ratio")},
        "drive_misalignment": {"mx": drawn("drive_misalignment"), "my": drawn("drive_misalignment")},
        "sense_cross_coupling": {"ex": drawn("sense_cross_coupling"), "ey": drawn("sense_cross_coupling")},
        "drive_delay": delays("drive_delay", "tux", "tuy"),
        "sense_delay": delays("sense_delay", "tsx", "tsy"),
        "angular_gain": {"kappa": drawn("angular_gain")},
    }
    lines = [find("scenario", plant.example).read_text(encoding="utf-8")]
    for name, coefficients in effects.items():
        lines += [
            "[[effect]]",
            f'name = "{name}"',
            *(f"{symbol} = {value!r}" for symbol, value in coefficients.items()),
        ]
    return "\n".join([*lines, "[faults]", f"clock_skew = {drawn('clock')!r}", ""])


def one(name: str, seed: int) -> dict[str, Any]:
    """U, the error at the end and the verdict of one device; from its file if it was run before."""
    kept = KEPT / name.replace(" ", "-") / f"{seed}.json"
    bench = bench_of(PLANTS[name], seed)
    return _kept(kept, bench, scenario_text(PLANTS[name], seed, bench))


def followed(name: str, seed: int) -> dict[str, Any] | None:
    """The same of the device run again with what its first run proposes for the largest row of U; None where that is
    no setting."""
    plant, bench = PLANTS[name], bench_of(PLANTS[name], seed)
    first = one(name, seed)
    proposed = remedy(Contribution.model_validate(first["row"]), bench)
    drawn = bench
    if proposed.calibrates:
        known = bench.device.calibration.known(bench.device.resonance_rad_s)
        u = known[re.sub(r"_u(_s)?$", "", proposed.calibrates)].u
        bench = drawn = override(bench, {"device": {"calibration": {proposed.calibrates: u / _NEARER}}}, name)
    elif proposed.changes:
        bench = override(bench, dict(proposed.changes), name)
    else:
        return None
    kept = KEPT / name.replace(" ", "-") / f"{seed}-followed.json"
    return _kept(kept, bench, scenario_text(plant, seed, drawn)) | {"proposed": proposed.text}


def _kept(kept: Path, bench: Bench, scenario_toml: str) -> dict[str, Any]:
    if kept.exists():
        return dict(json.loads(kept.read_text()))
    from hil.running.request import RunRequest
    from hil.running.run import run
    from hil.scoring.score import score

    with tempfile.TemporaryDirectory() as place:
        scenario, truth = Path(place) / "drawn.scenario.toml", Path(place) / "truth.arrow"
        scenario.write_text(scenario_toml, encoding="utf-8")
        done = run(RunRequest(bench, f"inproc:{scenario}", {"truth": truth}), Path(place), progress=lambda _: None)
        assert done.folder is not None
        result = score(done.folder, truth)
        assert result.score is not None
        figures = {
            "expanded_rad": result.angle_expanded_rad,
            "error_rad": result.score.angle_error_end_rad,
            "error_rms_rad": result.angle_error_rms_rad,
            "verdict": result.verdict,
            "parts": {name: part.outcome for name, part in result.parts.items()},
            "model": result.parts["model"].reason,
            "budget": {row.source: row.contribution_rad for row in result.uncertainty},
            "row": result.uncertainty[0].model_dump(),
        }
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_text(kept, json.dumps(figures, indent=1) + "\n")
    return figures


def seeds(name: str, devices: int, draw: int = DRAW) -> range:
    """Of a plant's devices; no two plants share any."""
    first = 10_000 * draw + 1000 * list(PLANTS).index(name)
    return range(first, first + devices)


def rows(say: Say) -> list[Row]:
    """All plants, and all their devices together."""
    figures: list[Row] = []
    everything, again = [], []
    devices = int(os.environ.get("GYROHIL_DEVICES", DEVICES))
    for name in PLANTS:
        with ProcessPoolExecutor(PROCESSES) as pool:
            found = list(pool.map(one, [name] * devices, seeds(name, devices)))
            then = list(pool.map(followed, [name] * devices, seeds(name, devices)))
        say(f"{name}: {len(found)} devices")
        figures += [*summary(name, found), *lowered(name, found, then)]
        everything += found
        again += then
    figures += [*summary("all", everything), *lowered("all", everything, again)]
    if page := os.environ.get("GYROHIL_PAGE"):
        place = Path(page)
        place.write_text(with_table(place.read_text(encoding="utf-8"), table(figures)), encoding="utf-8")
    return figures


def lowered(name: str, found: Sequence[Mapping[str, Any]], then: Sequence[Mapping[str, Any] | None]) -> list[Row]:
    """How often a setting was proposed for the largest row of U, and what became of that row with it."""
    ratios = [
        after["budget"].get(before["row"]["source"], math.inf) / before["row"]["contribution_rad"]
        for before, after in zip(found, then, strict=True)
        if after is not None
    ]
    if not ratios:
        return [Row(f"{name}: a setting proposed", 0.0, "1")]
    return [
        Row(f"{name}: a setting proposed", float(len(ratios)), "1"),
        Row(f"{name}: … lowers the largest row", float(np.mean(np.array(ratios) < 1.0)), "1"),
        Row(f"{name}: … to this share of it, median", float(np.median(ratios)), "1"),
    ]


_COLUMNS = {
    "devices": "devices",
    "within U": "errors within U (k = 2)",
    "U over the rms error": "U over the error, rms of their quotients",
    "largest error over its U": "largest error over its U",
    "U, rms / mrad": "U, rms",
    "rms error / mrad": "error at the end, rms",
    "a setting proposed": "a setting proposed",
    "lowers the largest row": "… lowers the largest row",
    "to this share": "… to this share of it, median",
}


def table(figures: Sequence[Row]) -> str:
    """The table of evaluation/results/verdicts.md: a plant a row."""
    by_name = {row.name: row for row in figures}

    def cell(plant: str, column: str) -> str:
        row = by_name.get(f"{plant}: {_COLUMNS[column]}")
        if row is None or (plant == "all" and row.unit == "rad"):
            return ""
        return f"{1e3 * row.value if row.unit == 'rad' else row.value:.3g}"

    must = ["must be", "60", "0.93 to 0.99", "1.6 to 3", *[""] * (len(_COLUMNS) - 3)]
    lines = [["plant", *_COLUMNS], ["---"] * (len(_COLUMNS) + 1), must]
    lines += [[plant, *(cell(plant, column) for column in _COLUMNS)] for plant in ("all", *PLANTS)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def with_table(page: str, rows: str) -> str:
    """The page with these rows between the two comments."""
    begin = page.index(BEGIN) + len(BEGIN)
    return f"{page[:begin]}\n\n{rows}\n\n{page[page.index(END, begin) :]}"


def summary(name: str, found: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Rows of one plant, or of all.  Sizes differ by orders of magnitude from plant to plant, so the ratio of all is
    that of errors in units of their own U.
    """
    u = np.array([ran["expanded_rad"] for ran in found], dtype=float)
    error = np.array([ran["error_rad"] for ran in found], dtype=float)
    good = np.array([ran["verdict"] == "good" for ran in found])
    ratio = 1.0 / math.sqrt(float(np.mean((error / u) ** 2)))
    return [
        Row(f"{name}: devices", float(len(found)), "1"),
        Row(f"{name}: errors within U (k = 2)", float(np.mean(error <= u)), "1"),
        Row(f"{name}: largest error over its U", float(np.max(error / u)), "1"),
        Row(f"{name}: U, rms", math.sqrt(float(np.mean(u**2))), "rad"),
        Row(f"{name}: error at the end, rms", math.sqrt(float(np.mean(error**2))), "rad"),
        Row(f"{name}: U over the error, rms of their quotients", ratio, "1"),
        Row(f"{name}: verdict good", float(np.mean(good)), "1"),
    ]
