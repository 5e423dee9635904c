"""Requests that no client of ours makes: each is answered at once, in one line, and leaves the service as it was."""

import json
import socket
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.service.serving import Serving

pytestmark = pytest.mark.slow
AT_ONCE_S = 3.0  # on a machine that does other things

LINKS = (
    "serial:/dev/ttyACM0?baud=1&baud=2",
    "serial:/dev/../etc/shadow",
    "serial:/proc/self/mem",
    "serial:/dev/stdin",
    "serial:loop://",
    "serial:spy:///dev/ttyS0?file=/tmp/x",
    "can:slcan:/dev/pts/0",
    "can:seeedstudio:/etc/hosts",
    "can:robotell:socket://127.0.0.1:22",
    "can:socketcand:can0?host=127.0.0.1&port=22",
    "can:udp_multicast:239.1.1.1",
    "can:virtual:x?protocol=1",
    "can:vcan0?node=99999999999999999999",
    "can:" + "x" * 900,
    "udp:239.0.0.1:4242?key=.",
    "udp:239.0.0.1:4242?key=runs",
    "udp:239.0.0.1:4242?interface=0.0.0.0",
    "udp:239.0.0.1:4242?interface=127.0.0.1%00",
    "udp:127.0.0.1:22",
    "udp:[::1]:22",
    "pty:s-slow.scenario.toml/../../x",
    "pty:\ud800",
    "inproc:",
    "inproc:%2e%2e/x",
    "pickle:x",
    "",
    "tcp:a",
    "inproc:no",
    "pty:/etc/passwd",
    "serial:../../x",
    "serial:\u202e0SUtty/ved/",
)
JOBS: tuple[Any, ...] = (
    [],
    7,
    {"kind": "campaign"},
    {"kind": "run"},
    {"kind": "run", "bench": "../x"},
    {"kind": "run", "bench": "s-slow", "name": "../x"},
    {"kind": "trace", "run": "../x"},
    {"kind": "pyramid", "record": "/etc/passwd"},
    {"kind": "import", "upload": "../../x"},
)
BODIES: tuple[tuple[str, str, Any], ...] = (
    ("POST", "/api/board/drives", {"bench": "../../etc/passwd"}),
    ("POST", "/api/board/drives", {"bench": "s-slow", "settings": {"amplitude": 1e308}}),
    ("POST", "/api/board/drives", {"bench": "s-slow", "settings": {"dither": -1}}),
    ("POST", "/api/board/drives", {"bench": "s-slow", "duration_s": 1e-9}),
    ("POST", "/api/board/start", {"bench_toml": "[device]\nname = '\\u0000'"}),
    ("POST", "/api/board/start", {"bench_toml": "\ufeff[link]"}),
    ("POST", "/api/board/start", {"bench_toml": "a = 1\r"}),
    ("POST", "/api/board/start", {"bench": "s-slow", "agreed": "x" * 65}),
    ("PATCH", "/api/board/settings", {"amplitude": "1e-4 "}),
    ("PATCH", "/api/board/settings", {"amplitude": True}),
    ("POST", "/api/lease", {"holder": "x\u0000", "seconds": 1}),
    ("POST", "/api/lease", {"holder": "x", "seconds": 1e300}),
    ("POST", "/api/jobs", {"kind": "run", "bench": "s-slow", "link": "serial:/dev/ttyS0"}),
    ("POST", "/api/jobs", {"kind": "run", "bench": "s-slow", "link": "pty:..", "seed": 2**63}),
    *(("POST", "/api/jobs", job) for job in JOBS),
    ("POST", "/api/jobs", {"kind": "sweep", "campaign": "\n" * 100}),
    ("POST", "/api/ticket", {"path": "/api/board/../runs/" + "../" * 50}),
    ("GET", "/api/runs?after=" + "A" * 5000, None),
    ("GET", "/api/runs?sort=" + "x" * 500, None),
    ("GET", "/api/runs/%00/files/%2e%2e", None),
    ("GET", "/api/audit?limit=" + "9" * 5000, None),
    ("DELETE", "/api/jobs/..%2f..", None),
)


