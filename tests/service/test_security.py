"""Who is heard (docs/security.md, The service): names, origins, tokens, roles, headers."""

import asyncio
import http.client
import json
import ssl
from pathlib import Path

import httpx
import pytest
from websockets.asyncio.client import connect

from tests.forked import hil_says
from tests.service.serving import Serving, own_certificate, serving

FOREIGN = (
    "http://evil.example",
    "null",
    "https://{address}.evil.example",
    "http://localhost:1",
    "file://",
    "http://[::1",
)


@pytest.mark.moderate
def test_without_a_token_nothing_is_told(service: Serving) -> None:
    for path in ("/api/who", "/api/audit", "/api/nothing"):
        for token in ("", "x", service.token()[:-1], service.token().swapcase()):
            answer = service.ask("GET", path, token=token)
            assert answer.status_code == 401
            assert answer.headers["www-authenticate"] == "Bearer"


@pytest.mark.moderate
def test_two_tokens_or_another_scheme_are_none(service: Serving) -> None:
    good = f"Bearer {service.token()}"
    for headers in ([("authorization", good)] * 2, [("authorization", f"Basic {service.token()}")]):
        assert httpx.get(f"{service.url}api/who", headers=headers).status_code == 401
    assert httpx.get(f"{service.url}api/who", headers=[("authorization", good)]).status_code == 200
    assert httpx.get(f"{service.url}api/who?token={service.token()}").status_code == 401


@pytest.mark.parametrize("origin", FOREIGN)
def test_another_sites_page_changes_nothing(service: Serving, origin: str) -> None:
    body = {"path": "/api/runs/x/report"}
    origin = origin.format(address=service.address)
    answer = service.ask("POST", "/api/ticket", json=body, headers={"origin": origin})
    assert answer.status_code == 403
    own = service.ask("POST", "/api/ticket", json=body, headers={"origin": f"http://{service.address}"})
    assert own.status_code == 200


def test_what_the_browser_says_of_its_page_is_heeded(service: Serving) -> None:
    body = {"path": "/api/runs/x/report"}
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 200), ("none", 200)):
        answer = service.ask("POST", "/api/ticket", json=body, headers={"sec-fetch-site": site})
        assert answer.status_code == status


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("{address}", 200),
        ("localhost:{port}", 200),
        ("[::1]:{port}", 200),
        ("evil.example", 403),
        ("evil.example:{port}", 403),
        ("127.0.0.1.evil.example:{port}", 403),
        ("192.168.7.7:{port}", 403),
        ("user@{address}", 403),
        ("", 403),
        ("127.0.0.1:x", 403),
    ],
)
def test_it_answers_to_its_own_names_alone(service: Serving, host: str, status: int) -> None:
    name, _, port = service.address.rpartition(":")
    connection = http.client.HTTPConnection(name, int(port))
    connection.putrequest("GET", "/api/who", skip_host=True)
    connection.putheader("Host", host.format(address=service.address, port=port))
    connection.putheader("Authorization", f"Bearer {service.token()}")
    connection.endheaders()
    assert connection.getresponse().status == status
    connection.close()


@pytest.mark.moderate
def test_every_answer_carries_the_headers(service: Serving) -> None:
    for answer in (
        httpx.get(service.url),
        service.ask("GET", "/api/who"),
        service.ask("GET", "/api/who", token=""),
        service.ask("GET", "/api/who", headers={"host": "evil.example"}),
    ):
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert "set-cookie" not in answer.headers
        assert "access-control-allow-origin" not in answer.headers


@pytest.mark.moderate
def test_the_pages_files_are_the_pages_files(service: Serving) -> None:
    for path in ("/../app.py", "/..%2fapp.py", "/%2e%2e/app.py", "//etc/passwd", "/..\\app.py", "/%00"):
        connection = http.client.HTTPConnection(service.address)
        connection.request("GET", path, headers={"Host": service.address})
        answer = connection.getresponse()
        assert answer.status in (400, 404)
        assert b"make_app" not in answer.read()
        connection.close()


