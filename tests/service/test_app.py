"""The service's frame: it begins, says where it is, answers, refuses in one form, and ends."""

import asyncio
import json
import os
import signal
import socket
import stat
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from hil.service.serve import Where, listening_socket
from tests.forked import hil_says
from tests.service.serving import Serving, serving


@pytest.mark.moderate
def test_the_page_and_its_description_are_there(service: Serving) -> None:
    page = httpx.get(service.url)
    assert page.status_code == 200
    assert "gyrohil" in page.text
    description = httpx.get(service.url + "openapi.json").json()
    assert description["info"]["title"] == "gyrohil"
    assert "/api/who" in description["paths"]


def test_health_needs_no_token_and_says_nothing(service: Serving) -> None:
    assert service.ask("GET", "/healthz", token="").json() == {"status": "ok"}


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [("GET", "/api/nothing", 404), ("POST", "/api/who", 405), ("GET", "/api/audit?limit=x", 422), ("GET", "/x", 404)],
)
def test_a_refusal_is_one_line_and_a_remedy(service: Serving, method: str, path: str, status: int) -> None:
    answer = service.ask(method, path)
    assert answer.status_code == status
    body = answer.json()
    assert set(body) == {"error", "remedy"}
    assert body["error"]
    assert body["remedy"]
    assert "\n" not in body["error"] + body["remedy"]


@pytest.mark.slow
def test_programs_of_the_same_user_find_it_while_it_lasts(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    with serving(folder) as running:
        found = folder / ".service" / "serve.json"
        assert stat.S_IMODE(found.stat().st_mode) == 0o600
        entry = json.loads(found.read_text())
        assert entry["url"] == running.url
        assert entry["pid"] == running.process.pid
        assert running.ask("GET", "/api/who", token=entry["token"]).status_code == 200
    assert not found.exists()


@pytest.mark.moderate
def test_an_answer_does_not_wait_for_an_acknowledgement(tmp_path: Path) -> None:
    """Without TCP_NODELAY on what asyncio accepts, that takes 40 ms: of SAFE, too."""

    async def accepted(listening: socket.socket) -> int:
        options: asyncio.Queue[int] = asyncio.Queue()

        async def look(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            theirs = writer.get_extra_info("socket")
            options.put_nowait(theirs.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
            writer.close()

        async with await asyncio.start_server(look, sock=listening):
            _, writer = await asyncio.open_connection(*listening.getsockname()[:2])
            try:
                return await options.get()
            finally:
                writer.close()

    with listening_socket(Where(tmp_path)) as listening:
        assert asyncio.run(accepted(listening))


@pytest.mark.long
def test_it_ends_well_on_both_signals(tmp_path: Path) -> None:
    for number in (signal.SIGTERM, signal.SIGINT):
        with serving(tmp_path / "runs", start=subprocess.Popen) as running:
            os.kill(running.process.pid, number)
            assert running.process.wait(10) == 0


def _refused(*options: str) -> str:
    done = hil_says("serve", "--port", "0", *options)
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("hil: ")]
    assert "Traceback" not in done.stderr
    return line


@pytest.mark.slow
def test_what_cannot_be_served_is_refused_in_one_line(tmp_path: Path, service: Serving) -> None:
    port = service.address.rpartition(":")[2]
    assert "--port" in _refused("--folder", str(tmp_path / "a"), "--port", port)
    file = tmp_path / "file"
    file.touch()
    assert str(file) in _refused("--folder", str(file))


@pytest.mark.slow
def test_a_service_that_runs_nothing_loads_no_estimator() -> None:
    """It would take as long as all the rest of its start; a run and a trace are processes of their own."""
    heavy = ("numba", "sympy", "scipy", "matplotlib", "pandas", "estimator.observer")
    program = "import importlib, pkgutil, sys, hil.service\n"
    program += (
        "for one in pkgutil.walk_packages(hil.service.__path__, 'hil.service.'): importlib.import_module(one.name)\n"
    )
    program += f"print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
