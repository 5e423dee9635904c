"""The service's side of the line to the process that holds the board: started when it is needed, found again after a
restart of the service.
"""

import asyncio
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

from hil.service.board.messages import LOOP, NOBODY, STACKS, Message, in_folder, receive, send
from hil.service.problems import Problem

_START_S = 20.0
_LOOK_S = 0.02


class BoardLine:
    """`heard` is called with each message that answers nothing, with the descriptor that came along, which it owns."""

    def __init__(self, private: Path, heard: Callable[[Message, int | None], None]) -> None:
        self._place = private / "board.sock"
        self._log = private / "board.log"
        self._heard = heard
        self._socket: socket.socket | None = None
        self._numbers = count(1)
        self._asked: dict[int, asyncio.Future[Message]] = {}
        self._closed = asyncio.Event()
        self._peer = 0
        self._process: subprocess.Popen[bytes] | None = None
        self._loop: int | None = None

    @property
    def attached(self) -> bool:
        return self._socket is not None

    def attach(self) -> bool:
        """Find the process that holds the board, if there is one."""
        if self._socket is not None:
            return True
        if not self._place.exists():
            return False
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            with in_folder(self._place) as short:
                sock.connect(short)
        except OSError:
            sock.close()
            return False
        sock.setblocking(False)
        self._socket = sock
        peer, _, _ = struct.unpack("3i", sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
        self._peer = peer
        self._closed.clear()
        asyncio.get_running_loop().add_reader(sock, self._hear)
        return True

    async def ask(self, do: str, patience_s: float = 30.0, **what: Any) -> dict[str, Any]:
        """Have it do something. Raises Problem where it is refused, or where there is no answer."""
        if self._socket is None:
            raise Problem(409, "no board is connected", "POST /api/board/connect")
        number = next(self._numbers)
        answered: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._asked[number] = answered
        try:
            send(self._socket, {"n": number, "do": do, **what})
            message = await asyncio.wait_for(answered, patience_s)
        except TimeoutError:
            with suppress(OSError):
                os.kill(self._peer, STACKS)
            raise Problem(
                503,
                f"the process that holds the board does not answer to {do!r}",
                f"{self._log.name} of the service says where its threads are",
            ) from None
        except OSError:
            raise Problem(503, "the process that holds the board is gone", "POST /api/board/connect") from None
        finally:
            self._asked.pop(number, None)
        if "refused" in message:
            raise Problem(409, message["refused"] or f"{do}: refused")
        said: dict[str, Any] = message["said"]
        return said

    async def start(self) -> None:
        """Start the process, unless there is one. Raises Problem."""
        if self.attach():
            return
        self._place.unlink(missing_ok=True)  # nobody listens there
        with self._log.open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "hil.service.board.keeper", str(self._place)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._process = process
        end = asyncio.get_running_loop().time() + _START_S
        while not self.attach():
            if process.poll() is not None or asyncio.get_running_loop().time() > end:
                raise Problem(503, "the process that holds the board did not start", f"{self._log.name} says why")
            await asyncio.sleep(_LOOK_S)

    def interrupt(self) -> None:
        """Have the loop bring its board to SAFE, if there is one, without waiting for the process that holds the board:
        it does more than that, and has to be asked all the same.
        """
        if self._loop is not None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._loop, signal.SIGTERM)

    def end_soon(self) -> None:
        """Have the board brought to SAFE and the process end; do not wait."""
        if self._socket is not None:
            with suppress(OSError):
                send(self._socket, {"n": 0, "do": "end"})

    async def end(self, patience_s: float) -> None:
        """Have the board brought to SAFE, the record closed, and the process end; wait for it."""
        if self._socket is None:
            return
        self.end_soon()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._closed.wait(), patience_s)
        self._let_go()
        await asyncio.to_thread(_ended, self._peer, patience_s)

    def _hear(self) -> None:
        while self._socket is not None:
            try:
                received = receive(self._socket)
            except BlockingIOError:
                return
            except (OSError, ValueError):
                received = None
            if received is None:
                self._let_go()
                return
            message, descriptors = received
            if "n" in message:
                if (answered := self._asked.get(message["n"])) is not None and not answered.done():
                    answered.set_result(message)
            elif LOOP in message:
                self._let_loop_go()
                self._loop = descriptors[0] if descriptors else None
            else:
                self._heard(message, descriptors[0] if descriptors else None)

    def _let_go(self) -> None:
        if self._socket is None:
            return
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()
        self._socket = None
        self._let_loop_go()
        self._closed.set()
        if self._process is not None:  # it is ending: nobody else waits for it
            threading.Thread(target=self._process.wait, daemon=True).start()
        for answered in self._asked.values():
            if not answered.done():
                answered.set_exception(OSError("gone"))
        self._heard({"board": NOBODY | {"words": "the process that held the board has ended"}}, None)

    def _let_loop_go(self) -> None:
        if self._loop is not None:
            os.close(self._loop)
            self._loop = None


def _ended(process: int, patience_s: float) -> None:
    """Wait until a process, whosever child it is, has ended."""
    try:
        watched = os.pidfd_open(process)
    except OSError:
        return
    try:
        select.select([watched], [], [], patience_s)
    finally:
        os.close(watched)
