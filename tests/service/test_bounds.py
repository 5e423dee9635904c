"""What is sent to the service is bounded before it is read, and refused in one line, at once."""

import asyncio
import http.client
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.asyncio.client import connect

import hil
from hil.errors import InputError
from hil.service.problems import Problem
from hil.service.security.audit import Audit
from hil.toml.reading import table_of
from tests.forked import hil_says
from tests.service.serving import Serving, own_certificate, serving

AT_ONCE_S = 3.0  # on a machine that does other things; each takes milliseconds

TOML = {
    "dots": "a." * 49_000 + "a = 1",
    "quoted dots": '"a".' * 20_000 + "a = 1",
    "dots and blanks": "a . " * 20_000 + "a = 1",
    "a table's dots": "[" + "a." * 30_000 + "a]",
    "brackets": "a = " + "[" * 5000,
    "braces": "a = " + "{a = " * 5000,
    "digits": "a = " + "1" * 5000,
    "digits and lines": "a = " + "1_" * 3000 + "1",
    "an exponent": "a = 1e" + "9" * 5000,
    "a key": "a" * 50_000 + " = 1",
    "quotes": 'a = "' + "\\" * 50_000,
    "quotes without end": '"""' * 20_001,
    "other quotes": "'''\n" * 20_001,
}


@pytest.mark.parametrize("name", TOML)
def test_toml_beyond_any_file_is_one_line(name: str) -> None:
    begin = time.process_time()
    with pytest.raises(InputError) as refused:
        table_of(TOML[name].encode(), "my.bench.toml")
    assert time.process_time() - begin < 1.0
    assert str(refused.value).isprintable()
    assert len(str(refused.value)) < 300


def test_toml_of_the_bench_is_within_the_bounds() -> None:
    for path in sorted(Path("examples").rglob("*.toml")):
        assert table_of(path.read_bytes(), str(path))
    numbers = ", ".join(f"{k}.5" for k in range(20_000))
    assert len(table_of(f"a = [{numbers}]".encode(), "x")["a"]) == 20_000
    assert table_of(b'a.b."c.d.e.f.g.h.i.j.k.l.m.n.o.p.q.r.s.t.u.v" = "[[[[[[" # ' + b"[" * 100, "x")["a"]["b"]


@pytest.fixture(scope="module")
def lease(service: Serving) -> Iterator[dict[str, str]]:
    taken = service.ask("POST", "/api/lease", json={"holder": "bounds", "seconds": 600}).json()["lease"]
    service.ask("POST", "/api/board/connect", json={"link": "inproc:s-slow"}, headers={"x-lease": taken})
    yield {"x-lease": taken}
    service.ask("POST", "/api/board/disconnect", headers={"x-lease": taken})
    service.ask("DELETE", "/api/lease", headers={"x-lease": taken})


def refused(answer: httpx.Response, begin: float, *statuses: int) -> str:
    assert time.monotonic() - begin < AT_ONCE_S
    assert answer.status_code in statuses, answer.text[:300]
    body = answer.json()
    assert set(body) == {"error", "remedy"}
    for line in body.values():
        assert line, body
        assert line.isprintable()
        assert len(line) <= 400
    return str(body["error"])


@pytest.mark.slow
def test_a_bench_file_as_text(service: Serving, lease: dict[str, str]) -> None:
    for name, text in TOML.items():
        begin = time.monotonic()
        for path in ("start", "drives"):
            answer = service.ask("POST", f"/api/board/{path}", json={"bench_toml": text}, headers=lease)
            assert "bench_toml" in refused(answer, begin, 422), name


