"""A process that opens one link and speaks on it for the process that holds the board.

    python -m hil.service.board.link_process

What opens a link may hang, in a driver as well: then this process is ended, and nothing else waits.  It reads a JSON
object a line, {"do": "open" | "hello" | "safe" | "close", …}, and answers each with {"said": …} or {"refused": words}.
It ends when its input does.
"""

import json
import os
import queue
import select
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import Any

from hil.errors import InputError
from hil.errors.ending import ExitCode, line_of
from hil.wire import client
from hil.wire.endpoint import Endpoint
from hil.wire.errors import LinkError, WireError
from hil.wire.links import open_link

_MARGIN_S = 0.5  # beyond what the board is given, for this process to say that nothing came
_FAREWELL_S = 1.0


class LinkProcess:
    """The process from outside; one request at a time, each with a limit. Every method but `give_up` is for one
    thread.
    """

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "hil.service.board.link_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )

    def open(self, url: str, limit_s: float) -> None:
        """Open the link. Raises LinkError with what refuses it, or that it hangs; then this process has ended."""
        self._ask({"do": "open", "url": url}, limit_s, f"{url}: could not be opened within {limit_s:g} s")

    def hello(self, patience_s: float) -> dict[str, Any]:
        """Greet the board; what it says of itself. Raises LinkError."""
        return self._ask({"do": "hello", "within_s": patience_s}, patience_s + _MARGIN_S, "the link hangs")

    def safe(self, reason: int, patience_s: float) -> dict[str, Any]:
        """Bring the board to SAFE; its `state`, `reason` and `tick`. Raises LinkError."""
        asked = {"do": "safe", "reason": reason, "within_s": patience_s}
        return self._ask(asked, patience_s + _MARGIN_S, "the link hangs")

    def give_up(self) -> None:
        """End it now, from whichever thread; what is asked of it meanwhile is refused."""
        self._process.kill()

    def close(self) -> None:
        """Close the link well, or end the process."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(OSError):
            self._process.stdin.close()
        try:
            self._process.wait(_FAREWELL_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()

    def _ask(self, what: dict[str, Any], limit_s: float, late: str) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        output, heard, end = self._process.stdout.fileno(), b"", time.monotonic() + limit_s
        with suppress(BrokenPipeError):  # what follows says that it has ended
            self._process.stdin.write(json.dumps(what).encode() + b"\n")
            self._process.stdin.flush()
        while not heard.endswith(b"\n"):
            if not select.select([output], (), (), max(end - time.monotonic(), 0.0))[0]:
                self.give_up()
                raise LinkError(f"{late}; check its cable, its driver or its server")
            if not (more := os.read(output, 1 << 16)):
                raise LinkError("the link was given up")
            heard += more
        answer = json.loads(heard)
        if "refused" in answer:
            raise LinkError(answer["refused"])
        said: dict[str, Any] = answer["said"]
        return said


def main() -> None:
    """Do what is asked on standard input until it ends."""
    asked: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(asked,), daemon=True).start()
    endpoint: Endpoint | None = None
    while (what := asked.get()) is not None:
        try:
            if what["do"] == "open":
                endpoint = Endpoint(open_link(what["url"]))
                said: dict[str, Any] = {}
            else:
                assert endpoint is not None
                said = _done(endpoint, what)
            answer: dict[str, Any] = {"said": said}
        except (InputError, WireError, OSError) as error:
            answer = {"refused": line_of(error)}
        print(json.dumps(answer), flush=True)
    if endpoint is not None:
        with suppress(WireError, OSError):
            endpoint.close()
    os._exit(ExitCode.GOOD)


def _done(endpoint: Endpoint, what: dict[str, Any]) -> dict[str, Any]:
    if what["do"] == "hello":
        return client.connect(endpoint, what["within_s"])._asdict()
    status = client.make_safe(endpoint, what["reason"], what["within_s"])
    return {"state": status.state, "reason": status.reason, "tick": status.tick}


def _read(asked: "queue.SimpleQueue[dict[str, Any] | None]") -> None:
    """The thread that hears the input end while the other one hangs."""
    for line in sys.stdin:
        asked.put(json.loads(line))
    asked.put(None)
    time.sleep(_FAREWELL_S)
    os._exit(ExitCode.INTERRUPTED)


if __name__ == "__main__":
    main()
