"""A real service: `hil serve` in a process of its own, most often a fork, and what a client of it needs."""

import json
import os
import signal
import ssl
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from tests.forked import Forked

_END_S = 100.0  # for figures and report of a run, on a busy machine
_TRUSTED = ssl.create_default_context()  # made once: it takes longer than a request


@dataclass
class Serving:
    """A service that listens; `token` is the one that may do most. `lease` and `run` are for a test to set."""

    process: "subprocess.Popen[bytes]"
    url: str
    links: dict[str, str]
    folder: Path
    foxglove: int | None = None
    lease: str = ""
    run: str = ""

    def token(self, role: str | None = None) -> str:
        """The token of a role, of the highest one by default."""
        link = self.links[role] if role else list(self.links.values())[-1]
        return link.partition("#token=")[2]

    @property
    def address(self) -> str:
        """Host and port."""
        return self.url.split("//")[1].rstrip("/")

    def ask(self, method: str, path: str, *, token: str | None = None, **given: Any) -> httpx.Response:
        """One request, with the token unless another one is given; "" for none."""
        held = self.token() if token is None else token
        headers = given.pop("headers", {}) | ({"authorization": f"Bearer {held}"} if held else {})
        return httpx.request(
            method, self.url.rstrip("/") + path, headers=headers, timeout=200.0, verify=_TRUSTED, **given
        )


@contextmanager
def serving(folder: Path, *options: str, start: type["subprocess.Popen[bytes]"] = Forked) -> Iterator[Serving]:
    """`hil serve` on a free port, ended by SIGTERM, which it has to obey."""
    process = start(
        [sys.executable, "-m", "hil", "serve", "--port", "0", "--json", "--folder", str(folder), *options],
        stdout=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | {"PYTHONWARNINGS": "error"},
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        if not line:
            raise RuntimeError(f"hil serve ended with code {process.wait()}")
        said = json.loads(line)
        yield Serving(process, said["url"], said["links"], folder, said["foxglove"])
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise
        finally:
            process.stdout.close()


def own_certificate(certificate: Path, key: Path, *more: str) -> None:
    """A key, and a certificate that it signs itself."""
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"),
            *("-keyout", str(key), "-out", str(certificate), "-days", "2", "-subj", "/CN=localhost", *more),
        ],
        check=True,
        capture_output=True,
    )
