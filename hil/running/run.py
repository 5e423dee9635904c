"""A run as a whole: the board served, the worker started and watched, figures and report written."""

import shutil
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hil.bench import Bench
from hil.bench.by_verb import require_usable
from hil.bench.template import template, values_of
from hil.boards.emulation import Served, served
from hil.errors import InputError
from hil.errors.ending import line_of
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder, write_sealed
from hil.records.direct import on_disk
from hil.records.occupied import occupied
from hil.records.result import Result, save_result
from hil.records.runfolder import RunFolder
from hil.report.artist import Artist, artist_process
from hil.running.beside import recorded_beside
from hil.running.request import RunRequest
from hil.running.safety import alarm_of
from hil.running.supervision import Noticed, as_raised, supervise
from hil.running.worker import Order
from hil.running.worker_process import worker_process
from hil.verdict.safety import judge_safety

if TYPE_CHECKING:
    from hil.wire.wire_log import WireLog

_SCAN = ("hil.running.closing_scan", "estimator.completeness.closing", "hil.records.summary", "hil.verdict.budget")
_UNFINISHED = "interrupted while the figures were computed"
_VERSIONS = ("gyrohil", "numpy", "scipy", "pyarrow")


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, and what was done about the board and its record by then."""


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
    (`hil.running.control`).  Raises InputError or WireError, and leaves nothing, when no run could begin; Interrupted,
    which says what was done, is raised after SAFE and a closed record.
    """
    bench, link, dry_run, truth = request.bench, request.link, request.dry_run, request.truth
    require_usable(bench, "run")
    if request.open_loop:
        controller = bench.controller.model_copy(update={"enabled": False})
        bench = bench.model_copy(update={"controller": controller})
    if truth is not None and request.replace and not dry_run:
        truth.unlink(missing_ok=True)  # the board makes it anew, and writes over none
    said = "nothing was armed"
    lockstep = bench.loop.clock == "lockstep"  # else a board waits in real time for what these would keep busy
    with _artist(report and lockstep and request.judged and not dry_run) as artist:
        try:
            number = None if control is None else control.fileno()
            with (
                worker_process(control) as worker,
                _served(board, link, truth, bench, progress) as board,
                _logged(request.wire_log, board.url) as logged,
                ExitStack() as held,
            ):
                folder = out if dry_run else new_folder(out, bench)
                if not dry_run:
                    held.enter_context(occupied(folder))
                order = Order(
                    bench.model_dump_json(),
                    board.url,
                    str(folder),
                    dry_run,
                    None if truth is None else str(truth),
                    number,
                )
                try:
                    started = None if begun is None else partial(begun, folder)
                    if lockstep:
                        _load_beside(_SCAN)
                    beside = nullcontext() if dry_run else recorded_beside(bench, folder)
                    with beside as reference:
                        ended = supervise(worker, order, bench, progress, board, started, noticed)
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
        if recorded and request.judged:
            try:
                conclude(
                    folder, bench, outcome, link=link, note=request.note, report=artist or report, progress=progress
                )
            except Interrupted as interruption:
                raise Interrupted(f"{said}; {interruption}") from None
            except OSError as error:
                why = line_of(error)
                with suppress(OSError):  # a full disk may have room for as little
                    so_far = _result_so_far(folder, bench, outcome, link, request.note, why)
                    save_result(RunFolder(folder).result_path, so_far)
                raise InputError(
                    f"{why}; {said}; {_on_disk(folder, bench)}, in {folder.name}, without figures"
                ) from None
        if ended.interrupted:
            there = f"{_on_disk(folder, bench)}: {folder}" if recorded else "nothing was recorded"
            raise Interrupted(f"{said}; {there}")
        if not recorded and not (dry_run and "identity" in outcome):
            raise as_raised(outcome.get("failed", ["LinkError"]), outcome["stopped"])
        return RunResult(folder if recorded else None, outcome.get("identity", {}), outcome | {"safety": safety})


def _served(
    board: Served | None, link: str, truth: Path | None, bench: Bench, progress: Watcher
) -> "AbstractContextManager[Served]":
    """The board that serves already, or one that is started."""
    if board is not None:
        return nullcontext(board)
    return served(link, truth=truth, seed=bench.loop.seed, progress=progress)


def _what_was_done(safety: dict[str, Any]) -> str:
    """What became of the board, in a few words."""
    if not safety["armed"]:
        return "nothing was armed"
    if safety["confirmed"]:
        tick = safety["confirmed_tick"]
        return "SAFE was confirmed" if tick is None else f"SAFE was confirmed at tick {tick}"
    return alarm_of(safety) or str(safety["words"])


