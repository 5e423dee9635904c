"""One run of a campaign, in this process: board and host in lockstep, judged against the truth; a row of figures."""

import hashlib
import math
import os
import socket
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hil.bench import Bench
from hil.bench.template import template, values_of
from hil.errors import InputError, machine_fault
from hil.records.atomic import write_sealed
from hil.records.result import Result, save_result
from hil.records.runfolder import RunFolder
from hil.records.truth import Truth, read_truth
from hil.scoring.nees import nees
from hil.scoring.score import (
    angle_error_rad,
    estimation_error_rad,
    rate_error_rad_s,
    score,
    scored_window,
)
from hil.sweeping.campaign import Each
from hil.sweeping.columns import AGAIN, STATES
from hil.sweeping.tasks import Done, Row, Task
from hil.wire.errors import WireError

if TYPE_CHECKING:
    from hil.records.estimates import Estimates
    from hil.running.request import RunRequest

_SIGMAS = 4.0  # of the deviation at the end, within which the rate counts as converged


def carry_out(task: Task) -> Done:
    """Do a task of `hil.sweeping.plan`; what a run may come to is in its row.

    Raises OSError where this machine, and not the run, is at fault.
    """
    began = time.perf_counter()
    if task.scratch is not None:
        Path(task.scratch).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"run-{task.run}-", dir=task.scratch) as place:
        try:
            row = _row(task, Path(place))
        except (ValueError, WireError) as error:  # the emulator's are ValueErrors, which nothing here may import
            if not type(error).__module__.startswith(("device_emulator", "estimator", "hil")):
                raise
            if fault := machine_fault(error):
                raise OSError(fault.errno, fault.strerror, task.scratch or tempfile.gettempdir()) from None
            row = {"outcome": "refused", "reason": str(error).replace(f"{place}/", "")}
    wall = {"seconds": round(time.perf_counter() - began, 3), "host": socket.gethostname(), "pid": os.getpid()}
    return Done(task.run, {name: _finite(value) for name, value in row.items()}, wall)


def _row(task: Task, place: Path) -> Row:
    bench = Bench.model_validate_json(task.what["bench"], strict=False)
    each = Each(**task.what["each"])
    scenario = place / "board.scenario.toml"
    scenario.write_text(task.what["scenario"], encoding="utf-8")
    if each.drawn_initial:
        from hil.sweeping.initial_values import with_drawn_initial_values

        bench = with_drawn_initial_values(bench, scenario, place)
    made = _made(bench, scenario, place / "run", task.what["run"], scan=each.scan)
    if made.truth is None:
        return made.row
    row = made.row
    if each.figures:
        row |= _sheet(made.run, each.figures)
    if each.bound:
        row |= _bound(made.run, made.truth, bench, task.what["scenario"])
    if each.trace:
        told, better = _traced(made.run, bench, place, task.what["trace"])
        row |= told
        if each.again and better is not None:
            again = _made(better, scenario, place / "again", task.what["run"], scan=False)
            row |= {f"again_{name}": again.row.get(name) for name in AGAIN}
    return row


class _Made(NamedTuple):
    """A run that was made: its folder, its truth where it could be scored, its figures."""

    run: RunFolder
    truth: Truth | None
    row: Row


def _made(declared: Bench, scenario: Path, folder: Path, options: Mapping[str, Any], *, scan: bool) -> _Made:
    """Run a bench on the board of `scenario`, with options of a run, and judge it."""
    from hil.running.process.worker import Order, untold, work
    from hil.running.request import request_of

    place, truth_file = folder.parent, _truth_beside(folder)
    asked: Any = {**options, "truth": truth_file}
    request = request_of(declared, asked, link=f"inproc:{scenario}")
    bench = request.bench
    folder.mkdir()
    write_sealed(folder / "bench.toml", template(values_of(bench), "The bench as run."))
    outcome = work(Order(request, str(folder)), untold, own_process=False)
    if ended := outcome["safety"]["recorder"]:
        raise OSError(ended)
    stopped = str(outcome["stopped"] or "").replace(f"{place}/", "")
    row: Row = {"outcome": "stopped" if stopped else "ran", "reason": stopped or None}
    run = RunFolder(folder)
    if run.capture is None or not len(run.capture):
        return _Made(run, None, row | {"samples": 0})
    row |= {"samples": len(run.capture), "record_sha256": digest_of(run.capture_path)}
    row |= _concluded(run, outcome, request, scan=scan)
    try:
        result = score(folder, truth_file)
    except InputError as error:
        return _Made(run, None, row | {"reason": row["reason"] or str(error).replace(f"{place}/", "")})
    truth = read_truth(truth_file)
    return _Made(run, truth, row | _scored(result) | _at_end(run, truth, bench))


def digest_of(capture: Path) -> str:
    with capture.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def _concluded(run: RunFolder, outcome: dict[str, Any], request: "RunRequest", *, scan: bool) -> Row:
    if not scan:
        from hil.records.summary import summarise

        save_result(run.result_path, summarise(run, outcome.get("counters", {})))
        return {}
    from hil.records.result import load_result
    from hil.running.concluding import Made, conclude

    made = Made(run.path, request.bench, outcome, replace(request, link="inproc:"))
    conclude(made, report=False, progress=lambda _: None)
    said = load_result(run.result_path)
    return {
        "verdict": said.verdict,
        "angle_u_rad": said.angle_u_rad,
        "angle_expanded_rad": said.angle_expanded_rad,
        "model_complete": None if said.scan is None else said.scan.complete,
    }


