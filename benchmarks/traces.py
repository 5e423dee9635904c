"""How long a trace of 100,000 samples takes, beside one pass of the observer over them, in the same run.

A trace tries the whole catalogue, so it is so many passes' worth.  Both by the clock on the wall, in turn, round after
round: a trace uses as many processors as it may have, a pass one.
"""

import os
import statistics
import time
from collections.abc import Callable

import numpy as np

from benchmarks.compensation import traced
from benchmarks.lockstep import ClosedLoop, bench_of, close_loop
from benchmarks.row import Row, Say
from device_emulator.scenario import load
from estimator.observer import Observer
from estimator.side_by_side import workers
from hil.bench import Bench
from hil.bench.examples import find
from hil.inputs.declared import device_of, observer_settings_of

SAMPLES, ROUNDS = 100_000, 3
BLOCK = 250
RECORDS = ("s-slow", "s-undeclared")


def rows(say: Say) -> list[Row]:
    """A record that the model explains, and one that lacks a cubic stiffness."""
    figures = []
    for name in RECORDS:
        bench = bench_of(name)
        run = close_loop(load(find("scenario", name)), bench, SAMPLES, seed=1, every=1000)
        times: tuple[list[float], list[float]] = ([], [])
        found: list[str] = []
        for round_ in range(ROUNDS + 1):
            found = []
            took = _timed(lambda run=run, bench=bench, found=found: found.extend(traced(run, bench)))
            passed = _timed(lambda run=run, bench=bench: _pass(run, bench))
            if round_:  # the first warms up
                times[0].append(took)
                times[1].append(passed)
        what = " and ".join(found) or "nothing"
        say(f"{name}: found {what}; {workers()} workers, load {os.getloadavg()[0]:.1f}")
        figures.append(
            Row.over(
                f"trace of {SAMPLES:,} samples, {name}", statistics.median(times[0]), "s", "pass of the observer",
                np.array(times[0]) / np.array(times[1]),
            )
        )  # fmt: skip
    return figures


def _timed(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun


def _pass(run: ClosedLoop, bench: Bench) -> None:
    observer = Observer(device_of(bench), observer_settings_of(bench))
    sense = np.asarray(run.capture[:, 1:3] * run.observer.sense_quantum, dtype=float)
    drive = np.asarray(run.capture[:, 3:5] * run.observer.drive_quantum, dtype=float)
    for first in range(0, len(sense), BLOCK):
        part = slice(first, first + BLOCK)
        observer.run(sense[part], drive[part], every=BLOCK)
