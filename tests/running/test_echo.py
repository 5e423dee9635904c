"""docs/wire.md, "What a host does with what it hears", force mode: which rows are held against a board, and when.

A drive for the interval that begins at tick e is shown by the row of tick e + 1.
"""

import pytest

from hil.running.loop.force import Echo
from hil.wire.messages import SenseFlags

HELD, SATURATED = int(SenseFlags.HELD), int(SenseFlags.SATURATED)
LIMIT = 1000
NOT_HELD = "it is not flagged HELD"


def running(latency: int = 1) -> Echo:
    """Of a board that said RUNNING at tick 10: with a latency of 1 the interval from 11 on is driven."""
    echo = Echo(latency, LIMIT)
    echo.runs(10)
    return echo


def verdict(echo: Echo, tick: int, ux: int, uy: int, flags: int = 0) -> str:
    """What a row is found to be once another one follows, which alone tells nothing."""
    assert echo.saw(tick, ux, uy, flags) == ""
    return echo.saw(tick + 1, 0, 0, 0)


def of_sent(x: int, y: int, ux: int, uy: int, flags: int = 0) -> str:
    """`x` and `y` were sent, `ux` and `uy` are shown."""
    echo = running()
    echo.sent(x, y, 11)
    return verdict(echo, 12, ux, uy, flags)


def after(ux: int, uy: int, flags: int) -> str:
    """A row that shows what was sent, then one for which nothing was."""
    echo = running()
    echo.sent(100, -50, 11)
    assert echo.saw(12, 100, -50, 0) == ""
    return verdict(echo, 13, ux, uy, flags)


@pytest.mark.parametrize("drive", [(100, -50), (0, 0), (0, 7), (LIMIT, -LIMIT)])
def test_what_was_sent_is_right(drive: tuple[int, int]) -> None:
    assert of_sent(*drive, *drive) == ""


@pytest.mark.parametrize("shown", [(100, 50), (-100, -50), (99, -50), (100, -51), (0, 0), (-50, 100)])
def test_what_was_not_sent_ends_the_run(shown: tuple[int, int]) -> None:
    words = f"SENSE of tick 12 shows the drive codes {shown[0]} and {shown[1]}; 100 and -50 were sent for it"
    assert of_sent(100, -50, *shown) == words


def test_what_ends_the_run_does_so_from_then_on() -> None:
    echo = running()
    for tick in range(11, 20):
        echo.sent(1, 1, tick)
    assert echo.saw(12, 2, 2, 0) == ""
    words = echo.saw(13, 1, 1, 0)
    assert words.startswith("SENSE of tick 12")
    assert echo.saw(14, 1, 1, 0) == words


def test_the_last_row_of_a_board_that_stops_is_not_held_against_it() -> None:
    echo = running()
    echo.sent(100, -50, 11)
    echo.sent(100, -50, 12)
    assert echo.saw(12, 100, -50, 0) == ""
    assert echo.saw(13, 0, 0, 0) == ""


@pytest.mark.parametrize(
    ("sent", "shown"),
    [((3000, -3000), (LIMIT, -LIMIT)), ((-3000, 3000), (-LIMIT, LIMIT)), ((LIMIT + 1, 5), (LIMIT, 5))],
)
def test_drives_are_limited_as_drive_limit_says(sent: tuple[int, int], shown: tuple[int, int]) -> None:
    assert of_sent(*sent, *shown) == ""
    assert of_sent(*sent, *sent) != ""
    assert of_sent(*sent, -shown[0], -shown[1]) != ""
    assert of_sent(*sent, *shown[::-1]) != ""


def test_a_held_row_shows_the_drive_of_the_row_before() -> None:
    assert after(100, -50, HELD) == ""
    for wrong in ((0, 0), (100, 50), (99, -50)):
        told = after(*wrong, HELD)
        assert told.endswith("the one before it 100 and -50, and it is flagged HELD"), told


