"""Campaigns: killed ten times and gone on with, and by one worker, two and four.

The campaign is that of S-slow over noise and stiffness, 2 s at 4 kHz each.  Killed: `kill -9` of `hil sweep` at a
random moment, ten times, then to the end; its Parquet files are compared byte by byte with those of an undisturbed
campaign of one worker.  Throughput: rows from the first to the last, so that imports and the loading of kernels, which
are once for each worker, are not in it; beside it the whole time.  Numbers of workers are measured by turns.
"""

import json
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import hil
from benchmarks.row import Row, Say
from hil.sweeping.plan import toml_of

KILLS = 10
TURNS = 3
WORKERS = (1, 2, 4)
RUNS_EACH = 12
"""Runs for each worker of a turn, so that a turn of any number of them takes as long."""


def table(seeds: int, **changes: Any) -> dict[str, Any]:
    """The campaign with 4 points and so many seeds."""
    fixed = {
        "scenario.rate": {"kind": "constant", "rate_rad_s": 1.0},
        "bench.loop.duration_s": 2.0,
        "bench.loop.settle_s": 0.5,
    }
    vary = [
        {"key": "scenario.sense.noise_V", "also": ["bench.device.sense.noise_V"], "values": [9e-5, 9e-4]},
        {
            "key": "scenario.truth.stiffness_N_per_m[0]", "name": "kxx", "low": 0.99, "high": 1.01, "levels": 2,
            "relative": True,
        },
    ]  # fmt: skip
    told = {"name": "cost", "scenario": "s-slow", "bench": "s-slow", "seeds": seeds, "rows_per_file": 8}
    return told | {"fixed": fixed, "vary": vary} | changes


def results(folder: Path) -> dict[str, bytes]:
    """Files of the results by name."""
    return {str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.glob("results/*/*.parquet"))}


def killed(place: Path, say: Say) -> tuple[int, int, int]:
    """Kills, runs whose row came twice or never, and files that differ from those of an undisturbed campaign."""
    campaign = table(16)
    alone = hil.sweep(campaign, out=place / "alone", workers=1)
    say(f"undisturbed: {len(alone.table)} runs")
    (place / "cost.campaign.toml").write_text(toml_of(campaign, "Killed and gone on with."))
    folder, kills, generator = place / "killed", 0, random.Random(14)
    while kills < KILLS:
        process = sweep_process(place, folder, "2")
        before = rows_in(folder)
        until = time.monotonic() + 120.0
        while rows_in(folder) <= before and process.poll() is None and time.monotonic() < until:
            time.sleep(0.02)
        time.sleep(generator.uniform(0.0, 1.0))
        if process.poll() is not None:
            raise RuntimeError("the campaign was over before it was killed often enough")
        process.send_signal(signal.SIGKILL)
        process.wait()
        kills += 1
        say(f"kill {kills}: {rows_in(folder)} of 64 runs by then")
    if sweep_process(place, folder, "2").wait():
        raise RuntimeError("the campaign did not end well")
    runs = [json.loads(line)["run"] for line in (folder / "wall.jsonl").read_text().splitlines()]
    # A run that was done and whose line was not yet written is made again, which is no row more.
    ours, theirs = results(folder), results(place / "alone")
    wrong = len(set(range(64)) - set(runs)) + abs(len(hil.sweep(campaign, out=folder).table) - 64)
    return kills, wrong, sum(ours.get(name) != theirs[name] for name in theirs) + len(set(ours) - set(theirs))


def sweep_process(place: Path, folder: Path, workers: str) -> "subprocess.Popen[bytes]":
    """`hil sweep` of the campaign file there."""
    command = ["sweep", str(place / "cost.campaign.toml"), "--out", str(folder), "--workers", workers]
    return subprocess.Popen(
        [sys.executable, "-m", "hil", *command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def rows_in(folder: Path) -> int:
    """Runs that have been done there."""
    wall = folder / "wall.jsonl"
    return wall.read_text().count("\n") if wall.exists() else 0


def pace(folder: Path, campaign: dict[str, Any], **how: Any) -> tuple[float, float]:
    """Runs per second from the first row to the last, and over all of the time."""
    ends: list[float] = []
    began = time.monotonic()
    hil.sweep(
        campaign, out=folder, progress=lambda progress: ends.append(time.monotonic()) if progress.done else None, **how
    )
    # The first rows of the workers come at once: those are left out.
    first = int(how.get("workers") or 2)
    return (len(ends) - first) / (ends[-1] - ends[first - 1]), len(ends) / (ends[-1] - began)


def rows(say: Say) -> list[Row]:
    """Kills, then throughput."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        kills, wrong, differ = killed(place, say)
        return [
            Row("kill -9 of the campaign, times", kills, "1"),
            Row("runs lost or doubled by that", wrong, "1"),
            Row("Parquet files that differ from those of an undisturbed campaign", differ, "1"),
            *throughput(place, say),
        ]


def throughput(place: Path, say: Say) -> list[Row]:
    """Runs per second against workers, by turns."""
    steady: dict[int, list[float]] = {workers: [] for workers in WORKERS}
    whole: dict[int, list[float]] = {workers: [] for workers in WORKERS}
    for turn in range(TURNS):
        for workers in WORKERS:
            folder = place / f"pace-{turn}-{workers}"
            a, b = pace(folder, table(RUNS_EACH * workers // 4 + 1), workers=workers)
            steady[workers].append(a)
            whole[workers].append(b)
            shutil.rmtree(folder)
            say(f"turn {turn}, {workers} workers: {a:.2f} runs/s")
    found = []
    for workers in WORKERS:
        ratios = [ours / one for ours, one in zip(steady[workers], steady[1], strict=True)]
        ratio = statistics.median(ratios)
        found.append(
            Row(f"throughput, {workers} workers", statistics.median(steady[workers]), "runs/s", "1 worker", ratio)
        )
        found.append(Row(f"throughput, {workers} workers, least ratio of {TURNS} turns", min(ratios), "1"))
        found.append(Row(f"throughput, {workers} workers, with the start", statistics.median(whole[workers]), "runs/s"))
    return found
