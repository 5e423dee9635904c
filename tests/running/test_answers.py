"""What became of each sample: the count beside what a link really did, in force and gain mode.

The links here lose samples, lose answers, hold answers up and stop the host at chosen ticks, so that each part of the
count is known beforehand; the parts follow docs/reference/run-folder.md.
"""

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.line import Line
from device_emulator.scenario import load
from estimator.observer import Observer
from hil.bench import Bench
from hil.progress import Progress
from hil.records.result import Answers
from hil.records.runfolder import RunFolder
from hil.running.request import RunRequest
from hil.running.run import run
from hil.wire.inproc import InprocLink
from hil.wire.messages import ClockMode, State
from tests.running import gyro
from tests.running.closed import HandPaced, amiss, answers_of, board, close_loop

TICKS = 4000
BLOCK = 20


class HeldUp(HandPaced):
    """Answers to chosen ticks reach the board only with the one after them, which is in time."""

    def __init__(self, *args: Any, held_up: set[int], **options: Any) -> None:
        super().__init__(*args, **options)
        self._held_up, self._travelling = held_up, b""

    def send(self, data: bytes) -> None:
        if self.board.streaming and self.board.tick in self._held_up:
            self._travelling += data
            return
        travelling, self._travelling = self._travelling, b""
        for frame in (travelling, data) if travelling else (data,):
            super().send(frame)


class Clogged(HandPaced):
    """From a tick on nothing reaches the host while so many waits last; then it all comes, when the host next says
    something: rows from before the board stopped come together with what it answers.
    """

    def __init__(self, *args: Any, clogged: tuple[int, int], **options: Any) -> None:
        super().__init__(*args, **options)
        self._from, self._waits = clogged
        self._behind: bytes | None = None
        self.streamed = self.coasted = 0  # ticks of that time, until the board is armed again

    def send(self, data: bytes) -> None:
        super().send(data)
        if self._behind is not None:
            self._pending, self._behind = self._behind + self._pending, None

    def receive(self, timeout_s: float | None) -> bytes:
        if self._behind is not None:
            time.sleep(0.01)  # until the host asks by itself
            return b""
        if not self._pending and self._waits and self.board.rows >= self._from:
            for _ in range(self._waits):
                streams, before = self.board.streaming, self.board.rows
                self._tick()
                self.streamed += (self.board.rows - before) if streams else 0
                self.coasted += 0 if streams else (self.board.rows - before)
            self._waits, self._behind, self._pending = 0, self._pending, b""
            return b""
        return super().receive(timeout_s)


def force() -> Bench:
    return gyro.bench(1.0, "paced", link={"watchdog_s": 0.02, "timeout_s": 0.5})


def gain(watchdog_s: float = 0.1) -> Bench:
    loop = {"mode": "gain", "block": BLOCK, "estimate_every": BLOCK}
    return gyro.bench(1.0, "paced", loop=loop, link={"watchdog_s": watchdog_s, "timeout_s": 0.5})


def counted(tmp_path: Path, declared: Bench, link: type[HandPaced] = HandPaced, **options: Any) -> Answers:
    """The count of a second of S-slow on a board that does not wait."""
    device = board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED)
    return answers_of(*close_loop(link(device, **options), declared, tmp_path / "run"))


@pytest.mark.slow
def test_an_undisturbed_run_is_answered_in_time(tmp_path: Path) -> None:
    answers = counted(tmp_path, force())
    assert (answers.ticks, answers.in_time, amiss(answers)) == (TICKS, TICKS, {})


@pytest.mark.moderate
def test_answers_that_come_late(tmp_path: Path) -> None:
    held_up = set(range(500, 3900, 17))
    answers = counted(tmp_path, force(), HeldUp, held_up=held_up)
    assert amiss(answers) == {"late": len(held_up)}


