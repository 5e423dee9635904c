"""Whether a run kept the limits of its bench file."""

from typing import Literal

import numpy as np

from hil.bench import Bench
from hil.records.result import Result
from hil.records.runfolder import RunFolder

Outcome = Literal["good", "failed", "interrupted"]


def judge(folder: RunFolder, result: Result, bench: Bench, stopped: str = "") -> tuple[Outcome, list[str]]:
    """(verdict, one line per limit that was not kept), over the scored window.

    `stopped` says why the run ended early, if it did.  Limits without a record to hold against them are not
    judged.
    """
    limits = bench.limits
    reasons = [stopped] if stopped else []
    if result.innovation_rms is not None and result.noise_floor:
        ratio = result.innovation_rms / result.noise_floor
        if ratio > limits.innovation_ratio:
            reasons.append(
                f"innovation {ratio:.3g} × the noise floor, [limits] innovation_ratio is "
                f"{limits.innovation_ratio:g}: the model lacks something"
            )
    elif folder.innovation is not None and (folder.innovation.t_s >= bench.loop.settle_s).any():
        reasons.append("the innovation is not finite: the observer diverged; check the signs and gains in [device]")
    late = result.late / result.samples if result.samples else 0.0
    if late > limits.late_fraction:
        reasons.append(f"{late:.2%} of the answers late, [limits] late_fraction is {limits.late_fraction:.2%}")
    reasons += _pattern(folder, bench)
    if stopped or not result.complete:
        return "interrupted", reasons
    return ("failed" if reasons else "good"), reasons


def _pattern(folder: RunFolder, bench: Bench) -> list[str]:
    """Energy and quadrature over the scored window."""
    estimates = folder.estimates
    if estimates is None or "energy_ratio" not in estimates or not bench.controller.enabled:
        return []
    scored = estimates.t_s >= bench.loop.settle_s
    if not scored.any():
        return []
    reasons = []
    energy = float(np.abs(estimates["energy_ratio"][scored] - 1.0).max())
    if not energy <= bench.limits.energy_error:  # so that NaN is not good either
        reasons.append(f"energy off by {energy:.2%}, [limits] energy_error is {bench.limits.energy_error:.2%}")
    quadrature = float(np.abs(estimates["quadrature_ratio"][scored]).max())
    if not quadrature <= bench.limits.quadrature:
        reasons.append(
            f"quadrature {quadrature:.2%} of the energy, [limits] quadrature is {bench.limits.quadrature:.2%}"
        )
    return reasons
