"""A model's predictions over the whole record as the bench would make them: the part that was fitted, then the rest."""

from dataclasses import dataclass, replace

import numpy as np

from estimator.diagnosis import Finding, Fit, Residual
from estimator.errors import DivergedError
from estimator.observer import Estimates, Observer
from estimator.record import Record
from estimator.residual.analysis import analyse
from estimator.scaling import Array
from estimator.side_by_side import together
from estimator.thresholds import THRESHOLDS
from estimator.trace.observed import run
from estimator.trace.prediction import free_run_error
from estimator.trace.problem import Problem
from estimator.trace.start import settled_from

_SET = THRESHOLDS.scoring


@dataclass(frozen=True)
class Examination:
    """Fit of the part up to the split and of the rest, what the residual of the first part still holds, the residual
    of all of it, the estimates behind (n samples), and the rows of the first part once the observer has settled.
    """

    fitted: Fit
    held_out: Fit
    findings: tuple[Finding, ...]
    residual: Residual
    estimates: Estimates
    settled: slice


def examine(problem: Problem, split: int) -> Examination:
    """Run the observer as the bench has it over the record, its effects with coefficients that stay as given.

    Raises DivergedError where it does not follow the part that was fitted, or the rest, at all.
    """
    record, device, settings = problem.record, problem.device, problem.settings
    observer = Observer(device, settings, problem.controller)
    observer.hold_coefficients()
    cycle = 2.0 * np.pi / np.sqrt(device.target) / float(np.mean(record.step))
    every = 1 if len(record) <= _SET.states else max(int(cycle / _SET.states_a_cycle), 1)
    split = split // every * every
    estimates, alone = together(lambda: run(observer, record, every=every), lambda: free_run_error(problem, split))
    resonance = float(np.sqrt(device.target)) / (2.0 * np.pi)
    settled = settled_from(settings, device, split) // every * every
    begin, end = slice(settled, split), slice(split, len(record) // every * every)
    parts = []
    for rows in (begin, end):
        if not np.any(np.all(np.isfinite(estimates.innovation[rows]), axis=1)):
            raise DivergedError
        part = part_of(estimates, rows, every)
        parts.append(analyse(part.innovation, part.innovation_deviation, part, record.part(rows), resonance))
    (fitted, findings, _), (held_out, _, _) = parts
    whole = analyse_spectrum(estimates, parts)
    fitted, held_out = (
        replace(fit, simulation_rmse=float(np.sqrt(np.nanmean(error**2))) if np.any(np.isfinite(error)) else None)
        for fit, error in ((fitted, alone[:split]), (held_out, alone[split:]))
    )
    return Examination(
        scored(fitted, record, estimates, begin, every),
        scored(held_out, record, estimates, end, every),
        findings,
        whole,
        estimates,
        begin,
    )


def part_of(estimates: Estimates, rows: slice, every: int) -> Estimates:
    """The estimates of the samples of `rows`, which begin and end on whole strides."""
    states = slice(rows.start // every, rows.stop // every)
    index = np.arange(every - 1, rows.stop - rows.start, every)
    fields = {
        name: getattr(estimates, name)[rows]
        for name in (
            "innovation",
            "innovation_deviation",
            "angle",
            "angle_pattern",
            "angle_plain",
            "angle_rate_integral",
            "energy_ratio",
            "quadrature_ratio",
        )
    }
    return replace(
        estimates, index=index, state=estimates.state[states], deviation=estimates.deviation[states], **fields
    )


def analyse_spectrum(estimates: Estimates, parts: list[tuple[Fit, tuple[Finding, ...], Residual]]) -> Residual:
    """Innovation of the whole record with the spectrum of the fitted part."""
    return Residual(estimates.innovation, parts[0][2].frequency, parts[0][2].density)


def scored(fit: Fit, record: Record, estimates: Estimates, rows: slice, every: int) -> Fit:
    """`fit` with the errors of rate and angle where the record has a reference for the rate."""
    reference = record.channels.get("rate")
    if reference is None or "rate" not in estimates.names:
        return fit
    states = slice(rows.start // every, rows.stop // every)
    index = estimates.index[states]
    rate_error = estimates.of("rate")[states] - reference[index]
    turned: Array = np.cumsum(reference * record.step)
    angle_error = estimates.angle[rows] - turned[rows]
    return replace(
        fit,
        rate_error_rms=float(np.sqrt(np.nanmean(rate_error**2))),
        angle_error_rms=float(np.nanstd(angle_error)),
    )
