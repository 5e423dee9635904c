"""The jobs of a service: asked for, waiting, at work, done; each in a folder of its own, which outlives the service.

A folder has `order.json` (request, client, time) and, once the job has ended, `outcome.json`. A job without an
outcome that nobody works on was interrupted, by a crash of the service or of the machine, and is listed as such.
"""

import json
import logging
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from hil.errors import InputError
from hil.records.atomic import is_occupied, write_text
from hil.service.jobs.child import CANCELLED, ORDER, OUTCOME
from hil.service.problems import Unknown

FOLDER = "jobs"
CRASHED = "interrupted: the service or the machine went down meanwhile"
KEPT = 1000
"""Jobs that have ended, the newest; older ones are forgotten, what they made stays."""
WAITING = 100

_ID = re.compile(r"\d{8}-\d{6}-\d{6}-[0-9a-f]{8}")
_INSIST_S = 60.0  # a job that was told to end has so long to end well
_LOOK_S = 0.2
_LOG = logging.getLogger("hil.service")

Row = dict[str, Any]


@dataclass
class _Job:
    place: Path
    order: dict[str, Any]
    state: str = "queued"
    stage: str | None = None
    done: int | None = None
    total: int | None = None
    left_s: float | None = None
    alarm: str | None = None
    error: str | None = None
    result: dict[str, Any] = field(default_factory=dict)
    began: float | None = None
    ended: float | None = None
    child: "subprocess.Popen[bytes] | None" = None
    cancelled: bool = False

    @property
    def row(self) -> Row:
        asked = {name: value for name, value in self.order["asked"].items() if name != "kind"}
        return {
            "id": self.place.name,
            "kind": self.order["do"]["kind"],
            "state": self.state,
            "stage": self.stage,
            "done": self.done,
            "total": self.total,
            "left_s": self.left_s,
            "alarm": self.alarm,
            "error": self.error,
            "result": self.result or None,
            "asked": asked,
            "asked_at": _stamp(self.order["time"]),
            "began": _stamp(self.began),
            "ended": _stamp(self.ended),
            "by": self.order["by"],
        }


