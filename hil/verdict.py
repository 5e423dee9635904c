"""Whether a run kept the limits of its bench file."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from hil.bench import Bench
from hil.records.result import Result
from hil.records.runfolder import RunFolder
from hil.records.sensing import sense_faults

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
    lost = result.lost / (result.lost + result.samples) if result.samples else 0.0
    if lost > limits.lost_fraction:
        reasons.append(f"{lost:.2%} of the samples lost, [limits] lost_fraction is {limits.lost_fraction:.2%}")
    if folder.capture is not None:
        reasons += sense_faults(folder.capture, bench.device.sense.noise_V)
    reasons += _pattern(folder, bench)
    if stopped or not result.complete:
        return "interrupted", reasons
    return ("failed" if reasons else "good"), reasons


def mishaps(result: Result, counters: Mapping[str, int]) -> list[str]:
    """What went wrong on the way without ending the run, one line each; `counters` as in result.json."""
    told = []
    if result.lost:
        share = result.lost / (result.lost + result.samples)
        told.append(f"{result.lost} samples ({share:.2%}) were lost on the way; the observer predicted over the gaps")
    damaged = counters.get("frames_damaged", 0), counters.get("board_bad_frames", 0)
    if any(damaged):
        told.append(f"damaged frames were dropped, {damaged[0]} by the host and {damaged[1]} by the board")
    if missed := counters.get("board_lost_seq", 0):
        told.append(f"{missed} frames did not reach the board; it held its last drive")
    if late := counters.get("board_late", 0):
        told.append(f"{late} drives reached the board after their tick; it held its last drive")
    if rearmed := counters.get("rearmed", 0):
        told.append(f"the board went to SAFE {rearmed} times and was armed again")
    return told


def _pattern(folder: RunFolder, bench: Bench) -> list[str]:
    """Share of the scored window at which energy and quadrature were outside their limits."""
    estimates, limits = folder.estimates, bench.limits
    if estimates is None or "energy_ratio" not in estimates or not bench.controller.enabled:
        return []
    scored = estimates.t_s >= bench.loop.settle_s
    if not scored.any():
        return []
    held = np.abs(estimates["energy_ratio"][scored] - 1.0) <= limits.energy_error  # NaN is not held either
    slender = np.abs(estimates["quadrature_ratio"][scored]) <= limits.quadrature
    invalid = 1.0 - float(np.mean(held & slender))
    if invalid <= limits.invalid_fraction:
        return []
    off, oval = 1.0 - float(held.mean()), 1.0 - float(slender.mean())
    return [
        f"the angle was not valid {invalid:.2%} of the time (energy off target {off:.2%}, quadrature too large "
        f"{oval:.2%}), [limits] invalid_fraction is {limits.invalid_fraction:.2%}"
    ]
