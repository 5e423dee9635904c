"""The line from the loop's process to the one that started it, apart from what anything in it prints."""

import os
import sys

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