class Jobs:
    """The jobs in `folder`, at most `at_once` of them at work; runs are made below `out`.

    `told` gets the row of a job whenever it changes, `made` the name of a run folder that one has made or begun; both
    are called by other threads.
    """

    def __init__(
        self, folder: Path, out: Path, *, at_once: int | None = None, told: Callable[[Row], None] = lambda _: None,
        made: Callable[[str], object] = lambda _: None,
    ) -> None:  # fmt: skip
        self._folder, self._out = folder, out
        self._told, self._made = told, made
        self._at_once = at_once or max((os.cpu_count() or 2) // 2, 1)
        self._lock = threading.Lock()
        self._jobs: dict[str, _Job] = {}
        self._queue: list[str] = []
        self._threads: list[threading.Thread] = []
        self._ending = threading.Event()
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for place in sorted(folder.iterdir()):
            if _ID.fullmatch(place.name) and (job := _found(place)) is not None:
                self._jobs[place.name] = job
                if job.state == "running":
                    self._follow(job, self._wait_for_orphan)
        self._forget_old()

    # what can be asked

    def rows(self) -> list[Row]:
        """All of them, the newest first."""
        with self._lock:
            return [job.row for _, job in sorted(self._jobs.items(), reverse=True)]

    def row(self, job: str) -> Row:
        """One of them. Raises Unknown."""
        with self._lock:
            return self._one(job).row

    def add(
        self, do: dict[str, Any], asked: dict[str, Any], *, by: str, noted: Callable[[str], None] = lambda _: None
    ) -> Row:
        """Put a job into the queue: `do` is its order, `asked` what was asked for. Raises InputError for too many.

        `noted` is told its name before it is there for anybody; where that, or a write, fails, it never is.
        """
        with self._lock:
            if len(self._queue) >= WAITING:
                raise InputError(f"{WAITING} jobs wait already; cancel some, or wait")
            now = time.time()
            at = datetime.fromtimestamp(now)  # to the microsecond: names sort as the jobs were asked for
            name = f"{at:%Y%m%d-%H%M%S-%f}-{secrets.token_hex(4)}"
            place = self._folder / name
            order = {"do": do, "asked": asked, "out": str(self._out), "by": by, "time": now}
            place.mkdir(mode=0o700)
            try:
                write_text(place / ORDER, json.dumps(order) + "\n")
                noted(name)
            except BaseException:
                shutil.rmtree(place, ignore_errors=True)
                raise
            self._jobs[name] = _Job(place, order)
            self._queue.append(name)
        self._tell(name)
        self._start_next()
        self._forget_old()
        return self.row(name)

    def pyramid(self, run: str, record: Path, *, by: str) -> Row:
        """A job that prepares a long record to be drawn; the one that does already, where there is one."""
        with self._lock:
            for job in self._jobs.values():
                if job.state in ("queued", "running") and job.order["do"] == {"kind": "pyramid", "record": str(record)}:
                    return job.row
        return self.add({"kind": "pyramid", "record": str(record)}, {"kind": "pyramid", "run": run}, by=by)

    def cancel(self, job: str) -> Row:
        """Have a job end, well; one that has ended is forgotten. Raises Unknown."""
        with self._lock:
            found = self._one(job)
            if found.state == "queued":
                self._queue.remove(job)
                self._conclude(found, {"state": "cancelled", "error": CANCELLED, "ended": time.time()})
            elif found.state == "running":
                found.cancelled = True
                self._ask_to_end(found)
            else:
                row = found.row
                self._forget(job)
                return row
        self._tell(job)
        return self.row(job)

    def using(self, run: str) -> list[str]:
        """Ids of the jobs that work on a run folder, or wait for it."""
        with self._lock:
            return [
                name for name, job in self._jobs.items() if job.state in ("queued", "running") and run in _names_in(job)
            ]

    def close(self) -> None:
        self._ending.set()
        with self._lock:
            for name in list(self._queue):
                self._conclude(self._jobs[name], _failed(CRASHED))
            self._queue.clear()
            for job in self._jobs.values():
                if job.child is not None and job.child.stdin is not None and job.state == "running":
                    with suppress(OSError):
                        job.child.stdin.close()
        for thread in self._threads:
            thread.join(_INSIST_S)

    # how they are done

    def _one(self, job: str) -> _Job:
        if (found := self._jobs.get(job)) is None:
            raise Unknown("job", job)
        return found

    def _start_next(self) -> None:
        with self._lock:
            running = sum(1 for job in self._jobs.values() if job.state == "running")
            while self._queue and running < self._at_once and not self._ending.is_set():
                job = self._jobs[self._queue.pop(0)]
                job.state, job.began = "running", time.time()
                self._follow(job, self._do)
                running += 1

    def _follow(self, job: _Job, act: Callable[[_Job], None]) -> None:
        self._threads = [thread for thread in self._threads if thread.is_alive()]
        thread = threading.Thread(target=act, args=(job,), name=f"job {job.place.name}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _do(self, job: _Job) -> None:
        """Start the process of a job, and follow it to its end."""
        try:
            with (job.place / "stderr.txt").open("wb") as said:
                child = subprocess.Popen(
                    [sys.executable, "-m", "hil.service.jobs.child", str(job.place)],
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, start_new_session=True,
                )  # fmt: skip
            with self._lock:
                job.child = child
                if job.cancelled or self._ending.is_set():  # asked for before there was anybody to tell
                    self._ask_to_end(job)
            self._tell(job.place.name)
            with child:
                assert child.stdout is not None
                for line in child.stdout:
                    self._hear(job, line)
            outcome = _outcome(job.place) or _failed(_how(child.returncode))
        except OSError as error:
            outcome = _failed(f"could not be started: {error.strerror}")
        self._ended(job, outcome)
        self._start_next()

    def _hear(self, job: _Job, line: bytes) -> None:
        try:
            told = json.loads(line)
        except ValueError:
            return  # of a library that prints
        if not isinstance(told, dict):
            return
        with self._lock:
            if "run" in told:
                job.result = {"run": told["run"]}
            else:
                for name in ("stage", "done", "total", "left_s"):
                    setattr(job, name, told.get(name))
                job.alarm = told.get("alarm") or job.alarm
        if "run" in told:
            _guarded(self._made, told["run"])
        self._tell(job.place.name)

    def _wait_for_orphan(self, job: _Job) -> None:
        """Follow a job that an earlier service left, and that is about to end."""
        while is_occupied(job.place) and not self._ending.wait(_LOOK_S):
            pass
        if self._ending.is_set():
            return
        outcome = _outcome(job.place) or _failed(CRASHED)
        self._ended(job, outcome)

    def _ended(self, job: _Job, outcome: dict[str, Any]) -> None:
        with self._lock:
            self._conclude(job, outcome)
        self._tell(job.place.name)
        if run := job.result.get("run"):
            _guarded(self._made, run)

    def _ask_to_end(self, job: _Job) -> None:
        if (child := job.child) is None or child.stdin is None:
            return
        with suppress(OSError, ValueError):
            child.stdin.write(b"cancel\n")
            child.stdin.flush()
        timer = threading.Timer(_INSIST_S, _insist, [child])
        timer.daemon = True
        timer.start()

    def _conclude(self, job: _Job, outcome: dict[str, Any]) -> None:
        if job.cancelled and outcome["state"] == "failed" and not (job.place / OUTCOME).exists():
            outcome = outcome | {"state": "cancelled", "error": CANCELLED}  # before it could say so itself
        if not (job.place / OUTCOME).exists():
            with suppress(OSError):
                write_text(job.place / OUTCOME, json.dumps(outcome) + "\n")
        _take(job, outcome)
        job.child = None

    def _tell(self, name: str) -> None:
        with self._lock:
            row = self._jobs[name].row if name in self._jobs else None
        if row is not None:
            _guarded(self._told, row)

    def _forget_old(self) -> None:
        with self._lock:
            ended = sorted(name for name, job in self._jobs.items() if job.state not in ("queued", "running"))
            for name in ended[: max(len(ended) - KEPT, 0)]:
                self._forget(name)

    def _forget(self, name: str) -> None:
        shutil.rmtree(self._jobs.pop(name).place, ignore_errors=True)


def _found(place: Path) -> _Job | None:
    try:
        order = json.loads((place / ORDER).read_text())
        job = _Job(place, order, began=order["time"])
        assert job.row
    except (OSError, ValueError, KeyError, TypeError, AttributeError, AssertionError):
        _LOG.warning("%s: a job that cannot be read; remove its folder", place)
        return None
    outcome = _outcome(place)
    if outcome is None and is_occupied(place):
        job.state = "running"
        return job
    if outcome is None:
        outcome = _failed(CRASHED)
        with suppress(OSError):
            write_text(place / OUTCOME, json.dumps(outcome) + "\n")
    _take(job, outcome)
    return job


def _outcome(place: Path) -> dict[str, Any] | None:
    with suppress(OSError, ValueError):
        found = json.loads((place / OUTCOME).read_text())
        if isinstance(found, dict) and found.get("state") in ("done", "failed", "cancelled"):
            return found
    return None


def _failed(error: str) -> dict[str, Any]:
    return {"state": "failed", "error": error, "ended": time.time()}


def _take(job: _Job, outcome: dict[str, Any]) -> None:
    job.state, job.error = outcome["state"], outcome.get("error")
    job.result = outcome.get("result", job.result)
    job.began, job.ended = outcome.get("began", job.began), outcome.get("ended")
    job.stage = job.done = job.total = job.left_s = None


def _names_in(job: _Job) -> set[str]:
    """Run folders that a job reads, and the one that it makes."""
    do = job.order["do"]
    given = [do.get(name, ()) for name in ("run", "effects_of")]
    read = {Path(one).name for names in given for one in ([names] if isinstance(names, str) else names)}
    read |= {Path(do["record"]).parent.name} if "record" in do else set()
    return read | ({job.result["run"]} if "run" in job.result else set())


def _how(code: int) -> str:
    if code == -signal.SIGXCPU:
        return "took more processor time than such a job may"
    return f"its process was killed by {signal.Signals(-code).name}" if code < 0 else f"its process ended with {code}"


def _insist(child: "subprocess.Popen[bytes]") -> None:
    if child.poll() is None:
        with suppress(OSError):
            os.killpg(child.pid, signal.SIGKILL)


def _guarded(tell: Callable[[Any], object], what: Any) -> None:
    """Tell it; that somebody cannot hear it is no matter of the job."""
    try:
        tell(what)
    except Exception:  # noqa: BLE001 - of a listener, whatever it is
        _LOG.exception("a job could not be told")


def _stamp(when: float | None) -> str | None:
    return None if when is None else datetime.fromtimestamp(when).astimezone().isoformat(timespec="seconds")
