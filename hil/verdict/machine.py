"""Deadlines and loss: what this machine and the link did to the run."""

from collections.abc import Mapping

from hil.bench import Bench
from hil.records.result import Part, Result


def judge_machine(result: Result, bench: Bench) -> Part:
    """Late and lost samples beside their limits."""
    limits, reasons = bench.limits, []
    late = result.late / result.samples if result.samples else 0.0
    if late > limits.late_fraction:
        reasons.append(f"{late:.2%} of the answers late, [limits] late_fraction is {limits.late_fraction:.2%}")
    lost = result.lost / (result.lost + result.samples) if result.samples else 0.0
    if lost > limits.lost_fraction:
        reasons.append(f"{lost:.2%} of the samples lost, [limits] lost_fraction is {limits.lost_fraction:.2%}")
    return Part.of(reasons)


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