def test_a_row_for_which_nothing_was_sent_is_flagged() -> None:
    assert NOT_HELD in after(100, -50, 0)
    assert NOT_HELD in after(0, 0, 0)


def test_a_drive_that_came_late_is_held_too() -> None:
    echo = running()
    echo.sent(100, -50, 11)
    echo.sent(7, 7, 12)
    assert echo.saw(12, 100, -50, 0) == ""
    assert verdict(echo, 13, 100, -50, HELD) == ""


def test_of_a_held_row_after_a_lost_one_nobody_can_tell() -> None:
    echo = running()
    echo.sent(100, -50, 11)
    assert echo.saw(12, 100, -50, 0) == ""
    assert verdict(echo, 14, 3, 3, HELD) == ""


@pytest.mark.parametrize("shown", [(50, -20), (100, -20), (50, -50), (0, 0), (0, -50)])
def test_a_saturated_row_may_show_less(shown: tuple[int, int]) -> None:
    assert of_sent(100, -50, *shown, SATURATED) == ""
    assert after(*shown, HELD | SATURATED) == ""
    assert of_sent(100, -50, *shown, 0) != ""
    assert after(*shown, HELD) != ""


@pytest.mark.parametrize("shown", [(101, -50), (100, -51), (-50, -20), (50, 20)])
def test_a_saturated_row_shows_neither_more_nor_the_other_way(shown: tuple[int, int]) -> None:
    assert of_sent(100, -50, *shown, SATURATED) != ""
    assert after(*shown, HELD | SATURATED) != ""


@pytest.mark.parametrize("sent", [(0, -50), (-50, 0)])
def test_a_drive_along_one_axis_is_limited_further_along_it_alone(sent: tuple[int, int]) -> None:
    less = (sent[0] // 2, sent[1] // 2)
    assert of_sent(*sent, *less, SATURATED) == ""
    assert of_sent(*sent, *less[::-1], SATURATED) != ""


@pytest.mark.parametrize("latency", [0, 1, 3])
def test_nothing_is_due_before_the_first_driven_interval(latency: int) -> None:
    """What the first drive acts on begins a latency after the tick of RUNNING."""
    assert verdict(running(latency), 10 + latency, 0, 0) == ""
    assert NOT_HELD in verdict(running(latency), 11 + latency, 0, 0)


def test_nothing_is_due_before_running_and_after_arm() -> None:
    echo = Echo(1, LIMIT)
    assert verdict(echo, 500, 5, 5) == ""
    echo.runs(600)
    echo.forget()
    assert verdict(echo, 700, 0, 0) == ""
    echo.runs(800)
    assert NOT_HELD in verdict(echo, 802, 0, 0)


def test_what_was_odd_is_forgotten_with_arm() -> None:
    echo = running()
    assert verdict(echo, 12, 3, 3) != ""
    echo.forget()
    assert verdict(echo, 13, 0, 0) == ""


def test_running_said_again_puts_nothing_off() -> None:
    echo = running()
    echo.runs(500)
    assert NOT_HELD in verdict(echo, 12, 0, 0)


def test_a_drive_that_is_shown_runs_though_the_status_was_lost() -> None:
    echo = Echo(1, LIMIT)
    echo.sent(0, 0, 10)
    assert echo.saw(11, 0, 0, 0) == ""
    assert verdict(echo, 12, 0, 0) == ""  # a drive of zero shows nothing
    for drive in ((0, 5), (5, 0)):
        echo = Echo(1, LIMIT)
        echo.sent(*drive, 11)
        assert echo.saw(12, *drive, 0) == ""
        assert NOT_HELD in verdict(echo, 13, 0, 0)


def test_a_drive_of_long_ago_is_not_taken_for_one_of_now() -> None:
    for long in (256, 4096, 65536):
        echo = running()
        echo.sent(100, -50, 11)
        assert NOT_HELD in verdict(echo, 12 + long, 100, -50)
