"""What an emulated board is started with, and how the bench is changed for it: what the machine holds, measured."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hil.bench import Bench, override
from hil.boards.emulation import served
from hil.errors import InputError
from hil.numbers import percent
from hil.progress import Progress, Watcher
from hil.records.lateness import Lateness, lateness_of
from hil.records.runfolder import RunFolder
from hil.records.setting import Setting
from hil.records.summary import answers
from hil.running.process.start import worker_process
from hil.running.process.supervision import supervise
from hil.running.process.worker import Order
from hil.running.request import RunRequest
from hil.verdict.machine import held, loop_changes, own_setting
from hil.wire.link_name import Emulated, parse_link

_LOCKSTEP = "no setting of the board is slow enough for this machine, so the run is in lockstep"


@dataclass(frozen=True)
class Started:
    """A choice: the setting, None where nothing but lockstep holds; and in one line why."""

    setting: Setting | None
    words: str

    def bench(self, bench: Bench) -> Bench:
        if self.setting is None:
            return override(bench, {"loop": {"clock": "lockstep"}}, "lockstep")
        if self.setting.latency_ticks:
            return bench
        changes: dict[str, dict[str, Any]] = {
            "loop": loop_changes(bench, self.setting),
            "device": {"sample_rate_Hz": self.setting.rate_Hz},
        }
        return override(bench, changes, self.setting.words)

    def link(self, link: str) -> str:
        if self.setting is None:
            return link
        latency_ticks, _, rate_Hz = self.setting
        board = parse_link(link)
        assert isinstance(board, Emulated)
        return (replace(board, latency_ticks=latency_ticks) if latency_ticks else replace(board, rate_Hz=rate_Hz)).url


def measured(bench: Bench, link: str, progress: Watcher, *, becomes: str = "is started") -> Started:
    """By a rehearsal on this very link; `becomes` says whether the board is then started. Raises as `rehearse`."""
    found = rehearse(bench, link, progress)
    if found is None:
        return Started(None, f"measured: too few answers in {MEASURED_S:g} s; {_LOCKSTEP}")
    late, latency_ticks = found
    return _chosen(f"measured for {MEASURED_S:g} s", late, bench, own_setting(bench, latency_ticks), becomes=becomes)


def after_late(run: RunFolder, bench: Bench, started: Started) -> Started | None:
    """The next choice after a run that had more late answers than its limit in spite of `started`; None where it kept
    it, or was in lockstep."""
    result = run.result
    if started.setting is None or result is None or result.answers is None or not result.answers.ticks:
        return None
    share = result.answers.missed / result.answers.ticks
    if share <= bench.limits.late_fraction:
        return None
    told = f"late in spite of {started.setting.words}, so the run was repeated: {run.path.name}"
    late = lateness_of(run, result.answers)
    if late is None:
        return Started(None, f"{told}; {_LOCKSTEP}")
    return _chosen(told, late, bench, own_setting(bench, 1), after=started.setting)


def _chosen(
    told: str,
    late: Lateness,
    bench: Bench,
    own: Setting,
    *,
    after: Setting | None = None,
    becomes: str = "is started",
) -> Started:
    was = after or own
    before = late.share(was.waits_s, bench.loop.duration_s)
    limit = percent(bench.limits.late_fraction, 2)
    words = (
        f"{told}: {was.words} gives {percent(before.expected, 2)} late answers (limit {limit}, [limits] late_fraction; "
        "wanted: at most a third)"
    )
    best = held(late, bench, own, after=after)
    if best is None:
        return Started(None, f"{words}; {_LOCKSTEP}")
    margin = "" if best.safely else ", less margin than wanted"
    chosen = f"the board {becomes} with {best.line}{margin}"
    return Started(best.setting, f"{words}; {chosen}")


MEASURED_S = 1.5
_BEGIN_S = 0.25  # until memory and caches are warm; of a whole run it is next to nothing
_REARMED = 1000  # a board that stops for want of answers is the finding, not the end


def rehearse(bench: Bench, link: str, progress: Watcher) -> tuple[Lateness, int] | None:
    """How late the answers to the emulated board of `link` are on wall time, and its latency in ticks; None where too
    few were given to tell.

    Raises InputError or WireError when board and bench do not agree, or the board cannot be had.
    """
    short = override(
        bench,
        {
            "loop": {"name": "rehearsal", "clock": "paced", "duration_s": MEASURED_S + _BEGIN_S, "settle_s": 0.0},
            "limits": {"rearm": _REARMED},
        },
        "the rehearsal",
    )

    def told(progressed: Progress) -> None:
        progress(progressed._replace(stage="measure") if progressed.stage == "run" else progressed)

    with tempfile.TemporaryDirectory() as aside, served(link, seed=bench.loop.seed, progress=progress) as board:
        order = Order(RunRequest(short, board.url), aside)
        with worker_process() as worker:
            outcome = supervise(worker, order, told, board).outcome
        run = RunFolder(Path(aside))
        try:
            counted = answers(run.capture, run.timing, outcome.get("counters", {}))
        except InputError:  # it ended before anything was written
            return None
        late = lateness_of(run, counted, since_s=_BEGIN_S)
        return None if late is None else (late, int(outcome["identity"]["latency_ticks"]))
