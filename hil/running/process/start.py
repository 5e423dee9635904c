"""The loop's process, started: `worker` in an interpreter of its own, which gets ready for its order.

Imports next to nothing: a caller that knows that it wants a run has the process load beside what it loads itself.
"""

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_ahead: "list[subprocess.Popen[bytes]]" = []


@contextmanager
def started_ahead() -> Iterator[None]:
    """Start one for the first run of the block, which takes it; without a run it has ended at the end of the block."""
    worker = _started()
    _ahead.append(worker)
    try:
        yield
    finally:
        if worker in _ahead:
            _ahead.remove(worker)
            _end(worker)


@contextmanager
def worker_process(control: socket.socket | None = None) -> Iterator["subprocess.Popen[bytes]"]:
    """The loop's process: that takes as long to be ready as the board behind the link does.

    `control`, which is closed here, is the loop's end of a line to a viewer (`process/control.py`).  At the end of
    the block one without an order is no more.
    """
    try:  # of several threads one takes it
        worker = _ahead.pop() if control is None else _started(control)
    except IndexError:
        worker = _started()
    if control is not None:
        control.close()
    try:
        yield worker
    finally:
        _end(worker)


def _started(control: socket.socket | None = None) -> "subprocess.Popen[bytes]":
    pipe = subprocess.PIPE
    # A session of its own: Ctrl-C at the terminal comes here, and the worker is told in its own way.
    return subprocess.Popen(
        [sys.executable, "-m", "hil.running.process.worker"],
        stdin=pipe,
        stdout=pipe,
        start_new_session=True,
        pass_fds=() if control is None else (control.fileno(),),
    )


def _end(worker: "subprocess.Popen[bytes]") -> None:
    with worker:
        worker.kill()
