"""How long a trace of a million samples takes, the whole catalogue watched and the kernels in their cache."""

import time

from benchmarks.compensation import traced
from benchmarks.lockstep import bench_of, close_loop
from benchmarks.row import Row, Say
from device_emulator.scenario import load
from hil.examples import find

SAMPLES, MINUTE_S = 1_000_000, 60.0


def rows(say: Say) -> list[Row]:
    """Seconds of a clean record and of one with a cubic stiffness."""
    figures = []
    for name in ("s-slow", "s-undeclared"):
        bench = bench_of(name)
        run = close_loop(load(find("scenario", name)), bench, SAMPLES, seed=1, every=1000)
        say(f"{name}: recorded")
        begin = time.perf_counter()
        found = traced(run, bench)
        took = time.perf_counter() - begin
        say(f"{name}: {took:.1f} s, {', '.join(found) or 'nothing'}")
        figures.append(Row(f"trace of 1e6 samples, {name}", took, "s", "a minute", took / MINUTE_S))
    return figures
