"""A run as a whole: the board served, the worker started and watched, figures and report written."""

import json
import shutil
import signal
import subprocess
import sys
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.bench import Bench
from hil.bench.template import template, values_of
from hil.emulation import served
from hil.errors import InputError
from hil.loop.worker import Order
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, write_text
from hil.wire.errors import LinkClosed, LinkError, ProtocolError

if TYPE_CHECKING:
    from hil.wire.wire_log import WireLog

_VERSIONS = ("gyrohil", "numpy", "numba", "scipy", "pyarrow")
_ERRORS = {kind.__name__: kind for kind in (LinkError, LinkClosed, ProtocolError)}  # others become InputError


@dataclass(frozen=True)
class RunResult:
    """Where a run was recorded (None after a dry run), and what the board said of itself."""

    folder: Path | None
    identity: dict[str, Any]


def run(
    bench: Bench,
    link: str,
    out: Path,
    *,
    open_loop: bool = False,
    dry_run: bool = False,
    truth: Path | None = None,
    note: str | None = None,
    log: Path | None = None,
    progress: Watcher,
) -> RunResult:
    """Run the bench against `link` and record below `out`.

    The board of `pty:SCENARIO` is started and stopped here; `truth` goes to an emulated board, `log` takes the
    frames of a CAN link.  `open_loop` holds the drive at zero.  A run that was interrupted or failed leaves its
    folder with what was recorded and a result that says so.  Raises InputError or WireError, and leaves nothing,
    when no run could begin; KeyboardInterrupt is passed on after SAFE and a closed record.
    """
    if open_loop:
        controller = bench.controller.model_copy(update={"enabled": False})
        bench = bench.model_copy(update={"controller": controller})
    with served(link, truth=truth, seed=bench.loop.seed) as board, _logged(log, board.url) as logged:
        folder = out if dry_run else new_folder(out, bench)
        order = Order(
            bench.model_dump_json(),
            board.url,
            str(folder),
            dry_run,
            None if truth is None else str(truth),
        )
        interrupted = False
        try:
            outcome, interrupted = _work(order, progress)
            if outcome.get("stopped") and (words := board.last_words):
                outcome["stopped"] = f"the emulated board died: {words}"
        finally:
            recorded = not dry_run and _keep_if_recorded(folder)
    if logged is not None and logged.lost:
        remark = f"wire log: {logged.lost} frames are missing, as they came faster than they could be written"
        outcome["refused"] = [*outcome.get("refused", ()), remark]
    if recorded:
        conclude(folder, bench, outcome, link=link, note=note, progress=progress)
    if interrupted:
        raise KeyboardInterrupt
    if not (dry_run or recorded):
        raise LinkError(f"{link}: nothing was recorded: {outcome['stopped']}")
    return RunResult(folder if recorded else None, outcome.get("identity", {}))


def _logged(log: Path | None, url: str) -> "AbstractContextManager[WireLog | None]":
    """The wire log of a run, where one is asked for."""
    if log is None:
        return nullcontext()
    from hil.wire.wire_log import wire_log

    return wire_log(log, url)


def new_folder(out: Path, bench: Bench) -> Path:
    """A new run folder below `out` with the bench as run in it; a name that is taken gets a number."""
    folder = make_run_folder(out, bench.loop.name)
    write_text(folder / "bench.toml", template(values_of(bench), "The bench as run."))
    return folder


def conclude(
    folder: Path,
    bench: Bench,
    outcome: dict[str, Any],
    *,
    link: str | None,
    note: str | None,
    progress: Watcher,
) -> None:
    """Figures, the closing scan, verdict and report of a recorded run."""
    from hil.closing_scan import scan_run, to_model
    from hil.records.result import Load, save_result
    from hil.records.runfolder import RunFolder
    from hil.records.summary import board_clock, summarise
    from hil.report import write_report
    from hil.verdict import judge

    run_folder = RunFolder(folder)
    began = time.perf_counter()
    found = scan_run(run_folder, bench, progress)
    scan = None if found is None else to_model(found, began)
    progress(Progress("report", 0, 0))
    identity, counters = outcome.get("identity"), outcome.get("counters", {})
    result = summarise(run_folder, counters).model_copy(
        update={
            "link": link,
            "clock": bench.loop.clock if link is not None else None,
            "mode": bench.loop.mode if link is not None else None,
            "board_clock": board_clock(run_folder) if link is not None else None,
            "counters": counters,
            "load": None if "load" not in outcome else Load.model_validate(outcome["load"]),
            "versions": {name: version(name) for name in _VERSIONS},
            "serial_number": f"{identity['unique_id']:016x}" if identity else None,
            "operator_note": note,
            "scan": scan,
        }
    )
    result = result.model_copy(update=judge(run_folder, result, bench, outcome)._asdict())
    save_result(run_folder.result_path, result)
    write_report(folder)


def _work(order: Order, progress: Watcher) -> tuple[dict[str, Any], bool]:
    """Start the worker and follow it to its end: (what it says happened, whether Ctrl-C came)."""
    pipe = subprocess.PIPE
    # A session of its own: Ctrl-C at the terminal comes here, and the worker is told in its own way.
    worker = subprocess.Popen(
        [sys.executable, "-m", "hil.loop.worker"], stdin=pipe, stdout=pipe, start_new_session=True
    )
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(json.dumps(asdict(order)).encode() + b"\n")
    worker.stdin.flush()
    interrupted = False
    outcome: dict[str, Any] | None = None
    error: tuple[str, str] | None = None
    with worker:
        while True:
            try:
                line = worker.stdout.readline()
                if not line:
                    break
                said = json.loads(line)
                if "outcome" in said:
                    outcome = said["outcome"]
                elif "error" in said:
                    error = said["error"], said["message"]
                else:
                    progress(Progress(**said))
            except KeyboardInterrupt:
                interrupted = True
                worker.terminate()
            except BaseException:  # of whoever watches: the board must not stay driven for that
                worker.terminate()
                raise
    code = worker.returncode
    if error is not None:
        kind, message = error
        raise _ERRORS.get(kind, InputError)(message)
    if outcome is None:
        ended = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
        outcome = {"stopped": f"the loop's process {ended}"}
    return outcome, interrupted


def _keep_if_recorded(folder: Path) -> bool:
    """Whether a sample was recorded there; a folder without any is taken away."""
    from hil.records.runfolder import RunFolder

    capture = RunFolder(folder).capture
    if capture is not None and len(capture):
        return True
    shutil.rmtree(folder)
    return False
