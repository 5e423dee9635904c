"""Several gyros on one body at once: a run each, in a process of its own, one stop for all, one attitude."""

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hil.bench import Bench, override
from hil.bench.mount import Mount
from hil.errors import InputError
from hil.progress import Progress, Watcher
from hil.records.atomic import make_run_folder
from hil.records.attitude import (
    AttitudeResult,
    AxisOfBody,
    OneStop,
    attitude_layout,
    save_attitude_result,
    write_attitude,
)
from hil.records.runfolder import RunFolder
from hil.running.attitude_live import LiveAttitude, Together, together
from hil.running.concluding import Interrupted
from hil.running.options import RunOptions
from hil.running.process.supervision import ctrl_c
from hil.running.request import RunRequest, request_of
from hil.running.run import run

NAMES = "xyz"
CTRL_C = "Ctrl-C"
Interrupt = Callable[[], None]


def run_several(
    requests: Sequence[RunRequest],
    mount: Mount,
    out: Path,
    *,
    live: Callable[[str], None] | None = None,
    progress: Watcher,
) -> Path:
    """Run up to three boards at once and record below `out`: the folder, in it a run folder for each. `live` is told
    where a page shows the attitude while they last; without it there is none.

    Whatever ends one run early, a lost board, a stop, a fault of its process, Ctrl-C, stops all: each board is told
    SAFE, and has its own watchdog besides. Raises InputError or WireError where a run could not begin, Interrupted
    after Ctrl-C.
    """
    require_together(requests, mount)
    folder = make_run_folder(out, "attitude")
    one = _OneStop(len(requests))
    threads = []
    for index, request in enumerate(requests):
        name = NAMES[index]
        asked = replace(request, bench=_of_several(request.bench, name, index), own_board=True)
        watch = _of_axis(progress, name, shown=index == 0)
        threads.append(threading.Thread(target=_run_one, args=(asked, folder, name, one, watch), name=f"run-{name}"))
    page = nullcontext() if live is None else LiveAttitude(one.in_order, mount)
    with page as shown, ctrl_c(lambda: one.stop(CTRL_C)):
        if live is not None and shown is not None:
            live(shown.url)
        for thread in threads:
            thread.start()
        for thread in threads:
            while thread.is_alive():  # a wait without an end would keep Ctrl-C from its handler
                thread.join(0.1)
    if one.errors:
        with suppress(OSError):
            folder.rmdir()  # where nothing was recorded
        raise one.errors.get(one.by or "", next(iter(one.errors.values())))
    conclude(folder, [one.folders[name] for name in NAMES[: len(requests)]], mount, one.told)
    progress(Progress("report", 0, 0))
    if one.by == CTRL_C:
        raise Interrupted(f"{one.words}; {folder}")
    return folder


def requests_of(
    benches: Bench | Path | str | Sequence[Bench | Path | str], links: str | Sequence[str] | None, options: RunOptions
) -> list[RunRequest]:
    """A request for each bench, with its link where links are given. Raises InputError."""
    benches = [benches] if isinstance(benches, Bench | Path | str) else list(benches)
    if not 1 <= len(benches) <= len(NAMES):
        raise InputError(f"{len(benches)} bench files; up to {len(NAMES)} gyros are run at once")
    given = [None] * len(benches) if not links else [links] if isinstance(links, str) else list(links)
    if len(given) != len(benches):
        raise InputError(
            f"--link: {len(given)} given for {len(benches)} bench files; give one for each, in their order"
        )
    return [request_of(bench, options, link=link) for bench, link in zip(benches, given, strict=True)]


def require_together(requests: Sequence[RunRequest], mount: Mount) -> None:
    """InputError for what no several gyros can be run by."""
    if len(requests) != len(mount.axis):
        raise InputError(f"--mount: it has {len(mount.axis)} tables [[axis]], {len(requests)} bench files are given")
    for key in ("clock", "duration_s"):
        if len(values := {getattr(request.bench.loop, key) for request in requests}) > 1:
            each = ", ".join(map(str, sorted(values)))
            raise InputError(f"[loop] {key}: {each}; gyros of one body need one; give --{key.removesuffix('_s')}")
    for key in ("truth", "wire_log"):
        if any(request.options.get(key) is not None for request in requests):
            raise InputError(f"--{key.replace('_', '-')}: is of one board; run that alone, or leave it out")
    if any(request.bench.device.axes != 2 for request in requests):
        raise InputError("[device] axes: each gyro of a body has two axes of vibration")
    links = [request.link for request in requests if not request.emulated]
    if twice := next((link for link in links if links.count(link) > 1), None):
        raise InputError(f"{twice}: two bench files lead to it; give each board its own link")


