"""Ctrl-C and SIGTERM: KeyboardInterrupt, but not in the middle of an import.

Raised inside an import it is lost (a library does without the part that did not load, a module written in C forgets
it) or comes out as something else (`ImportError: initialization failed`, and an abort of the interpreter after it). So
a signal that comes then is sent once more until no import is under way.
"""

import signal
from types import FrameType

_AGAIN_S = 0.02
_IMPORT = "<frozen importlib._bootstrap>"


def take_signals() -> None:
    """Let SIGINT and SIGTERM interrupt the main thread of this process; SIGALRM is used for a signal that waits."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)


def interrupt(number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt in `frame`, or come back when it imports nothing: a handler of signals."""
    if not _importing(frame):
        raise KeyboardInterrupt

    def again(_signal: int, _frame: FrameType | None) -> None:
        signal.raise_signal(number)  # to whoever handles it by then

    signal.signal(signal.SIGALRM, again)
    signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)


def _importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False
