"""Arming a board that was not started here takes a yes."""

import io
import sys

import pytest

from estimator.trace.experiments import Turn
from hil.bench import Bench, examples, load_bench
from hil.cli import consent
from hil.errors import InputError
from tests.cli.conftest import Terminal

LINK = "serial:/dev/ttyACM0"


@pytest.fixture
def bench() -> Bench:
    return load_bench(examples.find("bench", "s-slow"))


def at_terminal(monkeypatch: pytest.MonkeyPatch, answer: str) -> Terminal:
    """Put somebody at the terminal who types ``answer``; what is written there."""
    written = Terminal()
    monkeypatch.setattr(sys, "stderr", written)
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    return written


@pytest.mark.parametrize("answer", ["y\n", "Yes\n", " y "])
def test_yes_at_the_terminal(bench: Bench, monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    written = at_terminal(monkeypatch, answer)
    consent.require(LINK, bench, given=False)
    asked = written.getvalue().splitlines()
    assert asked[0] == f"{LINK} will be armed, and driven with:"
    assert asked[-1] == "Arm it? [y/N] "
    told = {line[2:22].strip(): line[23:] for line in asked[1:-1]}
    assert told["length"] == "30 s"
    assert told["largest drive"] == "10 m/s²"
    assert told["amplitude"] == "100 µm"
    assert told["virtual rotation"] == "3 rad/s"
    assert told["dither"] == "0.3 m/s² rms"
    assert told["target stiffness"] == f"{bench.target_stiffness_per_s2 * bench.device.mass_kg:.6g} N/m"
    assert told["watchdog"] == f"{bench.link.watchdog_s:g} s"


@pytest.mark.parametrize("answer", ["n\n", "\n", "", "yeah\n"])
def test_anything_else_is_a_no(bench: Bench, monkeypatch: pytest.MonkeyPatch, answer: str) -> None:
    written = at_terminal(monkeypatch, answer)
    with pytest.raises(InputError, match="not armed, since the answer was no"):
        consent.require(LINK, bench.with_(controller={"enabled": False}), given=False)
    assert "held at zero" in written.getvalue()
    assert "amplitude" not in written.getvalue()


def test_flag_asks_nothing(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    written = at_terminal(monkeypatch, "n\n")
    consent.require(LINK, bench, given=True)
    assert written.getvalue() == ""


def test_without_a_terminal_nothing_is_asked(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    with pytest.raises(InputError, match="needs --arm"):
        consent.require(LINK, bench, given=False)


TURN = Turn(0.5, 8.0)


def test_turning_waits_for_somebody_at_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is told how fast, and how far."""
    written = at_terminal(monkeypatch, "\nnot read\n")
    consent.have_it_turned(TURN)
    first, second, asked = written.getvalue().splitlines()
    assert "to and fro in 8 s, at most at 0.5 rad/s (28.6 °/s)" in first
    assert first.endswith("You can turn it by hand.")
    assert second.endswith("the observer lags.")
    assert asked == "Enter when it turns: "
    assert sys.stdin.read() == "not read\n"


def test_who_turns_a_gyro_faster_than_a_hand_does_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    written = at_terminal(monkeypatch, "\n")
    consent.have_it_turned(Turn(5.2, 0.084))
    first = written.getvalue().splitlines()[0]
    assert first.endswith("Use a rate table, or a longer run by hand.")


def test_turning_is_told_where_nobody_can_be_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    written = io.StringIO()
    monkeypatch.setattr(sys, "stderr", written)
    monkeypatch.setattr(sys, "stdin", io.StringIO("not read\n"))
    consent.have_it_turned(TURN)
    assert "no terminal to ask at" in written.getvalue()
    assert sys.stdin.read() == "not read\n"
