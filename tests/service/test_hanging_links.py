"""A link that never opens: nothing waits for it, SAFE and disconnect least of all."""

import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

from tests.service.serving import Serving, serving
from tests.service.test_board import Operator, until

AT_ONCE_S = 1.0
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def silent() -> Iterator[str]:
    """A link to a server that takes a connection and says nothing to it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken: list[socket.socket] = []

        def take() -> None:
            with suppress(OSError):
                while True:
                    taken.append(server.accept()[0])

        threading.Thread(target=take, daemon=True).start()
        yield f"can:socketcand:can0?host=127.0.0.1&port={server.getsockname()[1]}"
        for one in taken:
            one.close()


@pytest.fixture(scope="module")
def bench(silent: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serving]:
    with serving(tmp_path_factory.mktemp("hanging") / "runs", "--link", silent) as running:
        yield running


class Asked(threading.Thread):
    """A request that is waited for by a thread of its own."""

    def __init__(self, operator: Operator, link: str) -> None:
        super().__init__(daemon=True)
        self.operator, self.link, self.answer = operator, link, None
        self.start()

    def run(self) -> None:
        headers = {"x-lease": self.operator.lease}
        self.answer = self.operator.service.ask("POST", "/api/board/connect", json={"link": self.link}, headers=headers)


def timed(service: Serving, path: str, **given: Any) -> tuple[float, Any]:
    begin = time.monotonic()
    answer = service.ask("POST", path, **given)
    return time.monotonic() - begin, answer


def test_safe_and_disconnect_do_not_wait_for_a_link_that_hangs(bench: Serving, silent: str) -> None:
    operator = Operator(bench)
    asked = Asked(operator, silent)
    until(lambda: operator.state["words"] == "connecting")
    for _ in range(3):
        took, safe = timed(bench, "/api/board/safe")
        assert (safe.status_code, took < AT_ONCE_S) == (200, True), (took, safe.text)
        assert safe.json()["confirmed"] is None
        assert "no board" in safe.json()["words"]
    took, gone = timed(bench, "/api/board/disconnect", headers={"x-lease": operator.lease})
    assert (gone.status_code, took < 2 * AT_ONCE_S) == (200, True), (took, gone.text)  # it ends the keeper as well
    asked.join(10.0)
    assert asked.answer is not None
    assert asked.answer.status_code in (409, 503)
    assert "\n" not in asked.answer.json()["error"]
    state = operator.ask("POST", "/api/board/connect", json={"link": "pty:s-slow"})  # and the next one works
    assert state["connected"]
    operator.ask("POST", "/api/board/disconnect")
    bench.ask("DELETE", "/api/lease", headers={"x-lease": operator.lease})


def test_a_link_that_hangs_is_refused_after_a_while(bench: Serving, silent: str) -> None:
    operator = Operator(bench)
    took, refused = timed(bench, "/api/board/connect", json={"link": silent}, headers={"x-lease": operator.lease})
    assert refused.status_code == 409
    assert took < 60.0
    # by the wire's own limit, or by that of the process where this machine is busy
    assert re.search("not open within|could not be opened within", refused.json()["error"])
    bench.ask("DELETE", "/api/lease", headers={"x-lease": operator.lease})


def test_wherever_it_is_opened(silent: str) -> None:
    begin = time.monotonic()
    program = f"from hil.wire.links import open_link; open_link({silent!r})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert "not open within 6 s; does whatever serves the adapter answer?" in done.stderr
    assert time.monotonic() - begin < 60.0
