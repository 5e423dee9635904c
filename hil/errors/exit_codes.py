"""How every program of the bench ends: its exit code."""

from enum import IntEnum


class ExitCode(IntEnum):
    """One meaning each, whatever the verb."""

    GOOD = 0
    AGAINST = 1
    """the verdict is not good, or a residual stays unexplained"""
    BAD_INPUT = 2
    """one line says what and where"""
    FAULT = 3
    """of the program itself: nothing is said of the board, the record or the model"""
    INTERRUPTED = 130
    """Ctrl-C or SIGTERM"""
