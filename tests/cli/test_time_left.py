"""What a trace says of the time it still takes: nothing without ground, no wild jumps, and about right in the end."""

import sys
from itertools import pairwise

import pytest

from hil.cli.progress import watching
from hil.progress import Progress
from hil.tracing.time_left import TimeLeft, in_words
from tests.cli.conftest import Terminal


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_nothing_is_said_before_there_is_ground() -> None:
    clock = Clock()
    left = TimeLeft(clock=clock)
    assert left.told("effects", 0, 3) is None
    clock.now += 2.0
    assert left.told("effects", 1, 5) is None
    clock.now += 0.5
    assert left.told("effects", 2, 5) is None  # too soon
    clock.now += 2.5
    assert left.told("candidates", 4, 5) is None  # what follows is anything
    assert left.told("effects", 3, 5) is not None


def test_a_stage_counts_down_at_its_pace_and_adds_what_follows() -> None:
    """Thirty rounds at a second each, after ten seconds."""
    clock = Clock()
    left = TimeLeft(clock)
    clock.now += 10.0
    said = []
    for done in range(1, 31):
        clock.now += 1.0
        if (one := left.told("effects", done, 30)) is not None:
            said.append(one)
    assert len(said) == 29
    assert 28.0 < said[0] < 28.0 + 40.0
    assert all(later < earlier for earlier, later in pairwise(said))
    assert 0.0 < said[-1] < 40.0  # no more than was spent by then


def test_an_estimate_counts_down_and_rises_only_for_a_reason() -> None:
    clock = Clock()
    left = TimeLeft(clock=clock)
    clock.now += 10.0
    left.told("effects", 1, 10)
    clock.now += 10.0
    first = left.told("effects", 2, 10)
    assert first is not None
    clock.now += 12.0  # a little slower than before
    second = left.told("effects", 3, 10)
    assert second == pytest.approx(first - 12.0)
    clock.now += 300.0  # much slower
    third = left.told("effects", 4, 10)
    assert third is not None
    assert third > 600.0


def test_in_words() -> None:
    assert in_words(3.0) == "a few seconds left"
    assert in_words(37.0) == "about 40 s left"
    assert in_words(118.0) == "about 2 min left"


def test_a_terminal_shows_the_estimate_and_no_time_of_the_stage_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    written = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", written)
    with watching("trace", whole=True) as watch:
        watch(Progress("candidates", 2, 5))
        assert " left" not in written.getvalue()
        watch(Progress("candidates", 3, 5, left_s=41.0))
    assert "about 40 s left" in written.getvalue()
    assert "-:--" not in written.getvalue()
