"""Errors of the wire. Every message is one line that names the place and the remedy."""


class WireError(Exception):
    """Anything wrong between host and board; the command line turns it into exit code 2."""


class LinkError(WireError, OSError):
    """A link cannot be opened or used: no such port, port in use, unknown scheme."""


class LinkClosed(LinkError):
    """The other end hung up, or this end was closed."""


class ProtocolError(WireError, ValueError):
    """The peer speaks, but not this protocol: wrong version or spec, a refused request, a value that does not
    fit. `cure`: what to do about it, the last clause of the line; "" where it has none of its own."""

    def __init__(self, what: str, cure: str = "") -> None:
        super().__init__(f"{what}; {cure}" if cure else what)
        self.cure = cure
