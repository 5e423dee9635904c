"""Deadlines and loss: what this machine and the link did to the run, and which of the two it was.

Every figure comes from one count, `Result.answers`. Whose doing missed answers are is told by what the loop's process
had of the machine: while it was ready to run and had no processor, it could not answer.

What this machine holds on a link: the board latency, block or sample rate at which few enough answers are late.

From how late the answers of one record were (`hil.records.lateness`), whatever board it is of: the loop's rehearsal, a
run, or exchanges of time with a board that is not armed.
"""

import shlex
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from estimator.core.layout import MAX_LATENCY
from hil.bench import Bench
from hil.boards.emulation import is_emulated
from hil.numbers import count, counted, percent, times
from hil.records.lateness import Lateness
from hil.records.result import Answers, Holds, Load, Part, Result
from hil.records.setting import Setting
from hil.wire.link_name import Emulated, parse_link
from hil.wire.spec import SPEC

_NO_PRIORITY = "no real-time scheduling"
_MOST = 0.5  # of the missed answers, which a cause must account for to be named


def judge_machine(
    result: Result,
    bench: Bench,
    refused: Collection[str] = (),
    bench_file: str = "BENCH",
    too_slow: str = "",
    *,
    late: Lateness | None = None,
    latency_ticks: int = 0,
) -> Part:
    """Missed and lost samples beside their limits.

    Args:
        result: with its count, its link and its load.
        bench: the limits.
        refused: what the system did not permit the loop's process.
        bench_file: what to name in the command that comes next.
        too_slow: how the run ended, where this machine's being too slow ended it.
        late: how late the answers were, where the record tells it.
        latency_ticks: the board's latency as run.
    """
    answers = result.answers
    if answers is None and bench.loop.mode == "board" and result.samples:
        return _judge_record(result, bench, too_slow)
    if answers is None:
        return Part(outcome="unknown")
    limits, reasons = bench.limits, [too_slow] if too_slow else []
    missed, lost = answers.missed / answers.ticks, result.lost / answers.ticks
    if missed > limits.late_fraction:
        reasons.append(
            f"{percent(missed, 2)} of the samples had no answer in time ({_listed(answers)}), "
            f"[limits] late_fraction is {percent(limits.late_fraction, 2)}; {_cause(result, answers)}"
        )
    if lost > limits.lost_fraction:
        stopped = f", {count(answers.stopped)} of them while the board was SAFE" if answers.stopped else ""
        limit = percent(limits.lost_fraction, 2)
        reasons.append(f"{percent(lost, 2)} of the samples lost{stopped}, [limits] lost_fraction is {limit}")
    if not reasons:
        share, samples = answers.in_time / answers.ticks, counted(answers.ticks, "sample")
        return Part(outcome="good", reason=f"{_cautious(share)} of {samples} answered in time")
    mine = bool(too_slow) or (missed > limits.late_fraction and by_host(result))
    after = None
    if late is not None and missed > limits.late_fraction:
        after = advise(late, bench, own_setting(bench, latency_ticks), result.link or "", bench_file)
    if after is None or _not_permitted(refused):
        after = _next(result, by_host=mine, refused=refused, file=bench_file)
    return Part(outcome="failed", reason="; ".join(reasons), next=after)


def _judge_record(result: Result, bench: Bench, too_slow: str) -> Part:
    """Of a board that closes its own loop, to which no sample is answered: what is missing in the record."""
    ticks = result.samples + result.lost
    reasons = [too_slow] if too_slow else []
    if result.lost / ticks > bench.limits.lost_fraction:
        limit = percent(bench.limits.lost_fraction, 2)
        reasons.append(f"{percent(result.lost / ticks, 2)} of the samples lost, [limits] lost_fraction is {limit}")
    if reasons:
        return Part(outcome="failed", reason="; ".join(reasons), next=_next(result, by_host=False, refused=(), file=""))
    share = _cautious(result.samples / ticks)
    return Part(outcome="good", reason=f"{share} of {counted(ticks, 'sample')} recorded; the board drove by itself")


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
    """What went wrong on the way without ending the run, one line each; `counters` as in result.json.  Late answers are
    in the table of figures and in the part *machine*."""
    told = []
    answers = result.answers
    if answers is not None and answers.lost_to_host:
        share = percent(answers.lost_to_host / answers.ticks, 2)
        lost = _were(answers.lost_to_host, f" ({share})")
        told.append(f"{lost} lost on the way; the observer predicted over the gaps")
    if clipped := counters.get("clipped", 0):
        told.append(f"the sense converter was at its end in {counted(clipped, 'sample')} (flag CLIPPED)")
    damaged = counters.get("frames_damaged", 0), counters.get("board_bad_frames", 0)
    if any(damaged):
        told.append(
            f"damaged frames were dropped, {count(damaged[0])} by the host and {count(damaged[1])} by the board"
        )
    if rearmed := counters.get("rearmed", 0):
        stopped = "" if answers is None else f"; {_were(answers.stopped)} not taken meanwhile"
        told.append(f"the board went to SAFE {times(rearmed)} and was armed again{stopped}")
    return told


def _were(samples: int, remark: str = "") -> str:
    return f"{counted(samples, 'sample')}{remark} {'was' if samples == 1 else 'were'}"


def _listed(answers: Answers) -> str:
    parts = (
        (answers.late, "answered late"),
        (answers.unanswered, "not answered"),
        (answers.lost_to_board, "lost on the way to the board"),
    )
    return ", ".join(f"{count(number)} {what}" for number, what in parts if number)


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
        told.append(f"the loop lacked a processor {percent(load.lacked)} of the time")
    if load.pressed is not None:
        told.append(f"CPU fully loaded {percent(load.pressed)} of the time")
    return f" ({', '.join(told)})" if told else ""


