"""The loop closed in this process: the real loop, codecs and board, with a link that a test can meddle with.

A `HandPaced` board is one on wall time whose clock is turned by the host's own waiting: each wait that finds
nothing lets one tick pass. So everything that happens between a host and a board that does not wait for it
(lost samples, lost answers, a host that was stopped) happens here at chosen ticks, the same every time.
"""

import math
import os
import time
from collections.abc import Callable, Container, Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.scenario import load
from device_emulator.truth_file import TruthFile, truth_metadata
from estimator.observer import Observer
from hil.bench import Bench, override
from hil.inputs.declared import board_device_of, controller_settings_of, observer_settings_of
from hil.records.result import Answers
from hil.records.runfolder import RunFolder
from hil.records.summary import summarise
from hil.records.truth import read_truth
from hil.running.loop.skeleton import Counters
from hil.running.process.clock import ClockExchanges
from hil.running.process.worker import make_loop
from hil.running.recording.recorder import record_here
from hil.running.recording.tracks import run_layouts
from hil.running.safety.preflight import configure
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.inproc import InprocLink
from hil.wire.link import Link
from hil.wire.messages import ClockMode, SafeReason
from tests.running.gyro import RATE_HZ


class HandPaced(Link):
    """Link to a board in this process that goes on whether it is answered or not.

    `lost`: ticks whose SENSE never arrives. `unheard`: ticks whose answer never arrives. `stops`: from that
    tick on so many ticks pass before the host gets to read again. `chunk`: bytes that it gets at a time.
    """

    name = "hand-paced"

    def __init__(
        self,
        board: Board,
        *,
        lost: Container[int] = (),
        unheard: Container[int] = (),
        stops: Mapping[int, int] | None = None,
        chunk: int = 4096,
    ) -> None:
        self.board = board
        self._lost, self._unheard, self._stops = lost, unheard, dict(stops or {})
        self._chunk = chunk
        self._always = os.open(os.devnull, os.O_RDONLY)  # ready whenever someone waits for it
        self._pending = b""

    def fileno(self) -> int:
        return self._always

    def send(self, data: bytes) -> None:
        if not (self.board.streaming and self.board.tick in self._unheard):
            self._pending += self.board.exchange(data)

    def receive(self, timeout_s: float | None) -> bytes:
        if not self._pending:
            ticks, before = self._stops.pop(self.board.rows, 1), self.board.rows
            for _ in range(ticks):
                self._tick()
            if ticks > 1:  # by its own clock the host was away, too
                time.sleep((self.board.rows - before) / RATE_HZ)
        data, self._pending = self._pending[: self._chunk], self._pending[self._chunk :]
        return data

    def close(self) -> None:
        os.close(self._always)
        self.board.close()

    def _tick(self) -> None:
        if self.board.streaming:
            tick = self.board.rows
            said = self.board.block()
            if tick not in self._lost:
                self._pending += said
        else:
            self.board.coast(1)


def board(scenario: Path, clock: ClockMode = ClockMode.LOCKSTEP, truth: Path | None = None) -> Board:
    """An emulated board in this process; close it to finish its truth file."""
    what = load(scenario)
    if truth is None:
        return Board(what, Device(what), (clock,))
    file = TruthFile(truth, truth_metadata(what, None))

    class Closing(Device):
        def close(self) -> None:
            super().close()
            file.close()

    return Board(what, Closing(what, None, file.add), (clock,))


def close_loop(
    link: Link,
    bench: Bench,
    folder: Path,
    meddle: Callable[[Observer], None] = lambda _: None,
    *,
    ask_every: int = 0,
) -> tuple[RunFolder, Counters]:
    """Run `bench` against the board behind `link`, as the worker does; `meddle` gets the observer first. The board is
    asked for its time every so many samples, or never."""
    bench = override(bench, {"limits": {"overtime": 100.0}}, "test")  # no wall time runs here
    endpoint = Endpoint(link)
    identity = client.connect(endpoint)
    observer = Observer(board_device_of(bench), observer_settings_of(bench), controller_settings_of(bench, identity))
    registers = configure(endpoint, identity, bench)
    samples = round(bench.loop.duration_s * identity.tick_rate_Hz)
    folder.mkdir()
    with closing(endpoint), record_here(folder, run_layouts(observer, bench, identity)) as recording:
        loop = make_loop(endpoint, identity, bench, observer, recording.tracks, registers)
        meddle(observer)
        clock = ClockExchanges(endpoint, recording["clock"], per_s=math.inf) if ask_every else None
        if clock is not None:
            clock.burst()
            loop.between = clock.follow
        loop.arm()
        loop.run(samples, lambda _: None if clock is None else clock.ask(), ask_every or samples)
        loop.finish(SafeReason.HOST_REQUEST)
    return RunFolder(folder), loop.counters


def answers_of(run: RunFolder, counters: Counters) -> Answers:
    """What became of each sample, by the record and by what loop and board have counted."""
    result = summarise(run, {"stopped": counters.stopped, "board_late": counters.board["late"]})
    assert result.answers is not None
    assert (result.late, result.lost) == (result.answers.late, result.answers.lost_to_host + result.answers.stopped)
    assert sum(result.answers.parts.values()) == result.answers.ticks == result.samples + result.lost
    return result.answers


def amiss(answers: Answers | None) -> dict[str, int]:
    """How many samples went which wrong way, of those that any did."""
    assert answers is not None
    ways = {"late", "unanswered", "lost_to_board", "lost_to_host", "stopped"}
    return {way: count for way, count in answers.model_dump(include=ways).items() if count}


def waiting(scenario: Path, truth: Path | None = None) -> InprocLink:
    """A board in lockstep: it waits for every answer."""
    return InprocLink(board(scenario, truth=truth))


def angle_errors(run: RunFolder, truth: Path, from_s: float) -> NDArray[np.float64]:
    """Reported minus true angle from `from_s` on, zero at its start."""
    estimates = run.estimates
    assert estimates is not None
    true = read_truth(truth)
    ours, theirs = true.at(estimates.tick)
    scored = estimates.t_s[ours] >= from_s
    error = (estimates["angle_rad"][ours] - true["angle_rad"][theirs])[scored]
    return np.asarray(error - error[0])
