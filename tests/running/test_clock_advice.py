"""Advice on clocks and modes, followed from every bench to every board: it ends, and never where it was before.

Boards are those of docs/wire.md (Clock modes): one that names neither LOCKSTEP nor PACED keeps REAL.
"""

import itertools
import re

import numpy as np
import pytest

from hil.bench import Bench, override
from hil.errors import InputError
from hil.records.lateness import Lateness
from hil.records.result import Answers, Load, Result
from hil.running import rehearsal as started
from hil.running.safety.preflight import require_suitable
from hil.verdict.machine import judge_machine
from hil.wire.messages import Capabilities, Identity
from tests.running import gyro
from tests.wire.board import SmallBoard

CLOCKS, MODES = ("lockstep", "paced", "real"), ("force", "gain")
BOARDS = [Capabilities(sum(bits)) for bits in itertools.product((0, 1), (0, 2), (0, 4), (0, 8)) if bits[0] or bits[1]]
_ADVICE = re.compile(r'use \[loop\] (clock|mode) = "(\w+)"')


def identity(able: Capabilities) -> Identity:
    told: Identity = SmallBoard().identity
    return told._replace(capabilities=int(able), tick_rate_Hz=gyro.RATE_HZ)


def refused(bench: Bench, able: Capabilities) -> str:
    """What is said of bench file and board, "" where they agree."""
    try:
        require_suitable(bench, identity(able), "link")
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("able", BOARDS)
@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("mode", MODES)
def test_before_a_run(able: Capabilities, clock: str, mode: str) -> None:
    """Followed step by step until the board and the bench file agree."""
    bench, been = override(gyro.bench(), {"loop": {"block": 20, "estimate_every": 20}}, "test"), []
    bench = override(bench, {"loop": {"clock": clock, "mode": mode}}, "test")
    while True:
        state = bench.loop.clock, bench.loop.mode
        assert state not in been, f"{been} leads back to {state}"
        been.append(state)
        told = refused(bench, able)
        if not told:
            break
        advice = _ADVICE.search(told)
        assert advice is not None, told
        bench = override(bench, {"loop": {advice[1]: advice[2]}}, "test")
    if bench.loop.clock == "lockstep":
        assert Capabilities.LOCKSTEP in able
    if bench.loop.clock == "paced":
        assert Capabilities.PACED in able


def late_run(link: str, bench: Bench) -> tuple[Result, Lateness]:
    answers = Answers(
        ticks=6000, in_time=4800, late=1200, unanswered=0, lost_to_board=0, lost_to_host=0, stopped=0, slow=1200
    )  # fmt: skip
    result = Result(
        run="r", link=link, clock="paced", seconds=1.5, samples=6000, answers=answers, complete=True,
        load=Load(loop=0.3, recorder=0.1, waited=0.9, stolen=0.0, pressed=0.9),
    )  # fmt: skip
    late_s = np.tile(np.r_[np.full(80, 1.0), np.full(320, 1e-4)], 15)
    return result, Lateness(
        late_s if "never" in link else np.where(late_s == 1.0, 2.5e-3, late_s),
        np.zeros(6000), gyro.RATE_HZ, 1, 1.0 / gyro.RATE_HZ, 0.2, 0.0,
    )  # fmt: skip


def test_after_a_run_the_latency_grows_and_lockstep_is_the_end() -> None:
    """Of a board that stays late whatever was said of it; each next step names the option."""
    bench, latency, been = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05}), 1, []
    link = "pty:s-slow"
    while True:
        result, late = late_run(link, bench)
        told = judge_machine(result, bench, (), "bench.toml", late=late, latency_ticks=latency).next
        assert told is not None
        assert told not in been
        been.append(told)
        if "--clock lockstep" in told:
            break
        link = told.partition("--link ")[2].strip("'")
        found = re.fullmatch(r"pty:s-slow\?latency=(\d+)", link)
        assert found is not None
        assert int(found[1]) > latency
        latency = int(found[1])
    assert been[0].startswith("hil run bench.toml --link 'pty:s-slow?latency=10'")


@pytest.mark.parametrize("becomes", ["is started", "would be started"])
def test_a_look_without_a_run_says_what_would_be_started(monkeypatch: pytest.MonkeyPatch, becomes: str) -> None:
    bench = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05})
    monkeypatch.setattr(started, "rehearse", lambda *_: (late_run("pty:s-slow", bench)[1], 1))
    found = started.measured(bench, "pty:s-slow", lambda _: None, becomes=becomes)
    assert f"; the board {becomes} with latency 10 ticks" in found.words


def test_of_a_board_of_ones_own_the_latency_is_named() -> None:
    bench = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05})
    result, late = late_run("serial:/dev/ttyACM0", bench)
    told = judge_machine(result, bench, (), "bench.toml", late=late, latency_ticks=1).next
    assert told is not None
    assert told.startswith("a latency of 10 ticks in the board's firmware (hil emulate --latency), then hil run")


def test_where_no_latency_holds_an_emulated_board_waits() -> None:
    bench = gyro.bench(12.0, "paced", limits={"late_fraction": 0.05})
    result, late = late_run("pty:never", bench)
    assert (
        judge_machine(result, bench, (), "b.toml", late=late, latency_ticks=1).next
        == "hil run b.toml --link pty:never --clock lockstep"
    )
