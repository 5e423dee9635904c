"""Progress: a bar per stage at a terminal, a line per stage elsewhere."""

import io
import sys

import pytest

from hil.cli.progress import watching
from hil.progress import Progress
from tests.cli.conftest import Terminal

STAGES = [
    Progress("connect", 0, 0, "somewhere"),
    Progress("run", 1, 4),
    Progress("run", 4, 4),
    Progress("report", 0, 0),
]


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


@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_nothing_that_a_terminal_obeys_comes_through(
    monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO]
) -> None:
    def drawn(text: str) -> str:
        written = stream()
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setattr(sys, "stderr", written)
        with watching(text) as watch:
            watch(Progress("connect", 0, 0, f"waiting {text}"))
            watch(Progress(text, 0, 0, text))
            watch(Progress("stop", 0, 0, alarm=text))
        return written.getvalue()

    evil = "\x1b[31mred\x07\u202egnirts\x9b2J[red]x[/]"
    text = drawn(evil)
    assert "red" in text
    for mark in "\x07\u202e\x9b":
        assert mark not in text
    assert "\x1b[31mred" not in text
    assert "[red]x[/]" in text  # words, no markup