@pytest.mark.moderate
def test_a_ticket_reads_one_path_and_changes_nothing(service: Serving) -> None:
    url = service.ask("POST", "/api/ticket", json={"path": "/api/runs/nothing"}).json()["url"]
    assert httpx.get(service.url.rstrip("/") + url).status_code == 404  # heard, and there is none
    other = url.replace("nothing", "other")
    assert httpx.get(service.url.rstrip("/") + other).status_code == 401
    assert httpx.delete(service.url.rstrip("/") + url).status_code == 401
    for path in ("/api/audit", "/api/runs/x?y", "runs", "/api/board"):
        assert service.ask("POST", "/api/ticket", json={"path": path}).status_code == 422


@pytest.mark.slow
def test_roles(tmp_path: Path) -> None:
    with serving(tmp_path / "runs", "--listen", "127.0.0.1") as running:
        tokens = {role: running.token(role) for role in ("look", "operate", "administer")}
        assert len(set(tokens.values())) == 3
        ticket = {"path": "/api/runs/x"}
        for role, status in {"look": 403, "operate": 200, "administer": 200}.items():
            answer = running.ask("POST", "/api/ticket", token=tokens[role], json=ticket)
            assert answer.status_code == status
        for role, status in {"look": 403, "operate": 403, "administer": 200}.items():
            assert running.ask("GET", "/api/audit", token=tokens[role]).status_code == status
            assert running.ask("GET", "/api/who", token=tokens[role]).json()["role"] == role


@pytest.mark.slow
def test_read_only(tmp_path: Path) -> None:
    with serving(tmp_path / "runs", "--read-only") as running:
        assert running.ask("GET", "/api/who").json()["role"] == "look"
        assert running.ask("POST", "/api/ticket", json={"path": "/api/runs/x"}).status_code == 403


@pytest.mark.slow
def test_listening_elsewhere_needs_tls_or_consent(tmp_path: Path) -> None:
    for address in ("0.0.0.0", "192.0.2.1", "::", "nowhere"):
        done = hil_says("serve", "--port", "0", "--folder", str(tmp_path / "runs"), "--listen", address)
        assert done.returncode == 2
        assert "--listen" in done.stderr
        assert sum(line.startswith("hil: ") for line in done.stderr.splitlines()) == 1
    with serving(tmp_path / "runs", "--listen", "0.0.0.0", "--insecure") as running:
        port = running.address.rpartition(":")[2]
        answer = httpx.get(f"http://127.0.0.1:{port}/api/who", headers={"authorization": f"Bearer {running.token()}"})
        assert answer.status_code == 200


@pytest.mark.slow
def test_over_tls_requests_and_the_live_connection(tmp_path: Path) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    own_certificate(certificate, key, "-addext", "subjectAltName=IP:127.0.0.1,DNS:localhost")
    tls = ("--tls-cert", str(certificate), "--tls-key", str(key))
    with serving(tmp_path / "runs", "--listen", "127.0.0.1", *tls) as running:
        assert running.url.startswith("https://")
        trusting = ssl.create_default_context(cafile=certificate)
        bearer = {"authorization": f"Bearer {running.token('look')}"}
        assert httpx.get(f"{running.url}api/who", headers=bearer, verify=trusting).json()["role"] == "look"
        with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            httpx.get(f"{running.url}api/who", headers=bearer, verify=ssl.create_default_context())
        with pytest.raises(httpx.RemoteProtocolError):
            httpx.get(running.url.replace("https", "http"), headers=bearer)

        async def first_state() -> str:
            address = f"wss://{running.address}/api/live"
            async with connect(address, ssl=trusting, origin=f"https://{running.address}") as socket:  # type: ignore[arg-type]
                await socket.send(json.dumps({"op": "hello", "token": running.token("look")}))
                return str(json.loads(await socket.recv())["kind"])

        assert asyncio.run(first_state()) == "state"