@pytest.mark.slow
def test_bodies(service: Serving, lease: dict[str, str]) -> None:
    deep = "[" * 100_000
    bodies: list[tuple[str, bytes, tuple[int, ...]]] = [
        ("/api/board/start", json.dumps({"note": "x" * (8 << 20)}).encode(), (413,)),
        ("/api/ticket", b" " * (2 << 20), (413,)),
        ("/api/lease", deep.encode(), (400, 422)),
        ("/api/lease", b'{"holder": ' + b"1" * 5000 + b"}", (400, 422)),
        ("/api/lease", b'{"holder": "x", "' + b"y" * 100_000 + b'": 1}', (422,)),
        ("/api/lease", b'{"holder": "\\ud800"}', (400, 422)),
        ("/api/lease", b'{"holder": "\xff"}', (400, 422)),
        ("/api/lease", b'{"holder": "x", "seconds": NaN}', (400, 422)),
        ("/api/lease", b'{"holder": "x", "seconds": 1e999}', (400, 422)),
        ("/api/jobs", b'{"kind": []}', (422,)),
        ("/api/jobs", b'{"kind": "run", "bench": {"a": 1}}', (422,)),
    ]
    for path, body, statuses in bodies:
        begin = time.monotonic()
        answer = service.ask("POST", path, content=body, headers={"content-type": "application/json"})
        refused(answer, begin, *statuses)

    def pieces() -> Iterator[bytes]:
        for _ in range(40):
            yield b"x" * 65_536

    begin = time.monotonic()
    answer = service.ask("POST", "/api/lease", content=pieces(), headers={"content-type": "application/json"})
    refused(answer, begin, 413)


@pytest.mark.moderate
def test_headers(service: Serving) -> None:
    for method, path in (("PUT", "/api/lease"), ("DELETE", "/api/lease"), ("POST", "/api/board/connect")):
        connection = http.client.HTTPConnection(service.address)
        connection.putrequest(method, path)
        connection.putheader("Authorization", f"Bearer {service.token()}")
        connection.putheader("X-Lease", b"\xe9")
        connection.putheader("Content-Type", "application/json")
        connection.putheader("Content-Length", "13")
        connection.endheaders(b'{"link": "x"}')
        answer = connection.getresponse()
        said = json.loads(answer.read())
        assert answer.status in (200, 409)
        assert "Traceback" not in str(said)
        connection.close()


