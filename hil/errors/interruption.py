"""Ctrl-C and SIGTERM: KeyboardInterrupt, but not in the middle of an import.

Raised inside an import it is lost (a library does without the part that did not load, a module written in C forgets
it) or comes out as something else (`ImportError: initialization failed`, and an abort of the interpreter after it). So
a signal that comes then is sent once more until no import is under way.  An import may compile kernels, for minutes on
a busy machine; who has nothing to bring to an end does not wait for that, and leaves.
"""

import signal
import time
from collections.abc import Callable
from types import FrameType
from typing import NoReturn

_AGAIN_S = 0.02
_PATIENCE_S = 0.4  # so long an import is waited for
_IMPORT = "<frozen importlib._bootstrap>"
_since: float | None = None  # of a signal that waits, on the monotonic clock


def take_signals(*, leave: Callable[[], NoReturn] | None = None) -> None:
    """Let SIGINT and SIGTERM interrupt the main thread of this process; SIGALRM is used for a signal that waits.

    leave: ends the process where an import takes longer than is waited for; None: it is waited for.
    """

    def taken(number: int, frame: FrameType | None) -> None:
        interrupt(number, frame, leave)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, taken)


def interrupt(number: int, frame: FrameType | None, leave: Callable[[], NoReturn] | None = None) -> None:
    """Raise KeyboardInterrupt in `frame`, or come back when it imports nothing: a handler of signals; leave: as of
    `take_signals`.
    """
    global _since
    if not _importing(frame):
        _since = None
        raise KeyboardInterrupt
    _since = time.monotonic() if _since is None else _since
    if leave is not None and time.monotonic() - _since > _PATIENCE_S:
        leave()

    def again(_signal: int, _frame: FrameType | None) -> None:
        signal.raise_signal(number)  # to the handler of by then

    signal.signal(signal.SIGALRM, again)
    signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False
