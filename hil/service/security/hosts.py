"""Which names a request may call this service by, and from which pages it may come.

A page of another site can have a browser send requests here, under its own name (Origin) or, where it makes its name
resolve to this address, as if they were its own (Host).  A number as host cannot be made to resolve to anything else.
"""

import ipaddress
import socket
from collections.abc import Iterable
from urllib.parse import urlsplit


class Hosts:
    """Names by which this service may be called: addresses as numbers, localhost, this machine's, those given."""

    def __init__(self, names: Iterable[str] = (), *, local: bool) -> None:
        self._names = {"localhost", *(name.lower() for name in names)}
        self._local = local
        if not local:
            self._names |= {socket.gethostname().lower(), socket.getfqdn().lower()}

    def knows(self, host: str) -> bool:
        """Whether `host`, as in the Host header, is this service."""
        try:
            name = urlsplit(f"//{host}").hostname
            urlsplit(f"//{host}").port  # noqa: B018 - raises where it is none
        except ValueError:
            return False
        if not name or "@" in host or "/" in host:
            return False
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback if self._local else True

    def is_own(self, origin: str, host: str) -> bool:
        """Whether `origin`, as in the Origin header, is the page that this service gave out under `host`."""
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower() and self.knows(host)
