"""Is the angle's uncertainty honest?  Clean devices of S-slow whose calibration scatters as the bench file declares.

Each device is an emulated board of its own: gains, misalignment, cross-coupling, delays, clock and angular gain are
drawn from normal distributions with the standard uncertainties of [device.calibration]; nothing else is amiss.  A whole
`hil run` of it in lockstep gives the angle at the end of the scored window and U (k = 2); the truth, which only the
score reads, gives the error.  Told: the share of errors within U, and U over the rms error (2 for a U that is neither
too large nor too small), with virtual rotation one way, and reversed as the budget proposes.

Results are kept in runs/uncertainty, one file a device; what is there is not run again.
"""

import json
import math
import os
import tempfile
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.row import Row, Say
from hil.bench import Bench, load_bench, override
from hil.examples import find
from hil.records.atomic import write_text

DEVICES = 60
PROCESSES = 2
KEPT = Path("runs/uncertainty")
ONE_WAY, REVERSED = "one way", "reversed"
CONTROLLER: Mapping[str, Mapping[str, float]] = {ONE_WAY: {"virtual_reversal_s": 0.0}, REVERSED: {}}


def bench_with(setting: str) -> Bench:
    """The example with the virtual rotation as `setting` says; as it is, it is reversed."""
    bench = load_bench(Path(find("bench", "s-slow")))
    return override(bench, {"loop": {"clock": "lockstep"}, "controller": CONTROLLER[setting]}, setting)


def scenario_text(seed: int, bench: Bench) -> str:
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
    lines = [find("scenario", "s-slow").read_text(encoding="utf-8")]
    for name, coefficients in effects.items():
        lines += [
            "[[effect]]",
            f'name = "{name}"',
            *(f"{symbol} = {value!r}" for symbol, value in coefficients.items()),
        ]
    return "\n".join([*lines, "[faults]", f"clock_skew = {drawn('clock')!r}", ""])


def one(setting: str, seed: int) -> dict[str, Any]:
    """U, the error at the end and the verdict of one device; from its file if it was run before."""
    kept = KEPT / setting.replace(" ", "-") / f"{seed}.json"
    if kept.exists():
        return dict(json.loads(kept.read_text()))
    from hil.loop.run import run
    from hil.records.runfolder import RunFolder
    from hil.records.truth import read_truth
    from hil.scoring import angle_error_rad, score, scored_window

    bench = override(bench_with(setting), {"loop": {"seed": seed}}, setting)
    with tempfile.TemporaryDirectory() as place:
        scenario, truth = Path(place) / "drawn.scenario.toml", Path(place) / "truth.arrow"
        scenario.write_text(scenario_text(seed, bench), encoding="utf-8")
        done = run(bench, f"inproc:{scenario}", Path(place), truth=truth, progress=lambda _: None)
        assert done.folder is not None
        result, folder = score(done.folder, truth), RunFolder(done.folder)
        estimates = folder.estimates
        assert estimates is not None
        read = read_truth(truth)
        errors = angle_error_rad(estimates, read, scored_window(estimates, read, folder.settle_s))
        assert errors is not None
        figures = {
            "u_rad": result.angle_u_rad,
            "error_rad": float(errors[-1]),
            "error_rms_rad": result.angle_error_rms_rad,
            "verdict": result.verdict,
            "parts": {name: part.outcome for name, part in result.parts.items()},
            "budget": {row.source: row.contribution_rad for row in result.uncertainty},
        }
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_text(kept, json.dumps(figures, indent=1) + "\n")
    return figures


def rows(say: Say) -> list[Row]:
    """All devices with both settings."""
    figures = []
    devices = int(os.environ.get("GYROHIL_DEVICES", DEVICES))
    for setting in CONTROLLER:
        with ProcessPoolExecutor(PROCESSES) as pool:
            found = []
            for ran in pool.map(one, [setting] * devices, range(devices)):
                found.append(ran)
                if len(found) % 10 == 0:
                    say(f"{setting}: {len(found)} devices")
        figures += summary(setting, found)
    return figures


def summary(setting: str, found: list[dict[str, Any]]) -> list[Row]:
    """Rows of one setting."""
    u = np.array([ran["u_rad"] for ran in found])
    error = np.array([ran["error_rad"] for ran in found])
    rms = math.sqrt(float(np.mean(error**2)))
    good = np.array([ran["verdict"] == "good" for ran in found])
    return [
        Row(f"{setting}: devices", float(len(found)), "1"),
        Row(f"{setting}: errors within U (k = 2)", float(np.mean(np.abs(error) <= u)), "1"),
        Row(f"{setting}: largest error over its U", float(np.max(np.abs(error) / u)), "1"),
        Row(f"{setting}: U, rms", math.sqrt(float(np.mean(u**2))), "rad"),
        Row(f"{setting}: error at the end, rms", rms, "rad"),
        Row(f"{setting}: U over the rms error", math.sqrt(float(np.mean(u**2))) / rms, "1"),
        Row(f"{setting}: verdict good", float(np.mean(good)), "1"),
    ]
