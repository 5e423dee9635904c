"""A run as a whole: the board served, the worker started and watched, figures and report written."""

import shutil
import socket
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hil.bench import Bench
from hil.bench.by_verb import require_usable
from hil.bench.template import template, values_of
from hil.boards.emulation import Served, served
from hil.errors import InputError
from hil.errors.ending import line_of
from hil.progress import Watcher
from hil.records.atomic import make_run_folder, occupied, write_sealed
from hil.records.runfolder import RunFolder
from hil.running import concluding
from hil.running.beside import recorded_beside
from hil.running.concluding import Interrupted, Made
from hil.running.process.start import worker_process
from hil.running.process.supervision import Noticed, as_raised, supervise
from hil.running.process.worker import Order
from hil.running.request import RunRequest
from hil.running.safety.latching import alarm_of

if TYPE_CHECKING:
    from hil.wire.wire_log import WireLog

_SCAN = ("hil.running.closing_scan", "estimator.completeness.closing", "hil.records.summary", "hil.verdict.budget")


@dataclass(frozen=True)
class RunResult:
    """Where a run was recorded (None after a dry run), what the board said of itself, and how the run ended."""

    folder: Path | None
    identity: dict[str, Any]
    outcome: Mapping[str, Any] = field(default_factory=dict)


def run(
    request: RunRequest,
    out: Path,
    *,
    begun: Callable[[Path, Callable[[], None]], None] | None = None,
    report: bool = True,
    board: Served | None = None,
    control: socket.socket | None = None,
    noticed: Noticed = lambda _: None,
    progress: Watcher,
) -> RunResult:
    """Run the bench against the link of `request` and record below `out`.

    The board of `pty:SCENARIO` is started and stopped here.  `begun` is told the folder once the loop's process has
    started, and what has it end well, as Ctrl-C does, from whichever thread.  A run that was interrupted or failed
    leaves its folder with what was recorded and a result that says so; without `report` its page is left to be drawn
    by a caller that has more to put into it.  `noticed` is told of an early end before the board is SAFE, and of that.
    `board` is one that serves already, and is not stopped here; `control` the loop's end of a line to clients
    (`process/control.py`).  Raises InputError or WireError, and leaves nothing, when no run could begin; Interrupted,
    which says what was done, is raised after SAFE and a closed record.
    """
    bench, link, dry_run, truth = request.bench, request.link, request.dry_run, request.file("truth")
    require_usable(bench, "run")
    if truth is not None and request.options.get("replace") and not dry_run:
        truth.unlink(missing_ok=True)  # the board makes it anew, and writes over none
    said = "nothing was armed"
    lockstep = bench.loop.clock == "lockstep"  # else a board waits in real time for what these would keep busy
    with concluding.artist(report and lockstep and request.judged and not dry_run) as drawer:
        try:
            number = None if control is None else control.fileno()
            with (
                worker_process(control) as worker,
                _served(board, link, truth, bench, progress) as board,
                _logged(request.file("wire_log"), board.url) as logged,
                ExitStack() as held,
            ):
                folder = out if dry_run else new_folder(out, bench)
                if not dry_run:
                    held.enter_context(occupied(folder))
                order = Order(replace(request, link=board.url), str(folder), number)
                try:
                    started = None if begun is None else partial(begun, folder)
                    if lockstep:
                        _load_beside(_SCAN)
                    beside = nullcontext() if dry_run else recorded_beside(bench, folder)
                    with beside as reference:
                        ended = supervise(worker, order, progress, board, started, noticed)
                        outcome, safety = ended.outcome, ended.safety
                        if reference is not None:
                            outcome["reference"] = reference.end()
                    if outcome.get("stopped") and (words := board.last_words):
                        outcome["stopped"] = f"the emulated board died: {words}"
                        safety |= {"confirmed": None, "words": "the emulated board has ended, and drives nothing"}
                except BaseException:
                    if not dry_run:
                        _keep_if_recorded(folder)
                    raise
                said = _what_was_done(safety)
                kept = bool(alarm_of(safety)) or bool(safety.get("taken"))  # it has a verdict, if nothing else
                recorded = not dry_run and _keep_if_recorded(folder, whatever=kept)
        except KeyboardInterrupt:
            raise Interrupted(said) from None
        if logged is not None and logged.lost:
            remark = f"wire log: {logged.lost} frames are missing, as they came faster than they could be written"
            outcome["refused"] = [*outcome.get("refused", ()), remark]
        made = Made(folder, bench, outcome, request)
        if recorded and request.judged:
            try:
                concluding.conclude(made, report=drawer or report, progress=progress)
            except Interrupted as interruption:
                raise Interrupted(f"{said}; {interruption}") from None
            except OSError as error:
                why = line_of(error)
                with suppress(OSError):  # a full disk may have room for as little
                    made.save_without_figures(why)
                raise InputError(f"{why}; {said}; {made.on_disk}, in {folder.name}, without figures") from None
        if ended.interrupted:
            there = f"{made.on_disk}: {folder}" if recorded else "nothing was recorded"
            raise Interrupted(f"{said}; {there}")
        if not recorded and not (dry_run and "identity" in outcome):
            raise as_raised(outcome.get("failed", ["LinkError"]), outcome["stopped"])
        return RunResult(folder if recorded else None, outcome.get("identity", {}), outcome | {"safety": safety})


def _served(
    board: Served | None, link: str, truth: Path | None, bench: Bench, progress: Watcher
) -> "AbstractContextManager[Served]":
    if board is not None:
        return nullcontext(board)
    return served(link, truth=truth, seed=bench.loop.seed, progress=progress)


def _what_was_done(safety: dict[str, Any]) -> str:
    if not safety["armed"]:
        return "nothing was armed"
    if safety["confirmed"]:
        tick = safety["confirmed_tick"]
        return "SAFE was confirmed" if tick is None else f"SAFE was confirmed at tick {tick}"
    return alarm_of(safety) or str(safety["words"])


def _logged(log: Path | None, url: str) -> "AbstractContextManager[WireLog | None]":
    if log is None:
        return nullcontext()
    from hil.wire.wire_log import wire_log

    return wire_log(log, url)


def new_folder(out: Path, bench: Bench) -> Path:
    """A new run folder below `out` with the bench as run in it; a name that is taken gets a number.

    Raises InputError or OSError with the place, and leaves nothing there.
    """
    folder = make_run_folder(out, bench.loop.name)
    try:
        write_sealed(folder / "bench.toml", template(values_of(bench), "The bench as run."))
    except OSError:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


def _load_beside(modules: Iterable[str]) -> None:
    """Load what is needed at the end while this process waits, or the core works; an import of it waits for that."""

    def load() -> None:
        with suppress(Exception):  # it is raised where the module is needed
            for module in modules:
                import_module(module)

    threading.Thread(target=load, name="imports").start()


def _keep_if_recorded(folder: Path, *, whatever: bool = False) -> bool:
    """Whether a sample was recorded there, or the folder is to be kept `whatever` is in it; else it is taken away."""
    place = RunFolder(folder)
    try:
        if whatever or (place.capture is not None and len(place.capture)):
            return True
    except InputError:  # what cannot be read is not thrown away
        if place.capture_path.stat().st_size:
            return True
    shutil.rmtree(folder, ignore_errors=True)  # on a disk that fails it stays: that is not what went wrong
    return False