@pytest.mark.slow
@pytest.mark.parametrize(("declared", "waits", "width"), [(force(), 300, 1), (gain(watchdog_s=0.02), 15, BLOCK)])
def test_rows_from_before_a_stop_that_come_after_it(
    tmp_path: Path, declared: Bench, waits: int, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They and the gap among them have nothing to do with the stop: that is what is missing between them and the first
    row after the board was armed again, whose motion is found anew once.
    """
    forgotten: list[int] = []
    lose_phase = Observer.lose_phase
    monkeypatch.setattr(
        Observer, "lose_phase", lambda self, missing: (forgotten.append(missing), lose_phase(self, missing))[1]
    )
    link = Clogged(
        board(gyro.scenario(tmp_path / "board.toml"), ClockMode.PACED),
        clogged=(2000, waits),
        lost=(2000 + 2 * width,),
    )
    folder, counters = close_loop(link, declared, tmp_path / "run")
    answers = answers_of(folder, counters)
    assert counters.rearmed == 1
    assert link.coasted > 0
    assert link.streamed > 3 * width
    assert answers.lost_to_host == width
    assert answers.stopped == link.coasted
    assert answers.unanswered + answers.late + answers.lost_to_board >= link.streamed - width
    assert forgotten == [link.coasted]


class OnLine:
    """A board behind its line, which notes in which state each tick passed."""

    def __init__(self, device: Board, line: Line) -> None:
        self.exchange, self.close = line.exchange, device.close
        self.ticks: Counter[State] = Counter()
        block, coast = device.block, device.coast

        def noted(passing: Callable[..., Any]) -> Callable[..., Any]:
            def passed(*args: Any) -> Any:
                before, state = device.rows, device.state
                said = passing(*args)
                self.ticks[state] += device.rows - before
                return said

            return passed

        device.block, device.coast = noted(block), noted(coast)  # type: ignore[method-assign]


@pytest.mark.moderate
def test_in_lockstep_a_stop_takes_no_tick(tmp_path: Path) -> None:
    """A stall trips the watchdog; the board is armed again at once, and what it streamed meanwhile is lost, not
    stopped: the board itself says in which state each tick passed.
    """
    scenario = gyro.scenario(tmp_path / "board.toml")
    scenario.write_text(f"{scenario.read_text()}\n[[faults.stall]]\nstart_s = 0.5\nduration_s = 0.1\n")
    what = load(scenario)
    device = Board(what, Device(what), (ClockMode.LOCKSTEP,))
    behind = OnLine(device, Line(device, what))
    _, counters = close_loop(InprocLink(behind), gyro.bench(1.0), tmp_path / "run")  # type: ignore[arg-type]
    assert counters.rearmed == 1
    assert counters.stopped == behind.ticks[State.SAFE] == 0
    assert counters.lost > 300


@pytest.mark.moderate
def test_everything_at_once(tmp_path: Path) -> None:
    """Apart from each other, so that what one does cannot hide what another does."""
    lost, unheard, held_up = range(100, 1000, 9), range(1100, 1400, 3), set(range(2000, 3900, 7))
    answers = counted(tmp_path, force(), HeldUp, held_up=held_up, lost=lost, unheard=unheard, stops={1500: 50})
    expected = {
        "late": len(held_up),
        "unanswered": 49,
        "lost_to_board": len(unheard),
        "lost_to_host": len(lost),
    }
    assert amiss(answers) == expected


@pytest.mark.moderate
def test_gain_mode_late_matrices(tmp_path: Path) -> None:
    """A matrix is due a block after the one it answers; this one comes when the next is sent."""
    held_up = {tick + BLOCK - 1 for tick in range(1000, 3500, 100)}
    answers = counted(tmp_path, gain(), HeldUp, held_up=held_up)
    assert amiss(answers) == {"late": len(held_up) * BLOCK}


def test_a_count_that_does_not_add_up_is_refused() -> None:
    good = {"ticks": 9, "in_time": 4, "slow": 3, "late": 1, "unanswered": 1, "lost_to_board": 1, "lost_to_host": 1}
    assert Answers(**good, stopped=1).missed == 3
    with pytest.raises(ValidationError, match="the parts are 8 samples, ticks is 9"):
        Answers(**good, stopped=0)


@pytest.mark.beyond(1)
@pytest.mark.long
@pytest.mark.parametrize("mode", ["force", "gain"])
@pytest.mark.parametrize(
    "faults",
    [
        "lost = 0.02\ncorrupted = 0.002\nduplicated = 0.01\nreordered = 0.01\ndelayed = 0.01\ndelay_s = [0.0, 0.002]",
        'lost = 0.05\ntoward = "board"',
        'lost = 0.05\ntoward = "host"',
        "[[faults.stall]]\nstart_s = 0.5\nduration_s = 0.1",
    ],
    ids=["all", "to the board", "to the host", "stall"],
)
def test_on_a_bad_line_every_figure_comes_from_one_count(
    tmp_path: Path, mode: str, faults: str, no_report: None
) -> None:
    scenario = gyro.scenario(tmp_path / "board.toml")
    scenario.write_text(f"{scenario.read_text()}\n[faults]\n{faults}\n")
    loop = {} if mode == "force" else {"mode": "gain", "block": BLOCK, "estimate_every": BLOCK}
    told: list[Progress] = []
    done = run(RunRequest(gyro.bench(1.0, loop=loop), f"inproc:{scenario}"), tmp_path / "runs", progress=told.append)
    assert done.folder is not None
    result = RunFolder(done.folder).result
    assert result is not None
    assert result.answers is not None
    answers, counters = result.answers, result.counters
    assert answers.ticks == 4000 == result.samples + result.lost
    assert result.late == answers.late
    assert answers.in_time > 0.7 * answers.ticks
    block = BLOCK if mode == "gain" else 1
    if faults.startswith("lost = 0.05"):
        assert (answers.late, answers.unanswered) == (0, 0)
        to_board = counters["board_lost_seq"] * block
        if "host" in faults:
            assert answers.lost_to_board == 0
            assert answers.lost_to_host == counters["lost"] == counters["frames_lost"] * block > 0
        else:
            assert answers.lost_to_host == 0
            # The first is lost before the board is driven, when it holds nothing; the effect of the last is not seen.
            assert 0 < to_board - 3 * block <= answers.lost_to_board <= to_board
    if "stall" in faults and mode == "force":
        # It trips the watchdog, but in lockstep ticks stand still while the board is SAFE: it was armed again when the
        # 400 ticks went by whose rows the stall held back, of which the line kept the newest.
        assert counters["rearmed"] == 1
        assert answers.stopped == 0
        assert np.isclose(answers.lost_to_host + answers.unanswered, 400, atol=5)
