"""How long traces take, with the whole catalogue, and the scan that closes every run.

Traces of a million samples, and of many kinds of records of a hundred thousand. For the figures that are promised:
`GYROHIL_WORKERS=2 python -m benchmarks trace_time`, two processors. TRACE_TIME_RECORDS is how many of the hundred
thousand, drawn as for `make undeclared`; TRACE_TIME_DRAW another draw.
"""

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.lockstep import ClosedLoop, bench_of, close_loop, scenario_of
from benchmarks.row import Row, Say
from device_emulator.scenario import load
from estimator.completeness.closing import Limits, closing_scan
from estimator.completeness.stretch import Stretch, stretches_of
from estimator.hold import drive_polynomials
from estimator.record import Record
from estimator.settings import ControllerSettings
from estimator.side_by_side import workers
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from evaluation.undeclared.population import Order, population
from evaluation.undeclared.record import make
from hil.bench import Bench
from hil.bench.examples import find
from hil.errors import InputError
from hil.inputs.declared import device_of, observer_settings_of
from hil.tracing.request import request_of
from hil.tracing.trace import trace as trace_file

SAMPLES, MINUTE_S = 1_000_000, 60.0
SHORT, HALF_A_MINUTE_S = 100_000, 30.0
RECORDS, DRAW = 24, 21
SCANNED = (("s-slow", 24.0, 1.0), ("s-modern-5k", 60.0, 10.0))
"""Example, seconds recorded, at most s."""
_RECORDED = 200_000  # samples of a longer run that are made: the scan looks at no more


def rows(say: Say) -> list[Row]:
    """Seconds of a clean record and of one with a cubic stiffness, of the many, and of closing scans."""
    figures = scans(say)
    for name in ("s-slow", "s-undeclared"):
        bench = bench_of(name)
        run = close_loop(load(find("scenario", name)), bench, SAMPLES, seed=1, every=1000)
        say(f"{name}: recorded")
        begin = time.perf_counter()
        found = [effect.name for effect in trace(problem_of(run, bench), split=SAMPLES * 6 // 10).effects]
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
            asked = request_of(place / "capture.arrow", place / "bench.toml", {"report": False})
            said: str = trace_file(asked, Path(folder) / "traces", progress=lambda _: None).diagnosis.verdict
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


def problem_of(run: ClosedLoop, bench: Bench) -> Problem:
    """The run's record by what its bench file declares."""
    tick, vx, vy, ux, uy, _ = run.capture.T
    codes = np.column_stack([vx, vy]) * float(run.observer.arrays.settings["sense_scale"][0, 0])
    sense = codes * [run.observer.scaling.sense(axis) for axis in range(2)]
    quantum = run.observer.drive_quantum
    drive = drive_polynomials(np.column_stack([ux, uy]) * quantum, "zoh")
    step = np.full(len(tick), 1.0 / run.sample_rate_Hz)
    return Problem(Record(sense, drive, step), device_of(bench), observer_settings_of(bench))


def scans(say: Say) -> list[Row]:
    """Seconds of processor and of wall time of the scan that closes a run; the peer is what it may take."""
    figures = []
    for name, seconds, allowed in SCANNED:
        bench, scenario = bench_of(name), scenario_of(name)
        samples = round(seconds * scenario.board.sample_rate_Hz)
        made = min(samples, _RECORDED)
        run = close_loop(scenario, bench, made, seed=1, every=bench.loop.estimate_every)
        say(f"{name}: {made} samples recorded")
        record = problem_of(run, bench).record
        controller = ControllerSettings(
            latency=scenario.drive.latency_samples, force_quantum=1.0, force_limit=1.0, sense_quantum=1.0,
            virtual_rotation=bench.controller.virtual_rotation_rad_s,
        )  # fmt: skip
        stretches = []
        for part in stretches_of(samples):
            begin = part.start * made // samples  # cost does not ask when the samples were taken
            at = slice(begin, begin + part.stop - part.start)
            stretches.append(Stretch(record.part(at), part.start / run.sample_rate_Hz, part.start == 0))
        took, busy = np.inf, np.inf
        for _ in range(3):  # the first has the caches to fill
            wall, processor = time.perf_counter(), time.process_time()
            found = closing_scan(
                stretches, device_of(bench), observer_settings_of(bench), controller,
                scored_s=(min(5.0, 0.2 * seconds), seconds), limits=Limits(0.1),
            )  # fmt: skip
            took, busy = min(took, time.perf_counter() - wall), min(busy, time.process_time() - processor)
        say(f"{name}: {found.outcome.value}, {found.reason}")
        figures.append(Row(f"closing scan, {name}, {seconds:g} s: wall time", took, "s", "allowed", took / allowed))
        figures.append(Row(f"closing scan, {name}, {seconds:g} s: processor", busy, "s", "allowed", busy / allowed))
    return figures
