"""The service's process: where it listens, which tokens it makes, how it begins and ends."""

import asyncio
import ipaddress
import json
import os
import signal
import socket
import ssl
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import uvicorn

from hil.errors import InputError
from hil.running.options import FileOptions
from hil.service.app import make_app
from hil.service.security.audit import Audit
from hil.service.security.hosts import Hosts
from hil.service.security.tokens import Holder, Role, Tokens
from hil.service.service import PRIVATE, Service
from hil.wire.link_name import parse_link
from hil.wire.regular_file import require_regular

PORT = 8417
FOUND_BY = "serve.json"
"""File in the service's own folder by which programs of the same user find it."""
_LARGEST_MESSAGE = 64 * 1024  # of a WebSocket's client
_GRACE_S = 2  # for open requests, at the end


@dataclass(frozen=True)
class Where:
    """Where a service is to listen.

    Attributes:
        folder: run folders.
        port: 0 for any that is free.
        listen: address other than loopback, None for loopback alone.
        insecure: consent to tokens and data that anybody in the network can read.
        certificate, key: files for TLS.
        names: other names that this service may be called by.
        read_only: no token can do more than look.
        links: links that requests may name beside those of the bench itself.
        foxglove: port on loopback for Foxglove's viewers, None for none, 0 for any that is free.
        files: what the runs of this service write beside their folders.
    """

    folder: Path
    port: int = PORT
    listen: str | None = None
    insecure: bool = False
    certificate: Path | None = None
    key: Path | None = None
    names: Sequence[str] = ()
    read_only: bool = False
    foxglove: int | None = None
    links: Sequence[str] = ()
    files: FileOptions = field(default_factory=lambda: FileOptions())


class Begun(NamedTuple):
    """A service that has begun to listen: its address, a link with the token for each role that was given out, and the
    port of other viewers."""

    url: str
    links: dict[str, str]
    foxglove: int | None


def serve(where: Where, begun: Callable[[Begun], None]) -> None:
    """Serve until SIGTERM or Ctrl-C. Raises InputError where that cannot be."""
    _require_secure(where)
    service, given = _service(where)
    sock = listening_socket(where)
    scheme = "https" if where.certificate else "http"
    host, port = sock.getsockname()[:2]
    host = socket.gethostname() if ipaddress.ip_address(host).is_unspecified else host
    url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}/"
    config = uvicorn.Config(
        make_app(service),
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=_LARGEST_MESSAGE,
        ws_per_message_deflate=False,
        server_header=False,
        timeout_graceful_shutdown=_GRACE_S,
        ssl_certfile=where.certificate,
        ssl_keyfile=where.key,
    )
    links = {role: f"{url}#token={token}" for role, token in given.items()}
    found_by = service.private / FOUND_BY
    server = _Server(config)
    with ExitStack() as stack:
        stack.callback(sock.close)
        stack.callback(service.audit.close)
        viewers_port = None
        if where.foxglove is not None:
            from hil.service.viewers import Viewers

            viewers = service.parts["viewers"] = Viewers(where.foxglove)
            stack.callback(viewers.close)
            viewers_port = viewers.port
        entry = {"url": url, "pid": os.getpid(), "token": next(reversed(given.values()))}
        stack.enter_context(_findable(found_by, entry))
        asyncio.run(server.until_told(sock, lambda: begun(Begun(url, links, viewers_port)), service))
        if not server.started:
            raise InputError("the service did not start; the lines above say why")


class _Server(uvicorn.Server):
    """Ends on SIGTERM and Ctrl-C, and gives the signal to nobody else."""

    async def until_told(self, sock: socket.socket, begun: Callable[[], None], service: Service) -> None:
        """Serve on `sock`; `begun` is called when it is ready."""
        self._at_signal = service.at_signal
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._end)
        task = asyncio.ensure_future(self.serve([sock]))
        while not self.started and not task.done():
            await asyncio.sleep(0.01)
        if self.started:
            begun()
        await task

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """The loop's handlers see to them."""
        yield

    def _end(self) -> None:
        for act in self._at_signal:
            act()
        self.force_exit = self.should_exit
        self.should_exit = True


def _require_secure(where: Where) -> None:
    if (where.certificate is None) != (where.key is None):
        raise InputError("--tls-cert and --tls-key belong together: give both")
    if where.certificate is not None and where.key is not None:
        _require_usable(where.certificate, where.key)
    if where.listen is None:
        return
    try:
        local = ipaddress.ip_address(where.listen).is_loopback
    except ValueError:
        raise InputError(f"--listen: {where.listen!r} is no address; give a number, such as 192.168.1.20") from None
    if not (local or where.certificate or where.insecure):
        raise InputError(
            f"--listen {where.listen}: others could read the token; give --tls-cert and --tls-key, "
            "or --insecure if nobody else is in that network"
        )


def _require_usable(certificate: Path, key: Path) -> None:
    """InputError where no TLS can be spoken with these files."""
    for option, path in (("--tls-cert", certificate), ("--tls-key", key)):
        try:
            require_regular(path)
            path.open("rb").close()
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or str(error)
            raise InputError(f"{option}: {path}: {why.lower()}; give a PEM file that can be read") from None
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (OSError, ValueError) as error:  # of OpenSSL too
        why = getattr(error, "reason", None) or str(error)
        raise InputError(
            f"--tls-cert {certificate}, --tls-key {key}: no certificate with its key without a password "
            f"({why.replace('_', ' ').lower()}); give both as PEM files"
        ) from None


def _service(where: Where) -> tuple[Service, dict[str, str]]:
    """The service, and the tokens given out by role: on loopback one that may do everything."""
    links = tuple(parse_link(link) for link in where.links)
    try:
        (where.folder / PRIVATE).mkdir(parents=True, exist_ok=True, mode=0o700)
        audit = Audit(where.folder / PRIVATE / "audit.jsonl")
    except OSError as error:
        raise InputError(f"{where.folder}: {(error.strerror or 'cannot be used').lower()}") from None
    tokens = Tokens()
    roles = [Role.LOOK] if where.read_only else [Role.ADMINISTER] if where.listen is None else list(Role)
    given = {role.name.lower(): tokens.make(Holder(role.name.lower(), role)) for role in roles}
    hosts = Hosts(where.names, local=where.listen is None)
    files: Any = {name: one.absolute() if isinstance(one, Path) else one for name, one in where.files.items()}
    return Service(where.folder, hosts, tokens, audit, links, files), given


def listening_socket(where: Where) -> socket.socket:
    """Bound to where the service is to listen. Raises InputError where that cannot be."""
    host = where.listen or "127.0.0.1"
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # The protocol by its name: asyncio sends what is small at once (TCP_NODELAY) only where it reads it there.
    sock = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((host, where.port))
    except OSError as error:
        sock.close()
        why = (error.strerror or "cannot be used").lower()
        raise InputError(f"{host}:{where.port}: {why}; give another --port, 0 for any that is free") from None
    return sock


@contextmanager
def _findable(path: Path, entry: dict[str, object]) -> Iterator[None]:
    """While it lasts, programs of the same user find the service by `path`."""
    with suppress(FileNotFoundError):
        path.unlink()
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w") as file:
        json.dump(entry, file)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