@pytest.fixture
def lease(service: Serving) -> Iterator[dict[str, str]]:
    key = service.ask("POST", "/api/lease", json={"holder": "rough", "seconds": 600}).json()["lease"]
    yield {"x-lease": key}
    service.ask("DELETE", "/api/lease", headers={"x-lease": key})


def require_one_line(answer: Any, begin: float, what: str) -> None:
    assert time.monotonic() - begin < AT_ONCE_S, what
    assert 400 <= answer.status_code < 500, (what, answer.status_code, answer.text[:300])
    body = answer.json()
    assert set(body) == {"error", "remedy"}, what
    assert body["error"].isprintable(), what
    assert body["remedy"].isprintable(), what
    assert body["remedy"], what
    assert len(body["error"]) <= 400, what


def test_links(service: Serving, lease: dict[str, str]) -> None:
    for link in LINKS:
        begin = time.monotonic()
        body = json.dumps({"link": link})
        headers = {**lease, "content-type": "application/json"}
        require_one_line(service.ask("POST", "/api/board/connect", content=body, headers=headers), begin, link)
    assert not service.ask("GET", "/api/board").json()["connected"]


def test_bodies(service: Serving, lease: dict[str, str]) -> None:
    connected = service.ask("POST", "/api/board/connect", json={"link": "inproc:s-slow"}, headers=lease)
    assert connected.status_code == 200, connected.text
    for method, path, body in BODIES:
        begin = time.monotonic()
        given = {} if body is None else {"content": json.dumps(body)}
        headers = {**lease, "content-type": "application/json"}
        require_one_line(service.ask(method, path, headers=headers, **given), begin, f"{method} {path[:60]} {body}")
    service.ask("POST", "/api/board/disconnect", headers=lease)


@pytest.mark.parametrize(
    ("sent", "error", "remedy"),
    [
        (b'{"kind": "run",}', "the body is not JSON: ", "send JSON"),
        (b"{}", "kind: missing", "GET /openapi.json says what is expected"),
        (b'{"kind": "pyramid"}', "kind: 'pyramid' is unknown", "give one of run, record, trace"),
        (b"[]", "the body: expected an object of JSON", "GET /openapi.json says what is expected"),
        (b'{"kind": "trace"}', "trace.run: missing", "GET /openapi.json says what is expected"),
        (b'{"kind": "import", "upload": "a", "uplaod": "b"}', "import.uplaod: unknown key", "GET /openapi.json"),
    ],
)
def test_what_is_wrong_is_said_in_plain_words(service: Serving, sent: bytes, error: str, remedy: str) -> None:
    answer = service.ask("POST", "/api/jobs", content=sent, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert answer.json()["error"].startswith(error)
    assert answer.json()["remedy"].startswith(remedy)


@pytest.mark.parametrize(
    "sent",
    [
        b"GET /api/board HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer \xff\xfe\r\n\r\n",
        b"POST /api/lease HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {t}\r\n"
        b"Content-Length: 99999999999999999999\r\n\r\n",
        b"POST /api/uploads HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {t}\r\nContent-Length: 5\r\n"
        b"Content-Type: multipart/form-data; boundary=\r\n\r\nxxxxx",
        b"POST /api/uploads HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {t}\r\nContent-Length: 5\r\n"
        b"Content-Type: multipart/form-data; boundary=\xe9\r\n\r\nxxxxx",
        b"GET /api/runs/\xff%ff HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {t}\r\n\r\n",
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: {}\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    ],
)
def test_bytes(service: Serving, sent: bytes) -> None:
    host, _, port = service.address.rpartition(":")
    data = sent.replace(b"{}", service.address.encode()).replace(b"{t}", service.token().encode())
    begin = time.monotonic()
    with socket.create_connection((host, int(port)), timeout=AT_ONCE_S) as line:
        line.sendall(data)
        line.shutdown(socket.SHUT_WR)
        status = line.makefile("rb").readline()
    assert time.monotonic() - begin < AT_ONCE_S
    assert status == b"" or status.split()[1][:1] == b"4", status
    assert service.ask("GET", "/healthz").status_code == 200
