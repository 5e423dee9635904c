"""A process of its own for runs, one after another: whatever a run does to it, this process and its data stay."""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from typing import Any

from hil.errors import InputError
from hil.sweeping.program import program_digest
from hil.sweeping.tasks import Done, Task

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""A sum over threads is rounded otherwise with every number of them, and processes side by side need one each."""

ATTEMPTS = 3


class MachineError(InputError):
    """This machine, not the run, keeps it from being carried out: a full disk, no memory."""


class RunProcess:
    """Started with the first task, and again after it died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None
        self._ended = False

    def carry_out(self, task: Task) -> Done:
        """The run's row; one that kills its process each time is `crashed`.  Raises MachineError."""
        died = ""
        for _ in range(ATTEMPTS):
            answer = self._asked(task.as_json())
            if "done" in answer:
                return Done(**answer["done"])
            if "machine" in answer:
                raise MachineError(answer["machine"])
            died = answer["died"]
        row = {"outcome": "crashed", "reason": f"its process died, {ATTEMPTS} times: {died}"}
        return Done(task.run, row, {"seconds": None, "host": os.uname().nodename, "pid": os.getpid()})

    def _asked(self, line: str) -> dict[str, Any]:
        process = self._running()
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.write(line + "\n")
            process.stdin.flush()
        answer = process.stdout.readline()
        found: dict[str, Any] = json.loads(answer) if answer.endswith("\n") else {}
        if found and "died" not in found:
            return found
        code = process.wait()
        self._close()
        return found or {"died": signal.Signals(-code).name if code < 0 else f"code {code}"}

    def _running(self) -> "subprocess.Popen[str]":
        if self._ended:
            raise MachineError("ended")
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "hil.sweeping.child"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                encoding="utf-8",
                env=os.environ | dict.fromkeys(_ONE_THREAD, "1"),
                start_new_session=True,  # Ctrl-C is for the one that gives the tasks
            )
        return self._process

    def end(self) -> None:
        """At once: what it is about is made again."""
        self._ended = True
        if (process := self._process) is not None:
            process.kill()
            process.wait()
            self._close()

    def _close(self) -> None:
        process, self._process = self._process, None
        for pipe in (process.stdin, process.stdout) if process is not None else ():
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()


_here = threading.local()


def carry_out_here(task: str) -> str:
    """A task, as text, in the process that belongs to this thread: what a worker of a cluster is given.

    Returns a line of JSON: the run with the digest of the program that made it.
    """
    if not hasattr(_here, "process"):
        _here.process = RunProcess()
    done = _here.process.carry_out(Task.from_json(task))
    return json.dumps({"run": done.run, "row": done.row, "wall": done.wall, "program": program_digest()})


def cores() -> int:
    return len(os.sched_getaffinity(0))


def carry_out_all(tasks: Iterator[Task], workers: int) -> Iterator[Done]:
    """Each as it is done, in whichever order.  Left early, it ends what is under way at once."""
    processes = [RunProcess() for _ in range(workers)]
    idle: queue.SimpleQueue[RunProcess] = queue.SimpleQueue()
    for process in processes:
        idle.put(process)

    def carried_out(task: Task) -> Done:
        process = idle.get()
        try:
            return process.carry_out(task)
        finally:
            idle.put(process)

    pool = ThreadPoolExecutor(workers)
    under_way: set[Future[Done]] = set()
    try:
        while True:
            while len(under_way) < 2 * workers and (task := next(tasks, None)) is not None:
                under_way.add(pool.submit(carried_out, task))
            if not under_way:
                return
            done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield future.result()
    finally:
        for process in processes:
            process.end()
        pool.shutdown(cancel_futures=True)
