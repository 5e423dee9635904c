"""What the loop's process does to keep its deadlines on Linux, each step as far as the system permits."""

import ctypes
import gc
import os
import signal
import sys

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_PDEATHSIG, _PR_SET_TIMERSLACK = 1, 29
_AWAKE = "/dev/cpu_dma_latency"
PRIORITY = 41


def end_with_parent() -> None:
    """Have SIGHUP sent to this process when its parent dies, however it dies."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGHUP, 0, 0, 0)


def prepare() -> list[str]:
    """Keep paging, collector and timers out of the way, ask for real-time scheduling; what was refused."""
    libc = ctypes.CDLL(None, use_errno=True)
    refused = []
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        refused.append(f"memory is not locked: {os.strerror(ctypes.get_errno())}")
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    try:
        _keep_awake()
    except OSError as error:
        refused.append(f"processors may sleep between samples: {_AWAKE}: {error.strerror}")
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        refused.append(f"no real-time scheduling: {error.strerror}")
    return refused


def _keep_awake() -> None:
    """Ask that no processor sleeps so deep that waking takes time; it holds while the file is open, that is, until the
    process ends.  Here it halved the round trip over a pty.
    """
    os.write(os.open(_AWAKE, os.O_WRONLY), bytes(4))  # a 32-bit latency of 0 µs


_line = 1


def line() -> int:
    """Its descriptor: standard output, until `keep_line` has been called."""
    return _line


def keep_line() -> None:
    """From now on what a plug-in or a library prints goes to standard error."""
    global _line
    _line = os.dup(1)
    os.dup2(2, 1)
    sys.stdout = sys.stderr
