"""Emulated boards: started for a run, stopped after it, and their last words passed on when they die.

`hil` never imports the emulator: a board on a pty is the process ``python -m device_emulator``.  (A board
inside the host's process comes through an entry point; see `hil.wire.inproc`.)
"""

import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, NamedTuple

from hil.bench import examples
from hil.errors import InputError
from hil.progress import Progress, Watcher, untold
from hil.wire.link_name import Emulated, LabgridPlace, parse_link

_READY = "ready "
_TOLD_S = 1.0  # how often it is told that a board is still waited for …
_USUAL_S = 5.0  # … from here on
_STOP_S = 10.0


class Emulator:
    """A running emulator process; ``url`` is the link it serves, once `started` has returned it."""

    def __init__(self, process: subprocess.Popen[bytes], said: IO[bytes]) -> None:
        self.process = process
        self.url = ""
        self._said = said

    @property
    def failed(self) -> bool:
        """True once the process has ended by itself, other than well."""
        return self.process.poll() not in (None, 0)

    def last_words(self) -> str:
        """The last line the emulator wrote to its standard error."""
        self._said.seek(0)
        lines = self._said.read().decode("utf-8", "replace").strip().splitlines()
        if not lines:
            return f"ended with code {self.process.returncode} and no message"
        return lines[-1].removeprefix("device_emulator: ").removeprefix("error: ")

    def wait_ready(self, progress: Watcher) -> None:
        """Block until ``ready URL`` is there, for as long as the process lives; how long that takes is told.
        `InputError` with the emulator's message if it ends first.
        """
        begun = time.monotonic()
        for line in self._lines():
            waited_s = time.monotonic() - begun
            if line is None:
                if waited_s > _USUAL_S:
                    progress(Progress("board", 0, 0, note=f"waiting for the emulated board, {waited_s:.0f} s so far"))
            elif line.startswith(_READY):
                self.url = line.removeprefix(_READY).strip()
                return
            else:
                raise InputError(f"emulated board: expected a line 'ready URL', got {line[:60]!r}")
        self.process.wait()
        raise InputError(f"emulated board: {self.last_words()}")

    def _lines(self) -> Iterator[str | None]:
        """Lines of its standard output until that is closed, None now and then while none comes."""
        assert self.process.stdout is not None
        output, heard = self.process.stdout.fileno(), b""
        while True:
            if not select.select([output], [], [], _TOLD_S)[0]:
                yield None
                continue
            if not (more := os.read(output, 4096)):
                return
            *lines, heard = (heard + more).split(b"\n")
            yield from (line.decode("utf-8", "replace") for line in lines)

    def wait(self) -> None:
        """Block until the process ends by itself; `InputError` with its last words if it did not end well.

        In pieces: a signal that comes just before a wait begins is noticed when that wait is over.
        """
        while self.process.poll() is None:
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(_TOLD_S)
        if self.failed:
            raise InputError(f"emulated board: {self.last_words()}")

    def stop(self) -> None:
        """Ask the process to end, so that it closes its truth file; insist after a while."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


@contextmanager
def emulator(
    scenario: Path,
    *,
    link: str = "pty",
    truth: Path | None = None,
    seed: int | None = None,
    latency_ticks: int | None = None,
    rate_Hz: float | None = None,
    progress: Watcher = untold,
) -> Iterator[Emulator]:
    """Serve ``scenario`` for the length of the block, its board with another latency or sample rate where one is given.

    It runs in a session of its own: Ctrl-C belongs to the host, which sends SAFE before the board goes.
    `InputError` when the emulator cannot start, or died inside the block and so spoilt what the block did.
    """
    command = [sys.executable, "-m", "device_emulator", str(scenario), "--link", link, "--parent", str(os.getpid())]
    given = {"--truth": truth, "--seed": seed, "--latency": latency_ticks, "--rate": rate_Hz}
    command += [text for name, value in given.items() if value is not None for text in (name, str(value))]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=said, start_new_session=True
        )
        board = Emulator(process, said)
        try:
            board.wait_ready(progress)
            yield board
        except (ValueError, OSError) as error:
            if board.url and board.failed:
                raise InputError(f"emulated board died: {board.last_words()}") from error
            raise
        finally:
            board.stop()
            assert process.stdout is not None
            process.stdout.close()


def is_emulated(link: str) -> bool:
    """True for links that start their own board, where nothing real can be driven."""
    return link.partition(":")[0] in ("pty", "inproc")


def shown(link: str) -> str:
    """``link`` as a reader needs it: of an emulated board the scenario's name, not where its file lies."""
    if not is_emulated(link):
        return link
    board = parse_link(link)
    return replace(board, scenario=Path(board.scenario).name).url if isinstance(board, Emulated) else link


class Served(NamedTuple):
    """A link to open, and the emulated board behind it where one was started for it."""

    url: str
    board: Emulator | None = None

    @property
    def last_words(self) -> str:
        """What the board said when it died, "" while it lives or where none was started."""
        return self.board.last_words() if self.board is not None and self.board.failed else ""

    def ends_within(self, seconds: float) -> bool:
        """Whether a board that was started for the link has ended, or does so soon."""
        if self.board is None:
            return False
        with suppress(subprocess.TimeoutExpired):
            self.board.process.wait(seconds)
        return self.board.process.poll() is not None


@contextmanager
def served(
    link: str, *, truth: Path | None = None, seed: int | None = None, progress: Watcher = untold
) -> Iterator[Served]:
    """``link`` as something to open; behind ``pty:SCENARIO`` a board serves for the length of the block, behind
    ``labgrid:PLACE`` the place is held."""
    what = parse_link(link)
    if isinstance(what, Emulated) and what.kind == "pty":
        serving = emulator(
            Path(what.scenario), truth=truth, seed=seed, latency_ticks=what.latency_ticks, rate_Hz=what.rate_Hz,
            progress=progress,
        )  # fmt: skip
        with serving as board:
            yield Served(board.url, board)
    elif isinstance(what, LabgridPlace):
        from hil.boards.labgrid import leased

        with leased(what.place) as url:
            yield Served(url)
    else:
        yield Served(link)


def located(link: str, *, beside: Path | None = None) -> str:
    """``link`` by the name that says the same, with the scenario of an emulated board as a path; `InputError` where
    there is none, `LinkError` for what is no link.
    """
    place = parse_link(link)
    if isinstance(place, Emulated):
        return replace(place, scenario=str(examples.find("scenario", place.scenario, beside=beside))).url
    return place.url