def _scored(result: Result) -> Row:
    found = result.score
    assert found is not None
    return {
        "angle_error_rms_rad": result.angle_error_rms_rad,
        "angle_error_max_rad": found.angle_error_max_rad,
        "angle_per_rotation": found.angle_per_rotation,
        "rate_error_rms_rad_s": result.rate_error_rms_rad_s,
        "rate_error_max_rad_s": found.rate_error_max_rad_s,
        "pattern_error_rms_rad": found.angle_estimation_error_rms_rad,
        "control_imperfection_rms_rad": found.control_imperfection_rms_rad,
        "innovation_ratio": result.residual_ratio,
        "nees": None if found.nees is None else found.nees.mean,
        "nees_entries": None if found.nees is None else found.nees.entries,
        "coverage": sum(found.coverage.values()) / len(found.coverage) if found.coverage else None,
    }


@np.errstate(all="ignore")
def _at_end(run: RunFolder, truth: Truth, bench: Bench) -> Row:
    """Errors at the last instant, and when the rate had converged."""
    estimates = run.estimates
    assert estimates is not None
    window = scored_window(estimates, truth, run.scored_from_s)
    row: Row = {}
    for name, errors in (
        ("angle_error_end_rad", angle_error_rad(estimates, truth, window)),
        ("pattern_error_end_rad", estimation_error_rad(estimates, truth, window)),
    ):
        if errors is not None and errors.size:
            row[name] = float(errors[-1])
    last, true = int(window.estimated[-1]), int(window.true[-1])
    for name in STATES:
        if name in estimates and (name in truth.constants or name in truth.columns):
            value = truth.constants[name] if name in truth.constants else float(truth[name][true])
            row[f"error_{name}"] = float(estimates[name][last]) - value
            row[f"sd_{name}"] = float(estimates.sd(name)[last])
    covariance = run.covariance
    if covariance is not None and len(covariance):
        at_end = nees(covariance, estimates, truth, float(covariance.tick[-1]) / estimates.tick_rate_Hz)
        row["nees_end"] = None if at_end is None else at_end.mean
    row["converged_s"] = _converged_s(estimates, truth)
    if bench.device.axes == 2:
        from hil.sweeping.turn import over_a_turn

        turn = over_a_turn(estimates, truth, window, bench.target_stiffness_per_s2)
        row["turn_bias_mean_rad_s"] = None if turn is None else turn.mean
        row["turn_bias_span_rad_s"] = None if turn is None else turn.span
    return row


def _converged_s(estimates: "Estimates", truth: Truth) -> float | None:
    """See the column of that name; over the whole record, not the scored window."""
    whole = scored_window(estimates, truth, 0.0)
    error = rate_error_rad_s(estimates, truth, whole)
    if error is None or not error.size:
        return None
    limit = _SIGMAS * float(estimates.sd("rate_rad_s")[whole.estimated[-1]])
    beyond = np.flatnonzero(~(np.abs(error) <= limit))
    if not beyond.size:
        return float(whole.t_s[0])
    return float(whole.t_s[beyond[-1] + 1]) if beyond[-1] + 1 < error.size else None


def _bound(run: RunFolder, truth: Truth, bench: Bench, scenario: str) -> Row:
    from hil.sweeping.bound import least_deviation

    hidden = tomllib.loads(scenario).get("effect", [])
    coefficients = {symbol: float(value) for one in hidden for symbol, value in one.items() if symbol != "name"}
    return least_deviation(run, truth, bench, coefficients)


def _sheet(run: RunFolder, figures: Sequence[str]) -> Row:
    """Those figures of a data sheet; none of a figure that the run does not tell."""
    from hil.bench.data_sheet import BY_NAME
    from hil.characterising.figures import figures_of
    from hil.characterising.source import axes_of

    try:
        found = figures_of(axes_of(run.path, None, _truth_beside(run.path))).found
    except InputError:
        return {}
    return {BY_NAME[name].key: found[name].value for name in figures if name in found}


def _truth_beside(folder: Path) -> Path:
    """Where the board of a run writes its truth."""
    return folder.with_name(f"{folder.name}-truth.arrow")


def _traced(run: RunFolder, bench: Bench, place: Path, options: Mapping[str, Any]) -> tuple[Row, Bench | None]:
    """What a trace says, and the bench with what it explained."""
    from hil.tracing.addition import additions
    from hil.tracing.request import request_of
    from hil.tracing.trace import trace

    try:
        asked: Any = {"report": False, "missing_force": False, **options}
        request = request_of(run.capture_path, run.bench_path, asked)
        done = trace(request, place / "traces", progress=lambda _: None)
    except InputError as refusal:
        return {"traced": f"refused: {refusal}".replace(f"{place}/", "")}, None
    said = done.diagnosis
    found = {one.name: {name: value for name, (value, _) in one.coefficients.items()} for one in additions(said)}
    row = {"traced": said.verdict, "traced_effects": "+".join(effect.name for effect in said.effects)}
    return row, bench.with_(effects=found) if found else None


def _finite(value: Any) -> Any:
    """A plain Python value; what is not finite is none."""
    if isinstance(value, bool | str) or value is None:
        return value
    if isinstance(value, np.integer | int):
        return int(value)
    if isinstance(value, np.bool_):
        return bool(value)
    return float(value) if math.isfinite(value) else None
