"""A board in the same process, for lockstep: the same bytes as on a serial line, without a line."""

from importlib.metadata import entry_points
from typing import Protocol

from hil.wire.errors import LinkClosed, LinkError
from hil.wire.link import Link
from hil.wire.link_name import Emulated

ENTRY_POINT_GROUP = "hil.emulators"
OWN = "device_emulator"


class Board(Protocol):
    """What a board in the same process does."""

    def exchange(self, data: bytes) -> bytes:
        """Take the host's bytes, return everything the board has to say to them."""
        ...

    # A board may have `memory: tuple[int, int]` as well: addresses of a function and of its first argument, as
    # `link_t.answer` of hil/running/native/structs.h, which puts down 65,536 bytes at most. The host's turn then calls
    # it without Python.

    def close(self) -> None: ...


class InprocLink(Link):
    """A link to a board in the same process. Nothing ever arrives by itself: what can be received is the
    answer to what was sent, so `receive` does not wait."""

    name = "inproc"

    def __init__(self, board: Board) -> None:
        self._board: Board | None = board
        self._pending = b""

    def fileno(self) -> None:
        return

    @property
    def memory(self) -> tuple[int, int] | None:
        """How C asks the board by itself; None where only Python can. Raises LinkClosed."""
        if self._board is None:
            raise LinkClosed("inproc: the link is closed")
        return getattr(self._board, "memory", None)

    def put_back(self, data: bytes) -> None:
        """Have this received next: an answer that was fetched and not read."""
        self._pending = data + self._pending

    def send(self, data: bytes) -> None:
        """Give `data` to the board and keep its answer. Raises LinkClosed."""
        if self._board is None:
            raise LinkClosed("inproc: the link is closed")
        answer = self._board.exchange(data)
        self._pending = self._pending + answer if self._pending else answer

    def receive(self, timeout_s: float | None) -> bytes:
        """All that the board has answered so far, b"" if nothing; the timeout does not matter. Raises
        LinkClosed."""
        if self._board is None:
            raise LinkClosed("inproc: the link is closed")
        data, self._pending = self._pending, b""
        return data

    def close(self) -> None:
        if self._board is not None:
            board, self._board = self._board, None
            board.close()


def open_inproc(board: Emulated, truth: str | None = None, seed: int | None = None) -> InprocLink:
    """A link to an emulated board that is installed as entry point of the group `hil.emulators`: the one that the link
    names, else the bench's own, else the first.

    Raises:
        LinkError: no such emulator is installed, or it cannot be loaded.
        Whatever the bench's own emulator raises on a bad scenario; what another package's does is a LinkError.
    """
    there = {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
    if not there:
        raise LinkError(f"{board.url}: no emulator is installed; install the package that provides {ENTRY_POINT_GROUP}")
    name = board.emulator or (OWN if OWN in there else min(there))
    if name not in there:
        raise LinkError(f"{board.url}: no emulator of that name; known: {', '.join(sorted(there))}")
    try:
        opener = there[name].load()
    except Exception as error:  # whatever another package does wrong
        raise LinkError(
            f"{board.url}: {there[name].value} cannot be loaded: {error}; mend or remove the package that brings it"
        ) from error
    try:
        return InprocLink(opener(board.scenario, truth, seed, **board.changes))
    except Exception as error:
        if name == OWN:
            raise
        raise LinkError(f"{board.url}: the emulator {name} cannot: {error}") from error
