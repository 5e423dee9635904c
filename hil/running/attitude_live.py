"""The attitude while the runs last, as a page of its own on this machine: read from the records as they grow.

It stands beside the loops and never between them and their boards. The address has a word that nobody can guess;
nothing can be changed by it.
"""

import json
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, Self

from hil.bench.mount import Mount
from hil.errors import InputError
from hil.records.runfolder import RunFolder
from hil.running.attitude import together

_PERIOD_S = 0.5
_SHARE = 4.0  # so many times as long as it took to work an attitude out, it waits for the next


class LiveAttitude:
    """A server of the newest attitude for the length of the block.

    Attributes:
        url: where its page is.
        newest: what the page shows, JSON values.
    """

    def __init__(self, runs: Callable[[], Sequence[Path]], mount: Mount) -> None:
        self._runs, self._mount = runs, mount
        self.newest: dict[str, Any] = {"without": "the runs have not begun"}
        self._end = threading.Event()
        word = secrets.token_urlsafe(16)
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(self, word))
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/{word}/"
        self._threads = [
            threading.Thread(target=self._server.serve_forever, name="attitude-page", daemon=True),
            threading.Thread(target=self._follow, name="attitude", daemon=True),
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._server.shutdown()
        self._server.server_close()
        for thread in self._threads:
            thread.join()

    def _follow(self) -> None:
        took_s = 0.0
        while not self._end.wait(max(_PERIOD_S, _SHARE * took_s)):
            began = time.monotonic()
            try:
                found = together([RunFolder(run) for run in self._runs()], self._mount)
            except (InputError, OSError, ValueError) as error:  # of a record whose newest block is being written, too
                self.newest = {**self.newest, "without": str(error)}
                continue
            self.newest = {"without": "", **found.figures, "angles_rad": found.angles[-1].tolist()}
            took_s = time.monotonic() - began


def _handler(live: LiveAttitude, word: str) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path == f"/{word}/attitude.json":
                self._answer("application/json", json.dumps(live.newest).encode())
            elif self.path == f"/{word}/":
                self._answer(
                    "text/html; charset=utf-8", files("hil.running").joinpath("attitude_live.html").read_bytes()
                )
            else:
                self.send_error(404)

        def _answer(self, kind: str, body: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """Nothing is said of requests."""

    return Handler