def _on_disk(folder: Path, bench: Bench) -> str:
    """What is there of the record of a run, beside what was to be there."""
    return on_disk(RunFolder(folder).capture_path).told(round(bench.loop.duration_s * bench.device.sample_rate_Hz))


def _result_so_far(
    folder: Path, bench: Bench, outcome: dict[str, Any], link: str | None, note: str | None, why: str
) -> Result:
    """What is known of a run without figures, by what is on disk; why: there are none."""
    counters = outcome.get("counters", {})
    there = on_disk(RunFolder(folder).capture_path)
    safety = judge_safety(outcome)
    told = [safety.reason] if safety.against else []
    return Result(
        run=folder.name,
        link=link,
        clock=bench.loop.clock,
        mode=bench.loop.mode,
        seconds=max(there.rows + there.lost - 1, 0) / bench.device.sample_rate_Hz,
        samples=there.rows,
        lost=there.lost,
        counters=counters,
        verdict="unsafe" if safety.outcome == "unsafe" else "interrupted",
        parts={"safety": safety},
        operator_note=note,
        reasons=(*told, f"{why}; {_on_disk(folder, bench)}: `hil replay` computes its figures"),
        complete=there.complete,
    )


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Without Ctrl-C and SIGTERM; in the main thread only, where they come."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, signal.SIG_IGN) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def _logged(log: Path | None, url: str) -> "AbstractContextManager[WireLog | None]":
    """The wire log of a run, where one is asked for."""
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


def conclude(
    folder: Path,
    bench: Bench,
    outcome: dict[str, Any],
    *,
    link: str | None,
    note: str | None,
    report: bool | Artist = True,
    progress: Watcher,
) -> None:
    """Figures, the closing scan, verdict and report of a recorded run; `report` may be who is to draw it.

    Raises Interrupted, which says what is there, on Ctrl-C. Of a run result.json is, then, if only with what was known;
    nothing is read again for it, so that the end comes at once.
    """
    result = RunFolder(folder).result_path
    try:
        with occupied(folder), nullcontext(report) if isinstance(report, Artist) else _artist(report) as artist:
            if artist is not None:
                artist.draw(folder)
            _conclude(folder, bench, outcome, link=link, note=note, artist=artist, progress=progress)
    except KeyboardInterrupt:
        with _undisturbed():
            figures = f"its figures are in {result.name}, its report is not drawn"
            if not result.exists():
                if link is not None:
                    save_result(result, _result_so_far(folder, bench, outcome, link, note, _UNFINISHED))
                figures = "its figures and report are not made: `hil replay` gives them"
            there = on_disk(RunFolder(folder).capture_path).told() if link is None else _on_disk(folder, bench)
            raise Interrupted(f"{there}: {folder}; {figures}") from None


@np.errstate(all="ignore")  # an observer that diverged is told by its figures, not by NumPy
def _conclude(
    folder: Path,
    bench: Bench,
    outcome: dict[str, Any],
    *,
    link: str | None,
    note: str | None,
    artist: Artist | None,
    progress: Watcher,
) -> None:
    from hil.records.result import Load, Told
    from hil.records.summary import board_clock, summarise
    from hil.records.trim_figures import told_of
    from hil.running.closing_scan import scan_run, to_model
    from hil.verdict import judge
    from hil.verdict.budget import budget

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
            "algorithm": (
                *(Told.model_validate(told) for told in outcome.get("algorithm", ())),
                *told_of(run_folder, bench.device.amplitude_m),
            ),
            "versions": {name: version(name) for name in _VERSIONS},
            "serial_number": f"{identity['unique_id']:016x}" if identity else None,
            "operator_note": note,
            "scan": scan,
        }
    )
    if (beside := outcome.get("reference")) is not None:
        from hil.scoring.reference import compared, complaints_of

        result = result.model_copy(update={"reference": compared(run_folder, bench, beside)})
        outcome["refused"] = [*outcome.get("refused", ()), *complaints_of(beside)]
    information = None if found is None else found.information
    result = result.model_copy(update=budget(run_folder.estimates, bench, information, scan)._asdict())
    result = result.model_copy(update=judge(run_folder, result, bench, outcome)._asdict())
    save_result(run_folder.result_path, result)
    if artist is not None:
        from hil.report.page import write_report

        write_report(folder, drawn=artist.drawn())


def _artist(wanted: bool) -> AbstractContextManager[Artist | None]:
    return artist_process() if wanted else nullcontext()


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