def conclude(folder: Path, runs: Sequence[Path], mount: Mount, stop: OneStop | None) -> AttitudeResult:
    """Attitude, figures and report of runs that have ended."""
    from hil.report.attitude import write_attitude_report
    from hil.report.page import write_report

    places = [RunFolder(run) for run in runs]
    found, without = None, ""
    try:
        found = together(places, mount)
    except InputError as error:
        without = str(error)
    if found is not None:
        _write(folder, found)
    axes = []
    for index, place in enumerate(places):
        result = place.result
        axes.append(
            AxisOfBody(
                name=NAMES[index],
                run=place.path.name,
                verdict=None if result is None else result.verdict,
                direction=mount.axis[index].direction,
                angle_rad=None if found is None else float(found.angles[-1, index]),
                angle_u_rad=None if found is None else float(found.deviations[-1, index]),
                clock_u_s=None if found is None else found.clock_u_s[index],
            )
        )
    verdicts = {axis.verdict for axis in axes}
    worst = next((v for v in ("unsafe", "failed", "interrupted") if v in verdicts), "good")
    if worst == "good" and found is None and len(axes) == 3:
        worst = "failed"
    result_of = AttitudeResult(
        verdict=worst,  # type: ignore[arg-type]
        axes=tuple(axes),
        without=without,
        stop=stop,
        **({} if found is None else found.figures),
    )
    save_attitude_result(folder, result_of)
    for place in places:
        if place.result is not None:
            write_report(place.path)
    write_attitude_report(folder)
    return result_of


def _write(folder: Path, found: Together) -> None:
    attitude = found.attitude
    c = attitude.covariance
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    columns = [
        attitude.quaternion,
        *(c[:, i, j, None] for i, j in places),
        attitude.deviation[:, None],
        attitude.coning,
    ]
    layout = attitude_layout(rate_Hz=found.rate_Hz, start_s=found.start_s)
    write_attitude(folder / "attitude.arrow", layout, np.hstack(columns))


def _of_several(bench: Bench, name: str, index: int) -> Bench:
    """Named by its axis; a stop ends it, as the others stop with it; noise of its own."""
    seed = bench.loop.seed
    changes: dict[str, dict[str, Any]] = {"loop": {"name": name}, "limits": {"rearm": 0}}
    if seed is not None:
        changes["loop"]["seed"] = seed + index
    return override(bench, changes, f"{bench.device.name} as one of several")


def _of_axis(progress: Watcher, name: str, *, shown: bool) -> Watcher:
    def watch(told: Progress) -> None:
        if told.alarm:
            progress(told._replace(alarm=f"{name}: {told.alarm}"))
        elif shown and told.stage != "report":
            progress(told)

    return watch


def _run_one(request: RunRequest, folder: Path, name: str, one: "_OneStop", progress: Watcher) -> None:
    try:
        run(
            request,
            folder,
            begun=lambda place, interrupt: one.begun(name, place, interrupt),
            report=False,
            noticed=lambda what: one.noticed(name, what),
            progress=progress,
        )
    except Interrupted as interruption:
        one.said[name] = str(interruption)
    except BaseException as error:  # noqa: BLE001 - it is raised where all are waited for
        one.errors[name] = error
        one.stop(name)


class _OneStop:
    """The stop of all: who was first, when each board confirmed SAFE."""

    def __init__(self, count: int) -> None:
        self._lock = threading.RLock()
        self._interrupts: dict[str, Interrupt] = {}
        self._count = count
        self._since_s = 0.0
        self._safe_s: dict[str, float] = {}
        self._unconfirmed: list[str] = []
        self.by = ""
        self.folders: dict[str, Path] = {}
        self.errors: dict[str, BaseException] = {}
        self.said: dict[str, str] = {}

    def begun(self, name: str, folder: Path, interrupt: Interrupt) -> None:
        """A run has started: from now on it can be stopped, and is where the others are already."""
        with self._lock:
            self.folders[name] = folder
            self._interrupts[name] = interrupt
            if self.by:
                interrupt()

    def noticed(self, name: str, what: str) -> None:
        """What came of a run, as it came."""
        if what == "stopping":
            self.stop(name)
            return
        with self._lock:
            if what == "safe":
                self._safe_s.setdefault(name, time.monotonic())
            else:
                self._unconfirmed.append(name)

    def stop(self, by: str) -> None:
        """Stop all but the one it comes from; again, by Ctrl-C, end them."""
        with self._lock:
            if self.by and by != CTRL_C:
                return
            if not self.by:
                self.by, self._since_s = by, time.monotonic()
            for name, interrupt in self._interrupts.items():
                if name != by:
                    interrupt()

    def in_order(self) -> list[Path]:
        with self._lock:
            return [self.folders[name] for name in NAMES if name in self.folders]

    @property
    def told(self) -> OneStop | None:
        """For the result; None where all ran to their end."""
        if not self.by:
            return None
        after = {name: max(at - self._since_s, 0.0) for name, at in self._safe_s.items()}
        return OneStop(by=self.by, safe_after_s=after, unconfirmed=tuple(self._unconfirmed))

    @property
    def words(self) -> str:
        return "; ".join(f"{name}: {said}" for name, said in sorted(self.said.items()))
