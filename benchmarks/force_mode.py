"""Force mode in real time: S-slow at 4 kHz over a pty for 30 s, beside a process that only reads and writes.

Turnaround is taken at the board's end: from just before a sample is written to just after its answer was read, which
decides whether an answer is late.  The bare process answers frames of the same length on a pty of its own, scheduled
alike (SCHED_FIFO, locked memory), and has its turn every other second of the same run, under the same pacing loop
(`benchmarks.pacer`).  So whatever else the machine does, it does to both.

A sample is late when its answer has not been read when the next tick begins.  Samples of which only a newer one was
answered are late and have no turnaround.  The turnaround inside the host (received to sent) is from the run's record.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.lockstep import bench_of
from benchmarks.pacer import ANSWER_LENGTH
from benchmarks.row import Row, Say
from hil.bench import examples, override
from hil.progress import Progress
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from hil.scoring.score import score

DURATION_S = 30.0
SEGMENT_S = 1.0
SEED = 1
PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9"}
BARE = "bare read and write"


def rows(say: Say) -> list[Row]:
    """One run of the real host with the bare one in between."""
    with tempfile.TemporaryDirectory() as place:
        truth = Path(place) / "truth.arrow"
        figures, folder = measure(Path(place), truth, say)
        result = score(folder.path, truth)
    real, bare = figures["real"], figures["bare"]
    late, bare_late = (100.0 * figure["late"] / figure["samples"] for figure in (real, bare))
    table = [
        Row("late answers", late, "%", BARE, late / bare_late if bare_late else None),
        Row(f"late answers, {BARE}", bare_late, "%"),
        Row("late answers beyond those of the bare read and write", late - bare_late, "%"),
    ]
    for key, name in PERCENTILES.items():
        table.append(Row(f"turnaround {name}", real[key], "µs", BARE, real[key] / bare[key]))
        table.append(Row(f"turnaround {name}, {BARE}", bare[key], "µs"))
    assert result.turnaround_us is not None
    assert result.score is not None
    inside = result.turnaround_us.model_dump()
    table += [Row(f"inside the host {name}", inside[key], "µs") for key, name in PERCENTILES.items()]
    table += [
        Row("samples", real["samples"], "1"),
        Row("samples lost", result.lost, "1"),
        Row("armed again", result.counters["rearmed"], "1"),
    ]
    if result.angle_error_rms_rad is not None:
        table.append(Row("angle error, rms", result.angle_error_rms_rad, "rad"))
    if result.score.angle_per_rotation is not None:
        table.append(Row("angle per rotation", result.score.angle_per_rotation, "1"))
    return table


def measure(place: Path, truth: Path, say: Say) -> tuple[dict[str, dict[str, float]], RunFolder]:
    """What the pacer saw of both hosts, and what the real one recorded."""
    order = {
        "scenario": str(examples.find("scenario", "s-slow")),
        "seed": SEED,
        "truth": str(truth),
        "segment_s": SEGMENT_S,
    }
    bench = override(
        bench_of("s-slow"),
        {
            "loop": {"clock": "paced", "duration_s": DURATION_S, "settle_s": 8.0, "seed": SEED},
            "link": {"timeout_s": 10.0 * SEGMENT_S},
        },
        "benchmark",
    )
    with subprocess.Popen(
        [sys.executable, "-m", "benchmarks.pacer", json.dumps(order)], stdout=subprocess.PIPE
    ) as pacer:
        assert pacer.stdout is not None
        board, other = json.loads(pacer.stdout.readline())
        bare = subprocess.Popen([sys.executable, "-m", "benchmarks.bare", other, str(ANSWER_LENGTH)])
        quarter = 0

        def watch(progress: Progress) -> None:
            nonlocal quarter
            if progress.total and 4 * progress.done // progress.total > quarter:
                quarter = 4 * progress.done // progress.total
                say(f"{progress.done} of {progress.total} samples")

        try:
            folder = run(RunRequest(bench, f"serial:{board}"), place / "runs", progress=watch).folder
            figures: dict[str, dict[str, float]] = json.loads(pacer.stdout.readline())
        finally:
            pacer.terminate()
            bare.terminate()
            bare.wait()
    assert folder is not None
    return figures, RunFolder(folder)
