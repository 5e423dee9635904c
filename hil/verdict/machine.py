"""Deadlines and loss: what this machine and the link did to the run, and which of the two it was.

Every figure comes from one count, `Result.answers`. Whose doing missed answers are is told by what the loop's process
had of the machine: while it was ready to run and had no processor, it could not answer.
"""

import shlex
from collections.abc import Collection, Mapping

from hil.bench import Bench
from hil.emulation import is_emulated
from hil.records.result import Answers, Load, Part, Result

_NO_PRIORITY = "no real-time scheduling"
_MOST = 0.5  # of the missed answers, which a cause must account for to be named


def judge_machine(result: Result, bench: Bench, refused: Collection[str] = (), bench_file: str = "BENCH") -> Part:
    """Missed and lost samples beside their limits.

    Args:
        result: with its count, its link and its load.
        bench: the limits.
        refused: what the system did not permit the loop's process.
        bench_file: what to name in the command that comes next.
    """
    answers = result.answers
    if answers is None:
        return Part(outcome="unknown")
    limits, reasons = bench.limits, []
    missed, lost = answers.missed / answers.ticks, result.lost / answers.ticks
    if missed > limits.late_fraction:
        reasons.append(
            f"{missed:.2%} of the samples had no answer in time ({_listed(answers)}), [limits] late_fraction is "
            f"{limits.late_fraction:.2%}; {_cause(result, answers)}"
        )
    if lost > limits.lost_fraction:
        stopped = f", {answers.stopped} of them while the board was SAFE" if answers.stopped else ""
        reasons.append(f"{lost:.2%} of the samples lost{stopped}, [limits] lost_fraction is {limits.lost_fraction:.2%}")
    if not reasons:
        share = answers.in_time / answers.ticks
        return Part(outcome="good", reason=f"{_cautious(share)} of {answers.ticks} samples answered in time")
    return Part(
        outcome="failed",
        reason="; ".join(reasons),
        next=_next(result, by_host=missed > limits.late_fraction and by_host(result), refused=refused, file=bench_file),
    )


def by_host(result: Result) -> bool:
    """Whether missed answers were this machine's doing: at least half of them left later than the board waits, or the
    loop lacked a processor for at least half as long as they took. What carries the bytes of an emulated board, and the
    board itself, run here too: for them it counts that anything waited for a processor."""
    answers, load = result.answers, result.load
    if answers is None or not answers.missed:
        return False
    lacked = 0.0 if load is None else load.lacked or 0.0
    if load is not None and is_emulated(result.link or ""):
        lacked = max(lacked, load.pressed or 0.0)
    return max(lacked * answers.ticks, answers.slow) >= _MOST * answers.missed


def mishaps(result: Result, counters: Mapping[str, int]) -> list[str]:
    """What went wrong on the way without ending the run, one line each; `counters` as in result.json."""
    told = []
    answers = result.answers
    if answers is not None and answers.lost_to_host:
        share = answers.lost_to_host / answers.ticks
        told.append(
            f"{answers.lost_to_host} samples ({share:.2%}) were lost on the way; the observer predicted over the gaps"
        )
    damaged = counters.get("frames_damaged", 0), counters.get("board_bad_frames", 0)
    if any(damaged):
        told.append(f"damaged frames were dropped, {damaged[0]} by the host and {damaged[1]} by the board")
    if answers is not None and (held := answers.missed):
        told.append(
            f"{held} samples ({held / answers.ticks:.2%}) had no answer in time ({_listed(answers)}); "
            "the board held its last drive, which the observer knows"
        )
    if rearmed := counters.get("rearmed", 0):
        stopped = "" if answers is None else f"; {answers.stopped} samples were not taken meanwhile"
        told.append(f"the board went to SAFE {rearmed} times and was armed again{stopped}")
    return told


def _listed(answers: Answers) -> str:
    parts = (
        (answers.late, "late"),
        (answers.unanswered, "seen too late to be answered"),
        (answers.lost_to_board, "lost on the way to the board"),
    )
    return ", ".join(f"{count} {what}" for count, what in parts if count)


def _cause(result: Result, answers: Answers) -> str:
    load = result.load
    if answers.lost_to_board >= _MOST * answers.missed:
        return "the link loses frames"
    if by_host(result):
        return f"this machine was too busy{'' if load is None else _waits(load)}"
    if load is None or load.lacked is None:
        return "whether link or machine was slow is not known here"
    return f"the link or the board was slow, or the loop was stopped{_waits(load)}"


def _waits(load: Load) -> str:
    """What was measured of processors that were not free."""
    told = []
    if load.lacked is not None:
        told.append(f"the loop lacked a processor {load.lacked:.1%} of the time")
    if load.pressed is not None:
        told.append(f"something here waited for one {load.pressed:.1%} of it")
    return f" ({', '.join(told)})" if told else ""


def _next(result: Result, *, by_host: bool, refused: Collection[str], file: str) -> str:
    """The command to paste: what the machine lacks, the same run without deadlines, or what the link can hold."""
    link = result.link or ""
    if by_host and not any(_NO_PRIORITY in line for line in refused) and is_emulated(link):
        return f"hil run {file} --link {shlex.quote(link)} --clock lockstep"
    return "hil doctor" if by_host or not link else f"hil doctor --link {shlex.quote(link)}"


def _cautious(share: float) -> str:
    """A share in percent that says 100 only where it is all."""
    return "all" if share == 1.0 else f"{min(share, 0.9999):.2%}"
