"""What a process can do to keep its deadlines on Linux, each step only as far as the system permits it."""

import contextlib
import ctypes
import gc
import os

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
_PR_SET_TIMERSLACK = 29
PRIORITY = 40


def settle() -> list[str]:
    """Keep paging, garbage collection and timers out of the way; returns what was refused, in lines."""
    libc = ctypes.CDLL(None, use_errno=True)
    refused = []
    # Pages are locked as they are touched: everything a tick needs has been touched by the time it matters.
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        refused.append(f"memory is not locked: {os.strerror(ctypes.get_errno())}")
    libc.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        refused.append(f"no real-time scheduling: {error.strerror}")
    else:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return refused


def urgent(on: bool) -> None:
    """Run before ordinary processes, or no longer; no effect where that is not permitted."""
    policy, priority = (os.SCHED_FIFO, PRIORITY) if on else (os.SCHED_OTHER, 0)
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, policy, os.sched_param(priority))