@pytest.mark.slow
def test_messages_of_the_live_connection(service: Serving) -> None:
    messages = [
        '{"op": []}', '{"op": {}}', '{"op": null}', "[]", "7", '"x"', "{", "[" * 20_000,
        '{"op": "' + "x" * 30_000 + '"}',
        '{"op": "subscribe"}', '{"op": "subscribe", "id": {}}', '{"id": ' + "9" * 5000 + "}",
    ]  # fmt: skip

    async def ask() -> list[str]:
        async with connect(f"ws://{service.address}/api/live") as socket:
            await socket.send(json.dumps({"op": "hello", "token": service.token()}))
            heard = []
            for message in [*messages, b"\x00"]:
                await socket.send(message)
                while (said := json.loads(await asyncio.wait_for(socket.recv(), 5.0)))["kind"] != "error":
                    pass
                heard.append(said["error"])
            return heard

    heard = asyncio.run(ask())
    assert len(heard) == len(messages) + 1
    assert all(line and line.isprintable() and len(line) <= 400 for line in heard)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a key, another one, and the certificate of that."""
    folder = tmp_path_factory.mktemp("tls")
    for name in ("key.pem", "other.pem"):
        own_certificate(folder / "cert.pem", folder / name)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["no file", "no certificate", "a pipe", "a folder", "another key", "a NUL"])
def test_tls_files_that_cannot_be_used(tmp_path: Path, certificates: Path, wrong: str) -> None:
    certificate, key = tmp_path / "cert.pem", certificates / "key.pem"
    if wrong == "no certificate":
        certificate.write_text("x")
    elif wrong == "a pipe":
        os.mkfifo(certificate)
    elif wrong == "a folder":
        certificate = tmp_path
    elif wrong == "another key":
        certificate = certificates / "cert.pem"
    options = ["--tls-cert", str(certificate), "--tls-key", str(key)]
    if wrong == "a NUL":
        from hil.service.serve import Where, serve

        with pytest.raises(InputError, match="--tls-cert"):
            serve(Where(tmp_path / "runs", 0, certificate=Path("a\0b"), key=key), lambda _: None)
        return
    done = hil_says("serve", "--port", "0", "--folder", str(tmp_path / "runs"), *options)
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("hil: ")]
    assert "--tls-cert" in line
    assert "Traceback" not in done.stderr


# -- a full disk -----------------------------------------------------------------------------------------------------


class Disk:
    """os.write of a disk with so much room."""

    def __init__(self, room: int) -> None:
        self.room = room

    def __call__(self, file: int, data: bytes) -> int:
        if not self.room:
            raise OSError(28, "No space left on device")
        written = os.write(file, data[: self.room])
        self.room -= written
        return written


def noted(audit: Audit) -> bool:
    try:
        audit.note("Ada", "torn", details="ä" * 5)
    except Problem:
        return False
    return True


def test_a_torn_line_of_the_audit_log_takes_no_other_along(tmp_path: Path) -> None:
    """At every byte at which a disk can be full: an entry is there whole, or its note was refused."""
    length = 0
    room = 0
    while True:
        path = tmp_path / f"{room}.jsonl"
        disk = Disk(10_000)
        audit = Audit(path, disk)
        audit.note("Ada", "before")
        disk.room = room
        whole = noted(audit)
        disk.room = 10_000
        if room % 3 == 0:  # the service may have been started anew since
            audit.close()
            audit = Audit(path, disk)
        audit.note("Ada", "after")
        assert [entry["what"] for entry in audit.entries()] == ["after", *(["torn"] if whole else []), "before"]
        assert path.read_bytes().endswith(b"\n")
        audit.close()
        if whole:
            length = room
            break
        room += 1
    assert length > 60


@contextmanager
def full(service: Serving) -> Iterator[None]:
    """No file of the service, or of what it starts, can be written."""
    before = resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, before)


@pytest.mark.slow
def test_on_a_full_disk_safe_acts_and_nothing_is_taken(tmp_path: Path) -> None:
    with serving(tmp_path / "runs") as service:
        lease = service.ask("POST", "/api/lease", json={"holder": "Ada", "seconds": 600}).json()["lease"]
        headers = {"x-lease": lease}
        state = service.ask("POST", "/api/board/connect", json={"link": "pty:s-slow"}, headers=headers)
        assert state.status_code == 200, state.text
        assert state.json()["state"] == "SAFE"
        with full(service):
            for _ in range(20):
                safe = service.ask("POST", "/api/board/safe")
                assert safe.status_code == 200, safe.text
                assert safe.json()["confirmed"] is True
            assert asyncio.run(_safe_over_live(service))["confirmed"] is True
            for method, path, body in (
                ("POST", "/api/board/connect", {"link": "pty:s-slow"}),
                ("PATCH", "/api/board/settings", {"dither": 0.1}),
                ("POST", "/api/board/start", {"bench": "s-slow"}),
                ("POST", "/api/jobs", {"kind": "run", "bench": "s-slow"}),
            ):
                answer = service.ask(method, path, json=body, headers=headers)
                assert answer.status_code == 507, answer.text
                assert "room" in answer.json()["error"] + answer.json()["remedy"]
            record = {"record": ("x.csv", b"t_s,vx_V\n0,1\n" * 400_000)}
            assert service.ask("POST", "/api/uploads", files=record).status_code == 507
            assert service.ask("DELETE", "/api/lease", headers=headers).status_code == 200
            taken = service.ask("POST", "/api/lease", json={"holder": "Bob"})
            assert taken.status_code == 507
            assert service.ask("GET", "/api/lease").json()["lease"] is None
        assert service.ask("GET", "/api/jobs").json()["jobs"] == []
        assert service.ask("GET", "/api/board").json()["next_settings"] == {}
        taken = service.ask("POST", "/api/lease", json={"holder": "Bob"})
        assert taken.status_code == 200
        assert service.ask("GET", "/api/audit").json()[0]["holder"] == "Bob"


async def _safe_over_live(service: Serving) -> Any:
    async with connect(f"ws://{service.address}/api/live") as socket:
        await socket.send(json.dumps({"op": "hello", "token": service.token()}))
        await socket.send(json.dumps({"op": "safe"}))
        while (said := json.loads(await asyncio.wait_for(socket.recv(), 10.0)))["kind"] != "safe":
            pass
        return said


def test_the_interface_for_people_is_made_from_what_there_is(service: Serving) -> None:
    page = httpx.get(f"{service.url}docs", follow_redirects=True)
    assert page.status_code == 200
    assert "docs.js" in page.text
    for script in ("docs/docs.js", "dom.js"):
        assert httpx.get(service.url + script).headers["content-type"].startswith("text/javascript")
    assert "http" not in page.text.replace("<!doctype html>", "")


def test_an_orphaned_worker_says_nothing() -> None:
    for module in ("hil.running.process.worker", "hil.running.recording.recorder"):
        done = subprocess.run([sys.executable, "-m", module], stdin=subprocess.DEVNULL, capture_output=True, timeout=60)
        assert (done.returncode, done.stdout, done.stderr) == (130, b"", b"")
    assert hil
