"""How long traces take, the whole catalogue watched and the kernels in their cache: of a million samples, and of many
kinds of records of a hundred thousand.

For the figures that are promised: `GYROHIL_WORKERS=2 python -m benchmarks trace_time`, two processors.
TRACE_TIME_RECORDS is how many of the hundred thousand, drawn as for `make undeclared`; TRACE_TIME_DRAW another draw.
"""

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.compensation import traced
from benchmarks.lockstep import bench_of, close_loop
from benchmarks.row import Row, Say
from device_emulator.scenario import load
from estimator.side_by_side import workers
from evaluation.undeclared.population import Order, population
from evaluation.undeclared.record import make
from hil.bench.examples import find
from hil.errors import InputError
from hil.tracing.request import request_of
from hil.tracing.trace import trace

SAMPLES, MINUTE_S = 1_000_000, 60.0
SHORT, HALF_A_MINUTE_S = 100_000, 30.0
RECORDS, DRAW = 24, 21


def rows(say: Say) -> list[Row]:
    """Seconds of a clean record and of one with a cubic stiffness, and of the many."""
    figures = []
    for name in ("s-slow", "s-undeclared"):
        bench = bench_of(name)
        run = close_loop(load(find("scenario", name)), bench, SAMPLES, seed=1, every=1000)
        say(f"{name}: recorded")
        begin = time.perf_counter()
        found = traced(run, bench)
        took = time.perf_counter() - begin
        say(f"{name}: {took:.1f} s, {', '.join(found) or 'nothing'}; {_around()}")
        figures.append(Row(f"trace of 1e6 samples, {name}", took, "s", "a minute", took / MINUTE_S))
    number = int(os.environ.get("TRACE_TIME_RECORDS", str(RECORDS)))
    took_each = [_of(order, say) for order in _orders(number)]
    late = float(np.percentile(took_each, 95))
    return [
        *figures,
        Row(f"trace of 1e5 samples, median of {number}", float(np.median(took_each)), "s"),
        Row(f"trace of 1e5 samples, 95 % of {number}", late, "s", "half a minute", late / HALF_A_MINUTE_S),
        Row(f"trace of 1e5 samples, longest of {number}", max(took_each), "s"),
    ]


def _of(order: Order, say: Say) -> float:
    with tempfile.TemporaryDirectory() as folder:
        place = make(order, Path(folder), SHORT)
        begin, spent = time.perf_counter(), time.process_time()
        try:
            request = request_of(place / "capture.arrow", place / "bench.toml", {"report": False})
            said: str = trace(request, Path(folder) / "traces", progress=lambda _: None).diagnosis.verdict
        except InputError as refusal:
            said = f"refused: {refusal}"
        took = time.perf_counter() - begin
    say(f"{order.name}: {took:.1f} s, {time.process_time() - spent:.1f} of a processor, {said}; {_around()}")
    return took


def _orders(number: int) -> list[Order]:
    """Of all categories and kinds."""
    return population(8 * number, int(os.environ.get("TRACE_TIME_DRAW", str(DRAW))))[::8][:number]


def _around() -> str:
    return f"{workers()} workers, load {os.getloadavg()[0]:.1f}"
