"""What a run is worth, in four parts, worst first: safety, machine, model, angle.

A part says good things although another one failed: the machine's trouble is not the model's.
"""

import shlex
from collections.abc import Mapping
from typing import Any, NamedTuple

from hil.bench import Bench, load_bench
from hil.boards.emulation import is_emulated
from hil.records.lateness import lateness_of
from hil.records.result import Holds, Part, Reason, Result, RunVerdict, next_of
from hil.records.runfolder import RunFolder
from hil.verdict.angle import judge_angle
from hil.verdict.machine import held, judge_machine, mishaps, own_setting
from hil.verdict.model import faults_of, judge_model
from hil.verdict.next_step import after_run
from hil.verdict.residual import cause
from hil.verdict.safety import judge_safety
from hil.verdict.safety import remarks as stops_survived

__all__ = ["Judgement", "judge"]


_DOUBTS = {"model": "the machine part failed too", "angle": "fix the late answers first"}
"""Said of a part that failed beside the machine's."""

_EMULATED = ": repeat in lockstep to check"
"""Said of the model as well where the board can wait."""


class Judgement(NamedTuple):
    """The verdict as in result.json: its four parts by name (worst first), one line per limit that was not kept, one
    per mishap that ended nothing, the command that comes next, and what this machine would hold on that link."""

    verdict: RunVerdict
    parts: dict[str, Part]
    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    next: str
    holds: Holds | None = None


def judge(folder: RunFolder, result: Result, bench: Bench, outcome: Mapping[str, Any]) -> Judgement:
    """Judge a recorded run, over the scored window; `outcome` is what the loop's process told of it.

    Limits without a record to hold against them are not judged.
    """
    stopped, refused = str(outcome.get("stopped", "")), tuple(outcome.get("refused", ()))
    counters = outcome.get("counters", {})
    cure = str(outcome.get("cure", ""))
    signs = (outcome.get("safety") or {}).get("signs")  # then the wiring is known
    if counters.get("residual_safe") and not signs and (start := cause(folder, bench, result.link or "")):
        stopped, cure = f"{stopped}; {start.text}", start.cure
    ended_early = bool(stopped) or not result.complete
    too_slow = "HostTooSlow" in outcome.get("failed", ())
    bench_file = shlex.quote(str(folder.bench_path))
    late = lateness_of(folder, result.answers)
    faults = faults_of(folder, bench)
    latency_ticks = 0 if late is None or folder.capture is None else folder.capture.latency_ticks
    parts = {
        "safety": judge_safety(outcome),
        "machine": judge_machine(
            result, bench, refused, bench_file, stopped if too_slow else "", late=late, latency_ticks=latency_ticks
        ),
        "model": judge_model(folder, result, bench, faults, ended_early=ended_early),
        "angle": judge_angle(folder, result, bench, faults),
    }
    parts = _doubted(parts, result.link)
    reasons = _against(parts)
    if stopped and not any(stopped in reason.text for reason in reasons):
        # What concerns the board's safety comes before everything else.
        reasons.insert(int(parts["safety"].against), Reason(stopped, cure))
    unknown = (*outcome.get("unknown", ()), *outcome.get("plugins", ()))
    remarks = (*stops_survived(outcome), *refused, *unknown, *mishaps(result, counters))
    verdict = _verdict(parts, ended_early)
    holds = None if late is None else held(late, bench, own_setting(bench, min(latency_ticks, 1)))
    after = next_of(reasons) or after_run(verdict, parts, folder, result)
    return Judgement(verdict, parts, tuple(reason.text for reason in reasons), remarks, after, holds)


def _against(parts: Mapping[str, Part]) -> list[Reason]:
    """What the parts have against a run, each with its cure."""
    return [Reason(part.reason, part.next or "") for part in parts.values() if part.against]


def judge_again(folder: RunFolder, result: Result) -> Result:
    """The result of a run that was judged, its angle once more, beside the truth that it has been scored by."""
    before = result.parts.get("angle")
    if before is None:
        return result
    bench = load_bench(folder.bench_path)
    angle = judge_angle(folder, result, bench, faults_of(folder, bench))
    parts = _doubted({**result.parts, "angle": angle}, result.link)
    others = [reason for reason in result.reasons if reason != before.reason]
    told = [parts["angle"].reason] if parts["angle"].against else []
    still = others and result.next and result.next != before.next  # the angle comes last
    verdict = _verdict(parts, result.verdict == "interrupted")
    return result.model_copy(
        update={
            "parts": parts,
            "reasons": (*others, *told),
            "verdict": verdict,
            "next": result.next if still else next_of(_against(parts)) or after_run(verdict, parts, folder, result),
        }
    )


def _doubted(parts: Mapping[Any, Part], link: str | None) -> dict[Any, Part]:
    """The parts, those that failed beside the machine's with what that leaves in doubt."""
    doubted = dict(parts)
    if "machine" not in parts or not parts["machine"].against:
        return doubted
    for name, doubt in _DOUBTS.items():
        if name == "model" and is_emulated(link or ""):
            doubt += _EMULATED
        if parts[name].against and not parts[name].reason.endswith(doubt):
            doubted[name] = parts[name].model_copy(update={"reason": f"{parts[name].reason}; {doubt}"})
    return doubted


def _verdict(parts: Mapping[str, Part], ended_early: bool) -> RunVerdict:
    if parts["safety"].outcome == "unsafe":
        return "unsafe"
    if ended_early:
        return "interrupted"
    return "failed" if any(part.against for part in parts.values()) else "good"