def _next(result: Result, *, by_host: bool, refused: Collection[str], file: str) -> str:
    """The command to paste: what the machine lacks, the same run without deadlines, or what the link can hold."""
    link = result.link or ""
    if by_host and not _not_permitted(refused) and is_emulated(link):
        return f"hil run {file} --link {shlex.quote(link)} --clock lockstep"
    return "hil doctor" if by_host or not link else f"hil doctor --link {shlex.quote(link)}"


def _not_permitted(refused: Collection[str]) -> bool:
    """Whether the loop lacked what most makes answers late."""
    return any(_NO_PRIORITY in line for line in refused)


def _cautious(share: float) -> str:
    """A share in percent that says 100 only where it is all."""
    return "all" if share == 1.0 else percent(min(share, 0.9999), 2)


MARGIN = 3.0
"""By which the expected share stays below its limit. A machine is not the same a minute later: runs of one board,
minutes apart on an idle machine, had 2.5 to 8.4 % late."""

_BLOCKS = 6  # that are tried at one rate
_PER_WATCHDOG = 4.0  # blocks that a watchdog waits for at least
_PER_CYCLE = 10.0  # samples of the vibration at least
_LARGEST_BLOCK = int(SPEC.registers["BLOCK"].maximum)


def held(late: Lateness, bench: Bench, own: Setting, *, after: Setting | None = None) -> Holds | None:
    """The first of the settings from `own` on, and behind `after`, whose late share is within [limits] late_fraction.

    Within it the expected share has to be by MARGIN, and the upper end of its interval. Where no setting is, the last
    one of which the upper end is; None where none is: then nothing holds but lockstep.
    """
    limit, best = bench.limits.late_fraction, None
    tried = list(settings(bench, own))
    for setting in tried[tried.index(after) + 1 if after in tried else 0 :]:
        share = late.share(setting.waits_s, bench.loop.duration_s, block=setting.block)
        if share.at_most <= limit:
            safely = MARGIN * share.expected <= limit
            best = Holds(**setting._asdict(), expected=share.expected, at_most=share.at_most, safely=safely)
            if best.safely:
                break
    return best


def settings(bench: Bench, own: Setting) -> Iterator[Setting]:
    """Settings that ask less and less of the machine, the first is `own`: latencies one by one up to what a host can
    queue, or larger blocks, then as many to the second at half the rate. Blocks are not longer in time than the largest
    at the own rate: a matrix that holds for longer follows the rotation no more."""
    if bench.loop.mode == "force":
        for latency in range(max(own.latency_ticks, 1), MAX_LATENCY + 1):
            yield own._replace(latency_ticks=latency, block=1)
        return
    resonance_Hz = bench.device.resonance_rad_s / (2.0 * np.pi)
    most = max(min(_LARGEST_BLOCK, int(bench.watchdog_s * own.rate_Hz / _PER_WATCHDOG)), own.block)
    blocks = np.unique(np.linspace(own.block, most, _BLOCKS).astype(int)).tolist()
    yield from (Setting(0, block, own.rate_Hz) for block in blocks)
    if 0.5 * own.rate_Hz >= _PER_CYCLE * resonance_Hz:
        yield from (Setting(0, block // 2, 0.5 * own.rate_Hz) for block in blocks if block >= 2)


def loop_changes(bench: Bench, setting: Setting) -> dict[str, int]:
    """Keys of [loop] that a setting changes: the block of gain mode, and with it a stride of the estimates that does
    not go with it."""
    loop = bench.loop
    if setting.latency_ticks or setting.block == loop.block:
        return {}
    fits = loop.estimate_every % setting.block == 0 or setting.block % loop.estimate_every == 0
    return {"block": setting.block} if fits else {"block": setting.block, "estimate_every": setting.block}


def own_setting(bench: Bench, latency_ticks: int) -> Setting:
    """Of the bench as run against a board of such a latency."""
    if bench.loop.mode == "gain":
        return Setting(0, bench.loop.block, bench.device.sample_rate_Hz)
    return Setting(max(latency_ticks, 1), 1, bench.device.sample_rate_Hz)


def advise(late: Lateness, bench: Bench, own: Setting, link: str, file: str) -> str | None:
    """What to do after a run of `own` with too many late answers: the command, or what to change before it; None where
    no setting beyond `own` holds."""
    found = held(late, bench, own, after=own)
    if found is None:
        return None
    setting, again = found.setting, f"hil run {file} --link"
    changes = [f"[loop] {key} = {value}" for key, value in loop_changes(bench, setting).items()]
    if setting.rate_Hz != own.rate_Hz:
        changes.append(f"[device] sample_rate_Hz = {setting.rate_Hz:g}")
    before = f"{' and '.join(changes)} in {file}, then " if changes else ""
    if is_emulated(link) and isinstance(board := parse_link(link), Emulated):
        if setting.latency_ticks:
            board = replace(board, latency_ticks=setting.latency_ticks)
        elif setting.rate_Hz != own.rate_Hz:
            board = replace(board, rate_Hz=setting.rate_Hz)
        return f"{before}{again} {shlex.quote(board.url)}"
    if setting.latency_ticks:
        before = f"a latency of {setting.latency_ticks} ticks in the board's firmware (hil emulate --latency), then "
    elif setting.rate_Hz != own.rate_Hz:
        before = f"a board at {setting.rate_Hz:g} Hz (hil emulate --rate), {before}"
    return f"{before}{again} {shlex.quote(link)}"
