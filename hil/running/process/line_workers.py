"""The kernel's workers that carry a serial line's bytes, ahead of ordinary processes while a loop runs.

Linux passes what was written to a pty, or came from a serial adapter, on to its reader by a worker thread of the kernel
(`kworker/u…`; drivers/tty/tty_buffer.c).  That thread has ordinary priority, however urgent loop and board are: beside
any other work the bytes wait for it.  At 4 kHz over a pty that made most of the late answers
(docs/decisions/0006-loop-process.md).

`python -m hil.running.process.line_workers`, as root, does it until it is ended: for loops of users who may not.
"""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

PRIORITY = 1  # before ordinary processes, behind the loop and an emulated board
_LOOK_S = 0.5  # the kernel starts such threads as it needs them, and ends them
_PROC = Path("/proc")
_OF_THE_KERNEL = _PROC / "2/task/2/children"  # kthreadd starts them all


def carries_by_workers(link: str) -> bool:
    """Whether that is how the bytes of this link travel: a serial port, or the host's end of a pty."""
    return link.startswith("serial:")


def line_workers() -> Iterator[int]:
    """Process ids of those that have ordinary priority, or this one; none are seen from inside a container."""
    for pid in _threads_of_the_kernel():
        with suppress(OSError):  # it has ended
            if not (_PROC / str(pid) / "comm").read_text().startswith("kworker/u"):
                continue
            policy, nice = os.sched_getscheduler(pid), os.getpriority(os.PRIO_PROCESS, pid)
            if policy == os.SCHED_FIFO or (policy == os.SCHED_OTHER and nice == 0):
                yield pid


def permitted() -> bool:
    """Whether this process may put them ahead: it tries with one, and leaves that as it was."""
    for pid in line_workers():
        try:
            policy, priority = os.sched_getscheduler(pid), os.sched_getparam(pid)
            os.sched_setscheduler(pid, policy, priority)
        except ProcessLookupError:
            continue
        except PermissionError:
            return False
        return True
    return False


@contextmanager
def ahead(link: str) -> Iterator[None]:
    """Keep the workers ahead while the block runs, where `link` needs them and the system permits it; then give them
    back their ordinary priority, those too that a host which was killed has left ahead.
    """
    if not carries_by_workers(link):
        yield
        return
    ended = threading.Event()
    keeper = threading.Thread(target=_keep_ahead, args=(ended,), daemon=True, name="line workers")
    keeper.start()
    try:
        yield
    finally:
        ended.set()
        keeper.join()


def _keep_ahead(ended: threading.Event) -> None:
    try:
        while True:
            for pid in line_workers():
                with suppress(ProcessLookupError):
                    if os.sched_getscheduler(pid) == os.SCHED_OTHER:
                        os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
            if ended.wait(_LOOK_S):
                return
    except PermissionError:  # `hil doctor` tells it, and the remedy
        return
    finally:
        for pid in line_workers():  # another run that goes on puts them ahead again with its next look
            with suppress(OSError):
                if os.sched_getparam(pid).sched_priority == PRIORITY:
                    os.sched_setscheduler(pid, os.SCHED_OTHER, os.sched_param(0))


def _threads_of_the_kernel() -> Iterator[int]:
    try:
        found = _OF_THE_KERNEL.read_text().split()
    except OSError:  # a kernel without CONFIG_PROC_CHILDREN, or no view of its threads
        found = [place.name for place in _PROC.iterdir() if place.name.isdigit()]
    yield from map(int, found)


def main() -> None:
    """Until Ctrl-C or SIGTERM."""
    if not permitted():
        raise SystemExit(
            "line workers: not permitted, or none to be seen here: sudo python -m hil.running.process.line_workers"
        )
    ended = threading.Event()

    def end(_: int, __: FrameType | None) -> None:
        ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    _keep_ahead(ended)


if __name__ == "__main__":
    main()
