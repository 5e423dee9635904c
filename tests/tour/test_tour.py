"""What of the tour is quick, twice in a row; all of it with `python -m tests.tour`."""

from pathlib import Path

import pytest

from tests.tour.commands import PAGES, Done, available, commands, run

LONG = ("demo", "trace", "doctor", "compare", "sweep")
"""Verbs that take minutes, or measure this machine."""


def quick(command: str) -> bool:
    """Whether it depends neither on the time nor on minutes of computing."""
    verb, words = command.split()[1], command.split()
    paced = verb == "run" and "lockstep" not in words and "--open-loop" not in words
    return verb not in LONG and not paced and not any("better" in word for word in words)


def test_every_page_has_commands_and_every_verb_shown_is_one() -> None:
    from hil.cli.app import app

    verbs = {command.name for command in app.registered_commands}
    for page in PAGES:
        shown = commands(page)
        assert len(shown) > 10
        assert {one.split()[1] for one in shown if one.startswith("hil ")} <= verbs


def test_a_failure_is_one() -> None:
    assert Done("hil run s-slow", 1, 0.0, "verdict failed").as_documented
    assert not Done("hil run s-slow", 2, 0.0, "hil: no").as_documented
    assert not Done("hil export last", 1, 0.0, "").as_documented
    assert not Done("sha256sum a", 1, 0.0, "").as_documented
    assert not Done("hil ls", 0, 0.0, "\033[31mred").as_documented
    assert not Done("hil ls", 0, 0.0, "Traceback (most recent call last)").as_documented


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_the_quick_ones_twice_and_in_any_order(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    shown = [one for page in PAGES for one in commands(page) if quick(one) and available(one)]
    shown = list(dict.fromkeys(shown))
    assert len(shown) >= 8
    scored = [one for one in shown if one.startswith("hil score")]  # belongs to the run before it
    first = run("hil run s-slow --link inproc:s-slow --clock lockstep --truth truth.arrow --replace", tmp_path)
    assert first.as_documented, first
    for command in (*scored, *(one for one in shown if one not in scored)):
        done = run(command, tmp_path)
        assert done.as_documented, done
    # Runs take long, and `last` is another one without them.
    again = [one for one in shown if "last" not in one.split() and one.split()[1] not in ("run", "record")]
    for command in reversed(again):
        done = run(command, tmp_path)
        assert done.as_documented, done
