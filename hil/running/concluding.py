"""The end of a run, and of a replay: figures, closing scan, verdict and report of what was recorded."""

import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from hil.bench import Bench
from hil.progress import Progress, Watcher
from hil.records.atomic import occupied
from hil.records.direct import OnDisk, on_disk
from hil.records.result import Load, Result, Told, save_result
from hil.records.runfolder import RunFolder
from hil.report.artist import Artist, artist_process
from hil.running.process.supervision import ctrl_c
from hil.running.request import RunRequest
from hil.verdict.safety import judge_safety

_UNFINISHED = "interrupted while the figures were computed"
_VERSIONS = ("gyrohil", "numpy", "scipy", "pyarrow")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, and what was done about the board and its record by then."""


@dataclass(frozen=True)
class Made:
    """What was recorded in `folder` by a bench; `outcome`: how loop or replay ended; a replay has no `request`."""

    folder: Path
    bench: Bench
    outcome: dict[str, Any]
    request: RunRequest | None = None

    @property
    def link(self) -> str | None:
        """Where the board was; None of a replay."""
        return None if self.request is None else self.request.link

    @cached_property
    def _there(self) -> OnDisk:
        return on_disk(RunFolder(self.folder).capture_path)

    @property
    def on_disk(self) -> str:
        """What is there of the record, beside what was to be there; of a replay there is no telling that."""
        meant = round(self.bench.loop.duration_s * self.bench.device.sample_rate_Hz)
        return self._there.told(None if self.link is None else meant)

    @property
    def of_run(self) -> dict[str, Any]:
        """What a result says without a look at the records: of a replay nobody closed a loop."""
        counters = {"counters": self.outcome.get("counters", {})}
        if self.request is None:
            return counters
        loop, note = self.bench.loop, self.request.options.get("note")
        return {**counters, "link": self.link, "operator_note": note, "clock": loop.clock, "mode": loop.mode}

    def save_without_figures(self, why: str) -> None:
        """A result of what is known by what is on disk; why: there are no figures."""
        there = self._there
        safety = judge_safety(self.outcome)
        told = [safety.reason] if safety.against else []
        result = Result(
            run=self.folder.name,
            seconds=max(there.rows + there.lost - 1, 0) / self.bench.device.sample_rate_Hz,
            samples=there.rows,
            lost=there.lost,
            verdict="unsafe" if safety.outcome == "unsafe" else "interrupted",
            parts={"safety": safety},
            reasons=(*told, f"{why}; {self.on_disk}: `hil replay` computes its figures"),
            complete=there.complete,
            **self.of_run,
        )
        save_result(RunFolder(self.folder).result_path, result)


def conclude(made: Made, *, report: bool | Artist = True, progress: Watcher) -> None:
    """Figures, the closing scan, verdict and report of a record; `report` may be who is to draw it.

    Raises Interrupted, which says what is there, on Ctrl-C. Of a run result.json is, then, if only with what was known;
    nothing is read again for it, so that the end comes at once.
    """
    folder = made.folder
    result = RunFolder(folder).result_path
    try:
        with occupied(folder), nullcontext(report) if isinstance(report, Artist) else artist(report) as drawer:
            if drawer is not None:
                drawer.draw(folder)
            _conclude(made, drawer, progress)
    except KeyboardInterrupt:
        with ctrl_c(lambda: None):  # it has come, and what follows is short
            figures = f"its figures are in {result.name}, its report is not drawn"
            if not result.exists():
                if made.link is not None:
                    made.save_without_figures(_UNFINISHED)
                figures = "its figures and report are not made: `hil replay` gives them"
            raise Interrupted(f"{made.on_disk}: {folder}; {figures}") from None


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def _conclude(made: Made, drawer: Artist | None, progress: Watcher) -> None:
    from hil.records.summary import board_clock, summarise
    from hil.records.trim_figures import told_of
    from hil.running.closing_scan import scan_run, to_model
    from hil.running.own_reading import own_reading
    from hil.verdict import judge
    from hil.verdict.budget import budget

    bench, outcome, run = made.bench, made.outcome, RunFolder(made.folder)
    began = time.perf_counter()
    found = scan_run(run, bench, progress)
    scan = None if found is None else to_model(found, began)
    progress(Progress("report", 0, 0))
    identity = outcome.get("identity")
    result = summarise(run, outcome.get("counters", {})).model_copy(
        update={
            **made.of_run,
            "board_clock": board_clock(run) if made.link is not None else None,
            "load": None if "load" not in outcome else Load.model_validate(outcome["load"]),
            "algorithm": (
                *(Told.model_validate(told) for told in outcome.get("algorithm", ())),
                *told_of(run, bench.device.amplitude_m),
            ),
            "versions": {name: version(name) for name in _VERSIONS},
            "serial_number": f"{identity['unique_id']:016x}" if identity else None,
            "scan": scan,
            "own_reading": own_reading(run, bench),
        }
    )
    if (beside := outcome.get("reference")) is not None:
        from hil.scoring.reference import compared, complaints_of

        result = result.model_copy(update={"reference": compared(run, bench, beside)})
        outcome["refused"] = [*outcome.get("refused", ()), *complaints_of(beside)]
    information = None if found is None else found.information
    result = result.model_copy(update=budget(run.estimates, bench, information, scan)._asdict())
    result = result.model_copy(update=judge(run, result, bench, outcome)._asdict())
    save_result(run.result_path, result)
    if drawer is not None:
        from hil.report.page import write_report

        write_report(made.folder, drawn=drawer.drawn())


def artist(wanted: bool) -> AbstractContextManager[Artist | None]:
    return artist_process() if wanted else nullcontext()
