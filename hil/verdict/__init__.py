"""What a run is worth, in four parts, worst first: safety, machine, model, angle.

A part says good things although another one failed: the machine's trouble is not the model's.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from hil.bench import Bench
from hil.records.result import Part, Result, RunVerdict
from hil.records.runfolder import RunFolder
from hil.verdict.angle import judge_angle
from hil.verdict.machine import judge_machine, mishaps
from hil.verdict.model import judge_model
from hil.verdict.safety import judge_safety

__all__ = ["Judgement", "judge"]


class Judgement(NamedTuple):
    """The verdict, its four parts by name (worst first), one line per limit that was not kept, and one line per mishap
    that ended nothing."""

    verdict: RunVerdict
    parts: dict[str, Part]
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]


def judge(folder: RunFolder, result: Result, bench: Bench, outcome: Mapping[str, Any]) -> Judgement:
    """Judge a recorded run, over the scored window; `outcome` is what the loop's process told of it.

    Limits without a record to hold against them are not judged.
    """
    stopped = str(outcome.get("stopped", ""))
    parts = {
        "safety": judge_safety(outcome),
        "machine": judge_machine(result, bench),
        "model": judge_model(folder, result, bench),
        "angle": judge_angle(folder, bench),
    }
    told = [part.reason for part in parts.values() if part.against]
    reasons = ([stopped] if stopped and stopped not in told else []) + told
    remarks = (*outcome.get("refused", ()), *mishaps(result, outcome.get("counters", {})))
    return Judgement(_verdict(parts, stopped or not result.complete), parts, tuple(reasons), remarks)


def _verdict(parts: Mapping[str, Part], ended_early: object) -> RunVerdict:
    if parts["safety"].outcome == "unsafe":
        return "unsafe"
    if ended_early:
        return "interrupted"
    return "failed" if any(part.against for part in parts.values()) else "good"
