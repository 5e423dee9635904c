"""A model's predictions over the whole record as the bench would make them: the part that was fitted, then the rest."""

from dataclasses import dataclass, replace

import numpy as np

from estimator.diagnosis import Finding, Fit
from estimator.errors import DivergedError
from estimator.observer import Estimates, Observer
from estimator.record import Record
from estimator.residual.analysis import analyse
from estimator.scaling import Array
from estimator.side_by_side import together
from estimator.trace.observed import run
from estimator.trace.prediction import free_run_error
from estimator.trace.problem import Problem
from estimator.trace.start import settled_from

STATES, STATES_A_CYCLE = 200_000, 4.0
"""Samples up to which every state is kept; beyond, so many a cycle, which tell the phase of the motion."""


@dataclass(frozen=True)
class Figures:
    """How well a model predicts the part that was fitted and the rest, what the residual of the first still holds, and
    the residual of all (n, axes), V.
    """

    fitted: Fit
    held_out: Fit
    findings: tuple[Finding, ...]
    residual: Array


@dataclass(frozen=True)
class Examination(Figures):
    """... with the estimates behind (n samples), the rows of the first part once the observer has settled, and what was
    examined.
    """

    estimates: Estimates
    settled: slice
    problem: Problem


def examine(problem: Problem, split: int) -> Examination:
    """Run the observer as the bench has it over the record, its effects with coefficients that stay as given.

    Raises DivergedError where it does not follow the part that was fitted, or the rest, at all.
    """
    record, device, settings = problem.record, problem.device, problem.settings
    observer = Observer(device, settings, problem.controller)
    observer.hold_coefficients()
    cycle = 2.0 * np.pi / np.sqrt(device.target) / float(np.mean(record.step))
    every = 1 if len(record) <= STATES else max(int(cycle / STATES_A_CYCLE), 1)
    split = split // every * every
    estimates, alone = together(lambda: run(observer, record, every=every), lambda: free_run_error(problem, split))
    resonance = float(np.sqrt(device.target)) / (2.0 * np.pi)
    settled = settled_from(settings, device, split) // every * every
    begin, end = slice(settled, split), slice(split, len(record) // every * every)
    parts = []
    for rows in (begin, end):
        innovation, deviation = estimates.innovation[rows], estimates.innovation_deviation[rows]
        if not np.any(np.all(np.isfinite(innovation), axis=1)):
            raise DivergedError
        parts.append(analyse(innovation, deviation, record.part(rows), resonance))
    (fitted, findings), (held_out, _) = parts
    fitted, held_out = (
        replace(fit, simulation_rmse=float(np.sqrt(np.nanmean(error**2))) if np.any(np.isfinite(error)) else None)
        for fit, error in ((fitted, alone[:split]), (held_out, alone[split:]))
    )
    return Examination(
        scored(fitted, record, estimates, begin, every),
        scored(held_out, record, estimates, end, every),
        findings,
        estimates.innovation,
        estimates,
        begin,
        problem,
    )


def scored(fit: Fit, record: Record, estimates: Estimates, rows: slice, every: int) -> Fit:
    """`fit` with the errors of rate and angle where the record has a reference for the rate.

    Of a gyro only what its own bias, scale and delay do not account for is an error.
    """
    reference = record.reference
    if reference is None or "rate" not in estimates.names:
        return fit
    states = slice(rows.start // every, rows.stop // every)
    index = estimates.index[states]
    rate_error = estimates.of("rate")[states] - reference[index]
    turned: Array = np.cumsum(reference * record.step)
    angle_error = estimates.angle[rows] - turned[rows]
    if "rate" not in record.channels:
        rate_error = _left(rate_error, reference[index])
        angle_error = _left(angle_error, record.time[rows], turned[rows], reference[rows])
    return replace(
        fit,
        rate_error_rms=float(np.sqrt(np.nanmean(rate_error**2))),
        angle_error_rms=float(np.nanstd(angle_error)),
    )


def _left(error: Array, *columns: Array) -> Array:
    """What a constant and these columns (n,) do not account for (n,)."""
    matrix = np.column_stack([np.ones(len(error)), *columns])
    there = np.isfinite(error)
    return np.asarray(error - matrix @ np.linalg.lstsq(matrix[there], error[there], rcond=None)[0])
