"""A second of a run, thrown away: how late answers are on this machine, on this link, with all that a run needs.

Board, loop and recorder are the processes that a run has, started as a run starts them, so that what they do to one
another is measured with the rest. Only emulated boards are armed for it.
"""

import tempfile
from pathlib import Path

from hil.bench import Bench, override
from hil.boards.emulation import served
from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.records.lateness import Lateness, lateness_of
from hil.records.runfolder import RunFolder
from hil.records.summary import answers
from hil.running.supervision import supervise
from hil.running.worker import Order
from hil.running.worker_process import worker_process

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
        order = Order(short.model_dump_json(), board.url, aside)
        with worker_process() as worker:
            outcome = supervise(worker, order, short, told, board).outcome
        run = RunFolder(Path(aside))
        try:
            counted = answers(run.capture, run.timing, outcome.get("counters", {}))
        except InputError:  # it ended before anything was written
            return None
        late = lateness_of(run, counted, since_s=_BEGIN_S)
        return None if late is None else (late, int(outcome["identity"]["latency_ticks"]))
