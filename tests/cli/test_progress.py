"""Progress: a bar per stage at a terminal, a line per stage elsewhere."""

import io
import sys

import pytest

from hil.cli.progress import watching
from hil.progress import Progress

STAGES = [
    Progress("connect", 0, 0, "somewhere"),
    Progress("run", 1, 4),
    Progress("run", 4, 4),
    Progress("report", 0, 0),
]


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_lines_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.StringIO()
    monkeypatch.setattr(sys, "stderr", written)
    with watching("s-slow") as watch:
        for progress in STAGES:
            watch(progress)
    assert written.getvalue() == "connect\nrun\nreport\n"


def test_one_bar_at_a_time_at_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    written = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", written)
    with watching("s-slow") as watch:
        watch(STAGES[0])
        watch(STAGES[3])
    last = written.getvalue().rpartition("s-slow")[2]
    assert "report" in last
    assert "somewhere" not in last
