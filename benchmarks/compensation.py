"""Angle and rate error of a loop that does not know the effect its board has, and of the next run, after a trace.

Each effect of the catalogue once, at a size drawn from its physical range, under the reference excitation: a run in
lockstep by the data sheet alone, a trace of its record, the same run again with what the trace found in `[effects]`.
"""

import numpy as np

from benchmarks.lockstep import ClosedLoop, close_loop, rms
from benchmarks.row import Row, Say
from estimator.hold import drive_polynomials
from estimator.record import Record
from estimator.trace.problem import Problem
from estimator.trace.trace import trace
from evaluation.undeclared.effects import DRAWABLE
from evaluation.undeclared.population import Order
from evaluation.undeclared.record import draw_record
from hil.bench import Bench, override
from hil.inputs.declared import device_of, observer_settings_of

SAMPLES, FITTED, SETTLED = 60_000, 0.6, 0.3


def rows(say: Say) -> list[Row]:
    """Errors before and after of every effect that a board alone can show (those of the temperature need a channel)."""
    figures = []
    for name in DRAWABLE:
        if name.startswith("temperature"):
            continue
        order = Order("single", (name,), 0, draw=2)
        drawn = draw_record(order, SAMPLES)
        before = close_loop(drawn.scenario, drawn.bench, SAMPLES, seed=order.seed)
        found = traced(before, drawn.bench)
        bench = override(drawn.bench, {"effects": found}, name)
        after = close_loop(drawn.scenario, bench, SAMPLES, seed=order.seed) if found else before
        for what, unit, error in (("angle", "rad", angle_error), ("rate", "rad/s", rate_error)):
            figures.append(Row(f"{name}: {what} error rms before", error(before), unit))
            row = Row(f"{name}: {what} error rms after", error(after), unit, "before", error(after) / error(before))
            figures.append(row)
        say(
            f"{name}: found {', '.join(found) or 'nothing'}; angle {angle_error(before):.3g} → {angle_error(after):.3g}"
            f" rad, rate {rate_error(before):.3g} → {rate_error(after):.3g} rad/s"
        )
    return figures


def traced(run: ClosedLoop, bench: Bench) -> dict[str, dict[str, float]]:
    """Effects a trace of the run's record names, with coefficients and parameters as a bench file has them."""
    told = trace(problem_of(run, bench), split=int(FITTED * len(run.capture)))
    return {effect.name: {symbol: one.value for symbol, one in effect.coefficients.items()} for effect in told.effects}


def problem_of(run: ClosedLoop, bench: Bench) -> Problem:
    """The run's record by what its bench file declares."""
    tick, vx, vy, ux, uy, _ = run.capture.T
    codes = np.column_stack([vx, vy]) * float(run.observer.arrays.settings["sense_scale"][0, 0])
    sense = codes * [run.observer.scaling.sense(axis) for axis in range(2)]
    quantum = run.observer.drive_quantum
    drive = drive_polynomials(np.column_stack([ux, uy]) * quantum, "zoh")
    step = np.full(len(tick), 1.0 / run.sample_rate_Hz)
    return Problem(Record(sense, drive, step), device_of(bench), observer_settings_of(bench))


def angle_error(run: ClosedLoop) -> float:
    """Reported minus true angle, rms in rad, zero at the start of the scored window."""
    scored = run.tick >= SETTLED * run.tick[-1]
    error = (run.estimates["angle_rad"] - run.at("angle_rad"))[scored]
    return rms(error - error[0])


def rate_error(run: ClosedLoop) -> float:
    """Estimated minus true rate, rms in rad/s."""
    scored = run.tick >= SETTLED * run.tick[-1]
    return rms((run.estimates["rate_rad_s"] - run.at("rate_rad_s"))[scored])
