"""Campaigns: killed ten times and gone on with, by one worker, two and four, and on a Dask cluster.

The campaign is that of S-slow over noise and stiffness, 2 s at 4 kHz each.  Killed: `kill -9` of `hil sweep` at a
random moment, ten times, then to the end; its Parquet files are compared byte by byte with those of an undisturbed
campaign of one worker.  Throughput: rows from the first to the last, so that imports and the loading of kernels, which
are once for each worker, are not in it; beside it the whole time.  Numbers of workers are measured by turns.  Cluster:
a scheduler and two workers on loopback; the processor time of the scheduler for a task as large that takes no time.
"""

import json
import os
import random
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import hil
from benchmarks.row import Row, Say
from hil.sweeping.campaign import Campaign
from hil.sweeping.plan import plan_of, toml_of
from hil.toml.reading import parse_table

KILLS = 10
TURNS = 3
WORKERS = (1, 2, 4)
RUNS_EACH = 12
"""Runs for each worker of a turn, so that a turn of any number of them takes as long."""
TASKS = 2000
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


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


@contextmanager
def cluster(place: Path) -> Iterator[tuple[str, int]]:
    """Address and process number of a scheduler with two workers of one thread."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port = str(listening.getsockname()[1])
    address = f"tcp://127.0.0.1:{port}"
    commands = [["scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"]] + [
        [
            "worker",
            address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--no-dashboard",
            "--local-directory",
            str(place / f"w{k}"),
        ]
        for k in range(2)
    ]
    with (place / "dask.log").open("wb") as log:
        processes = [subprocess.Popen([sys.executable, "-m", "dask", *one], stdout=log, stderr=log) for one in commands]
    try:
        yield address, processes[0].pid
    finally:
        for process in processes:
            process.terminate()
            process.wait()


def processor_s(pid: int) -> float:
    """Time on a processor of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * TICK_S


def rows(say: Say) -> list[Row]:
    """All of it."""
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        figures = []
        kills, wrong, differ = killed(place, say)
        figures += [
            Row("kill -9 of the campaign, times", kills, "1"),
            Row("runs lost or doubled by that", wrong, "1"),
            Row("Parquet files that differ from those of an undisturbed campaign", differ, "1"),
        ]
        folder = place / "alone"
        size = sum(map(len, results(folder).values())) / 64
        figures.append(Row("size of the results, Parquet, 8 rows a file", size, "B/run"))
        figures += throughput(place, say)
        figures += on_a_cluster(place, say)
        big = hil.sweep(table(64, rows_per_file=256, name="big"), out=place / "big", workers=4)
        figures.append(
            Row("size of the results, Parquet, 256 rows a file", len(results(big.path).popitem()[1]) / 256, "B/run")
        )
        figures.append(Row("size of wall.jsonl", (big.path / "wall.jsonl").stat().st_size / 256, "B/run"))
    return figures


def throughput(place: Path, say: Say) -> list[Row]:
    """Runs per second against workers, by turns, and the exponent."""
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
    many, rates = np.log([[workers, statistics.median(steady[workers])] for workers in WORKERS]).T
    return [*found, Row("throughput ~ workers to the power of", float(np.polyfit(many, rates, 1)[0]), "1")]


def scheduler_of_a_task(address: str, scheduler: int, size: int) -> float:
    """Processor time of the scheduler for a task of that size that takes no time itself, answered alike, seconds."""
    from distributed import Client, as_completed

    with Client(address) as client:

        def hand_out(count: int) -> None:
            window = [client.submit(str.upper, "x" * size, pure=False) for _ in range(8)]
            waiting = as_completed(window, with_results=True)
            for done, _ in enumerate(waiting, 1):
                if done + 8 <= count:
                    waiting.add(client.submit(str.upper, "x" * size, pure=False))

        hand_out(100)
        before = processor_s(scheduler)
        hand_out(TASKS)
        return (processor_s(scheduler) - before) / TASKS


def on_a_cluster(place: Path, say: Say) -> list[Row]:
    """The same bytes on a cluster; what a run costs its scheduler, and what is sent."""
    campaign = table(16)
    plan = plan_of(parse_table(campaign, Campaign, "cost"), "cost")
    sent = len(plan.task(0).as_json())
    with cluster(place) as (address, scheduler):
        hil.sweep(table(4, name="warm"), out=place / "warm", scheduler=address)
        before = processor_s(scheduler)
        began = time.monotonic()
        swept = hil.sweep(campaign, out=place / "cluster", scheduler=address)
        say(f"cluster: {time.monotonic() - began:.1f} s, of the scheduler {processor_s(scheduler) - before:.2f} s")
        spent = scheduler_of_a_task(address, scheduler, sent)
    ours, theirs = results(swept.path), results(place / "alone")
    differ = sum(ours.get(name) != theirs[name] for name in theirs)
    answered = statistics.mean(len(json.dumps(row)) for row in swept.table.to_pylist())
    return [
        Row("on a cluster of 2 workers: Parquet files that differ", differ, "1"),
        Row("on a cluster: time of the scheduler on a processor", spent, "s/run"),
        Row("on a cluster: task as sent", sent, "B/run"),
        Row("on a cluster: row as sent back", answered, "B/run"),
    ]
