"""A board in the host's own process, in lockstep: the entry point of the group `hil.emulators`."""

from pathlib import Path

from device_emulator.board import Board
from device_emulator.device import Device
from device_emulator.line import Line
from device_emulator.scenario import load
from device_emulator.truth_file import TruthFile, truth_metadata
from hil.wire.messages import ClockMode


class InprocessBoard:
    """What `hil.wire.inproc` asks of a board; `line` is what stands before it where the scenario has faults."""

    def __init__(self, board: Board, truth: TruthFile | None, line: Line | None) -> None:
        self._board = board
        self._truth = truth
        self.line = line
        self.exchange = board.exchange if line is None else line.exchange
        self.memory = board.memory if line is None else None

    def close(self) -> None:
        """Finish the truth file."""
        self._board.close()
        if self._truth is not None:
            self._truth.close()


def open_board(
    scenario: str,
    truth: str | None = None,
    seed: int | None = None,
    latency_ticks: int | None = None,
    rate_Hz: float | None = None,
) -> InprocessBoard:
    """The board of a scenario file. It writes its true states to `truth`; `seed`, `latency_ticks` and `rate_Hz`
    override the scenario's.

    Raises `ScenarioError`, one line, if the scenario cannot be emulated or the truth file cannot be made.
    """
    what = load(Path(scenario), latency_ticks=latency_ticks, rate_Hz=rate_Hz)
    file = None if truth is None else TruthFile(Path(truth), truth_metadata(what, seed))
    device = Device(what, seed, None if file is None else file.add)
    board = Board(what, device, (ClockMode.LOCKSTEP,))
    return InprocessBoard(board, file, Line(board, what, seed) if what.faults.on_the_line else None)
