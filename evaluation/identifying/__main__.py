"""Emulated boards drawn at random, each identified, and run from the file alone: `python -m evaluation.identifying`."""

import argparse
import json
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from estimator.identify.model import NAMES
from evaluation.identifying.boards import draw, written
from hil.bench import load_bench
from hil.errors import InputError
from hil.identifying.identify import identify
from hil.identifying.request import request_of
from hil.progress import untold
from hil.running.concluding import Made, conclude
from hil.running.options import LocalRunOptions
from hil.running.process.worker import Order, work
from hil.running.process.worker import untold as untold_lines
from hil.running.request import RunRequest
from hil.running.request import request_of as run_request
from hil.running.run import RunResult, new_folder
from hil.scoring.score import score
from hil.wire.errors import WireError

_INTERVAL = 1.96


def here(request: RunRequest, out: Path, *, progress: object = None) -> RunResult:
    """As `hil.running.run.run`, in lockstep and in this process: no time goes into starting others."""
    _warm()
    folder = new_folder(out, request.bench)
    outcome = work(Order(request, str(folder)), tell=untold_lines, own_process=False)
    if request.judged:
        conclude(Made(folder, request.bench, outcome, request), report=False, progress=untold)
    return RunResult(folder, outcome["identity"], outcome)


@cache
def _warm() -> None:
    """A run without a plug-in, whose process is looked at for how much it grows: what is loaded once is loaded then."""
    with tempfile.TemporaryDirectory() as place:
        request = run_request("s-slow", {"duration_s": 8.5, "clock": "lockstep"}, link="inproc:s-slow")
        folder = new_folder(Path(place), request.bench)
        work(Order(request, str(folder)), tell=untold_lines, own_process=False)


def of_board(seed: int, folder: Path, *, run: bool) -> dict[str, Any]:
    """What came of one: z of each key, latency, and the verdict of a run from the file alone."""
    drawn = draw(seed)
    link = f"inproc:{written(drawn, folder, str(seed))}"
    mass = float(drawn.text.split("mass_kg = ")[1].split()[0])
    out = folder / f"{seed}.bench.toml"
    told: dict[str, Any] = {"seed": seed, "snr_dB": drawn.snr_dB}
    begun = time.process_time()
    try:
        asked = request_of(link, out, {"mass_kg": mass, "name": f"board-{seed}"})
        done = identify(asked, folder, untold, run=here, report=False)
    except (InputError, WireError) as error:
        return told | {"refused": str(error)}
    found = done.findings
    z = {name: (found.value(name) - drawn.truth[name]) / found.u(name) for name in NAMES}
    told |= {
        "z": z, "latency": found.latency_ticks, "latency_true": drawn.latency, "faults": found.faults,
        "remarks": found.remarks, "force": found.force_mps2_per_rtHz, "cpu_s": time.process_time() - begun,
        "error": {name: abs(found.value(name) - drawn.truth[name]) for name in NAMES},
    }  # fmt: skip
    if run and done.bench is not None:
        truth = folder / f"{seed}.truth.arrow"
        try:
            options = LocalRunOptions(clock="lockstep", truth=truth, replace=True)
            ran = here(run_request(load_bench(done.bench), options, link=link), folder)
            assert ran.folder is not None
            result = score(ran.folder, truth)
            told |= {"verdict": result.verdict, "reasons": list(result.reasons), "U": result.angle_expanded_rad}
            told |= {"score": None if result.score is None else result.score.model_dump(mode="json")}
        except (InputError, WireError) as error:
            told |= {"verdict": "refused", "reasons": [str(error)]}
        truth.unlink(missing_ok=True)
    return told


def main() -> None:
    """Print a line per board and the sums, and keep all of it as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--draw", type=int, default=1000)
    parser.add_argument("--boards", type=int, default=60)
    parser.add_argument("--no-run", action="store_true")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    rows = []
    for seed in range(asked.draw, asked.draw + asked.boards):
        with tempfile.TemporaryDirectory() as place:
            rows.append(of_board(seed, Path(place), run=not asked.no_run))
        row = rows[-1]
        worst = max(row.get("z", {"-": 0.0}).items(), key=lambda one: abs(one[1]))
        print(
            seed, f"{row['snr_dB']:.0f} dB", row.get("refused", ""), f"worst {worst[0]} {worst[1]:.1f}",
            f"latency {row.get('latency')} of {row.get('latency_true')}", row.get("faults", ""),
            row.get("verdict", "-"), row.get("reasons", ""), flush=True,
        )  # fmt: skip
        if asked.json is not None:
            asked.json.write_text(json.dumps(rows, indent=1))
    there = [row for row in rows if "z" in row]
    z = np.abs([value for row in there for value in row["z"].values()])
    print(
        f"{len(there)} of {len(rows)} identified; {np.sum(z < _INTERVAL)} of {z.size} keys in their 95 % interval "
        f"({100.0 * np.mean(z < _INTERVAL):.1f} %)"
    )
    print(f"latency right: {sum(row['latency'] == row['latency_true'] for row in there)} of {len(rows)}")
    print(f"runs good: {sum(row.get('verdict') == 'good' for row in rows)} of {len(rows)}")


if __name__ == "__main__":
    main()
