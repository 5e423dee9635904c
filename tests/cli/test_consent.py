"""Arming a board that was not started here takes a yes."""

import io
import re
import sys
import tomllib
from pathlib import Path

import pytest

from estimator.trace.experiments import Turn
from hil.bench import Bench, examples, load_bench
from hil.cli import consent
from hil.errors import InputError
from tests.cli.conftest import Hil, Terminal

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
    assert told["watchdog"] == "0.02 s"


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


WITH_A_LOOP = [name for name in examples.names("bench") if not name.startswith("rate-table-")]


@pytest.mark.parametrize("name", WITH_A_LOOP)
@pytest.mark.parametrize("declared", [True, False])
def test_a_board_of_every_bench_file_is_asked_for(name: str, declared: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the watchdog as it is declared, and as the page of the bench file has it where none is."""
    text = re.sub(
        r"(?m)^watchdog_s = .*$", lambda key: key[0] if declared else "", examples.find("bench", name).read_text()
    )
    bench = Bench.model_validate(tomllib.loads(text))
    written = at_terminal(monkeypatch, "y\n")
    consent.require(LINK, bench, given=False)
    (told,) = re.findall(r"(?m)^  watchdog +(\S+) s$", written.getvalue())
    rows = 3 * bench.loop.block if bench.loop.mode in ("gain", "board") else 2
    key = re.search(r"(?m)^watchdog_s = (\S+)", text)
    expected = float(key[1]) if key else max(0.02, rows / bench.device.sample_rate_Hz)
    assert float(told) == pytest.approx(expected, rel=1e-5)


def test_a_board_of_a_new_bench_file_is_asked_for(hil: Hil, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    sheet = {"mass": 1e-8, "resonance": 15e3, "split": 10, "q": 5000, "amplitude": 1e-6, "sample-rate": 2e5}
    sheet |= {"sense-gain": 1e6, "noise": 1e-3, "full-scale": 1e3}
    assert hil("init", "--name=mine", *(f"--{name}={value:g}" for name, value in sheet.items()))[0] == 0
    written = at_terminal(monkeypatch, "y\n")
    consent.require(LINK, load_bench(tmp_path / "my.bench.toml"), given=False)
    assert "  watchdog             0.02 s\n" in written.getvalue()


TURN = Turn(0.5, 8.0)


def test_turning_waits_for_somebody_at_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is told how fast, and how far."""
    written = at_terminal(monkeypatch, "\nnot read\n")
    consent.have_it_turned(TURN)
    first, second, asked = written.getvalue().splitlines()
    assert "to and fro in 8 s, at most at 0.5 rad/s (28.6 °/s)" in first
    assert first.endswith("You can turn it by hand.")
    assert second.endswith("the observer lags.")
    assert asked == "Enter when it rotates: "
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
