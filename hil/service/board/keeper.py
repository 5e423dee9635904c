"""The process that holds the board: started by the service, and left alone by its end, however that comes.

    python -m hil.service.board.keeper SOCKET

It listens at SOCKET, where a service that was started anew finds it again.  Killing the service changes nothing for the
loop, which this process is the parent of; when this process dies, the kernel tells the loop, which brings the board to
SAFE.  Without a service for a while and without a run it ends by itself.
"""

import faulthandler
import json
import os
import selectors
import signal
import socket
import sys
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any

from hil.records.changes import note_change
from hil.running.request import RunRequest
from hil.service.board.held_board import HeldBoard, Start
from hil.service.board.messages import LARGEST, LOOP, STACKS, Message, in_folder, receive, send
from hil.wire.link_name import parse_link

_ALONE_S = 15.0  # without a service and without a run
_LOOK_S = 1.0


class _Keeper:
    def __init__(self, place: Path) -> None:
        self._place = place
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with in_folder(place) as short:
            self._listener.bind(short)
        self._listener.listen(4)
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)
        self._wake, self._woken = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._selector.register(self._wake, selectors.EVENT_READ, self._tell_news)
        self._news: deque[tuple[socket.socket | None, Message]] = deque()
        self._clients: list[socket.socket] = []
        self._shared: dict[str, tuple[Message, int]] = {}
        self._line: socket.socket | None = None
        self._out = Path()
        self._starting = False
        self._ending = False
        self._alone_since = time.monotonic()
        self._board = HeldBoard(lambda message: self._later(None, message))

    def serve(self) -> None:
        """Until told to end, or left alone."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._end_on_signal)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        try:
            while not (self._ending and not self._board.busy):
                for key, _ in self._selector.select(_LOOK_S):
                    key.data()
                if self._clients or self._board.busy:
                    self._alone_since = time.monotonic()
                elif time.monotonic() - self._alone_since > _ALONE_S:
                    self._ending = True
        finally:
            self._listener.close()
            self._place.unlink(missing_ok=True)
            self._board.end()
            self._tell_news()
            for client in list(self._clients):
                self._drop(client)
            self._let_line_go()
            self._selector.close()

    def _end_on_signal(self, *_: object) -> None:
        self._end()
        with suppress(BlockingIOError):
            os.write(self._woken, b".")

    def _end(self) -> None:
        self._ending = True
        self._board.safe(lambda _: None)

    # -- the service ---------------------------------------------------------------------------------------------------

    def _accept(self) -> None:
        with suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)
            client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 * LARGEST)
            self._clients.append(client)
            self._selector.register(client, selectors.EVENT_READ, lambda: self._hear(client))
            self._send(client, {"board": self._board.state})
            for message, descriptor in self._shared.values():
                self._send(client, message, descriptor)

    def _hear(self, client: socket.socket) -> None:
        try:
            received = receive(client)
        except BlockingIOError:
            return
        except (OSError, ValueError):
            received = None
        if received is None:
            self._drop(client)
            return
        message, _ = received
        number = message.get("n")
        self._do(message, lambda answer: self._later(client, {"n": number, **answer}))

    def _drop(self, client: socket.socket) -> None:
        if client in self._clients:
            self._clients.remove(client)
            self._selector.unregister(client)
            client.close()

    def _do(self, message: Message, answer: Any) -> None:
        match message["do"]:
            case "connect":
                self._board.connect(parse_link(message["link"]), answer, message["bench"])
            case "disconnect":
                self._board.disconnect(answer)
            case "start":
                self._start(message, answer)
            case "safe":
                self._board.safe(answer)
            case "settings":
                self._settings(message["settings"], answer)
            case "end":
                answer({"said": {}})
                self._end()
            case other:
                answer({"refused": f"{other!r}: unknown"})

    def _start(self, message: Message, answer: Any) -> None:
        if self._starting or self._board.busy:
            answer({"refused": "a run is under way; stop it, or wait for its end"})
            return
        self._starting = True

        def started(said: Message) -> None:
            self._starting = False
            answer(said)

        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self._out = Path(message["out"])
        self._let_line_go()
        self._line = ours
        self._selector.register(ours, selectors.EVENT_READ, self._hear_loop)
        self._board.start(Start(RunRequest.of_json(message["request"]), self._out, theirs, message["bench"]), started)

    def _settings(self, settings: dict[str, float], answer: Any) -> None:
        if self._line is None:
            answer({"refused": "no loop runs"})
            return
        try:
            self._line.send(json.dumps(settings).encode())
        except OSError:
            answer({"refused": "no loop runs"})
        else:
            answer({"said": {}})

    # -- the loop ------------------------------------------------------------------------------------------------------

    def _hear_loop(self) -> None:
        assert self._line is not None
        try:
            received = receive(self._line)
        except BlockingIOError:
            return
        except (OSError, ValueError):
            received = None
        if received is None:
            self._let_line_go()
            return
        message, descriptors = received
        if descriptors:  # of a ring, or of the loop's process
            self._shared[message.get("track", LOOP)] = message, descriptors[0]
            for client in list(self._clients):
                self._send(client, message, descriptors[0])
        elif "armed" in message:
            self._board.armed()
        elif "changed" in message:
            self._board.changed(message["changed"])
            self._keep_change(message)
        elif "safe" in message:
            self._board.answered_safe(message["safe"])
            self._later(None, {"safe": message["safe"]})

    def _keep_change(self, message: Message) -> None:
        run = self._board.state["run"]
        if run is None:
            return
        with suppress(OSError):
            note_change(self._out / run, message["tick"], message["changed"])

    def _let_line_go(self) -> None:
        if self._line is not None:
            self._selector.unregister(self._line)
            self._line.close()
            self._line = None
        for _, descriptor in self._shared.values():
            os.close(descriptor)
        self._shared.clear()

    # -- what is told --------------------------------------------------------------------------------------------------

    def _later(self, client: socket.socket | None, message: Message) -> None:
        """Have it told by the main thread; to everybody where `client` is None."""
        self._news.append((client, message))
        with suppress(BlockingIOError):
            os.write(self._woken, b".")

    def _tell_news(self) -> None:
        with suppress(BlockingIOError):
            os.read(self._wake, 4096)
        while self._news:
            client, message = self._news.popleft()
            for one in list(self._clients) if client is None else [client]:
                self._send(one, message)

    def _send(self, client: socket.socket, message: Message, descriptor: int | None = None) -> None:
        try:
            send(client, message, descriptor)
        except BlockingIOError:  # it does not read: it will be told the next state
            if "board" not in message:
                self._drop(client)
        except OSError:
            self._drop(client)


def main() -> None:
    faulthandler.register(STACKS, all_threads=True)
    _Keeper(Path(sys.argv[1])).serve()


if __name__ == "__main__":
    main()
