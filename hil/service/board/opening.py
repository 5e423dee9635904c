"""The opening of a link: it takes as long as it takes, in a thread and a process of its own, and can be given up.

An emulated board is started first.
"""

import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any

from hil.boards.emulation import Served, served
from hil.errors import InputError
from hil.errors.ending import line_of
from hil.progress import Progress
from hil.service.board.link_process import LinkProcess
from hil.wire.errors import LinkError
from hil.wire.link_name import Emulated, LinkName, UdpGroup
from hil.wire.messages import SafeReason

OPEN_S = 15.0
"""For a link to be opened, the start of the process that does it included."""
CONNECT_S = 2.0
PATIENCE_S = 0.35  # for an answer of a board that nobody drives
_IN_PROCESS_S = 60.0  # for a board in this machine's own processes


class Opening:
    """Begins at once; `told` is called, in its thread, with how far it is, `done` when it has come to its end.

    board: one that serves already, None to start what the link starts.  greet: whether to say HELLO, which lifts a
    latch.  reason: of the SAFE by which the board is asked for its state.

    Attributes:
        error: why there is no link, "" where there is one; a board that was started here serves all the same.
        resumed: whether the board served already.
        identity, status: what the board said; None where it was not asked.
        stack: what ends the board that was started here.
    """

    def __init__(
        self,
        link: LinkName,
        board: Served | None,
        *,
        greet: bool,
        reason: SafeReason,
        done: Callable[["Opening"], None],
        told: Callable[[str], None],
    ) -> None:
        self.link, self.board, self.greet, self.reason = link, board, greet, reason
        self.resumed = board is not None
        self.process: LinkProcess | None = None
        self.stack = ExitStack()
        self.error = ""
        self.identity: dict[str, Any] | None = None
        self.status: dict[str, Any] | None = None
        self._done, self._told = done, told
        self._lock = threading.Lock()
        self._given_up = False
        threading.Thread(target=self._open, name="opening", daemon=True).start()

    def give_up(self) -> None:
        """Do not wait for it any more: what comes of it is let go by itself."""
        with self._lock:
            self._given_up = True
            if self.process is not None:
                self.process.give_up()

    def close(self) -> None:
        """Let the link go, and the board that was started for it end."""
        if self.process is not None:
            self.process.close()
        with suppress(InputError):  # of a board that died meanwhile
            self.stack.close()

    def _open(self) -> None:
        try:
            self._try()
        except Exception as error:  # noqa: BLE001 - of a thread: it is told
            self.error = line_of(error)
        with self._lock:
            if self._given_up:
                self.error = self.error or "given up"
        if self.error and self.process is not None:
            self.process.close()
            self.process = None
        self._done(self)

    def _tell(self, progress: Progress) -> None:
        if not self._given_up:
            self._told(progress.note)

    def _try(self) -> None:
        inproc = isinstance(self.link, Emulated) and self.link.kind == "inproc"
        if self.board is None:
            self.board = (
                Served(self.link.url)
                if inproc
                else self.stack.enter_context(served(self.link.url, progress=self._tell))
            )
        with self._lock:
            if self._given_up:
                raise LinkError("given up")
            self.process = LinkProcess()
        self.process.open(self.board.url, _IN_PROCESS_S if inproc else OPEN_S)
        if inproc:  # nothing to hold: the loop has a board of its own
            self.process.close()
            self.process = None
            return
        if self.greet or isinstance(self.link, UdpGroup):  # where a session begins with it
            self.identity = self.process.hello(CONNECT_S)
        self.status = self.process.safe(self.reason, CONNECT_S)  # it may only just have started
