"""Links by name: `serial:/dev/ttyUSB0`, `inproc:examples/s-slow.scenario.toml`."""

from collections.abc import Callable
from urllib.parse import parse_qsl

from hil.wire.errors import LinkError
from hil.wire.link import Link


def open_link(url: str) -> Link:
    """Open a link by name.

    `serial:PATH[?baud=N]` a serial port or the host's end of a pty; `inproc:SCENARIO` an emulated board in
    this process.

    Raises:
        LinkError: unknown scheme or option, or the link cannot be opened; one line that names the link and
            the cure.
    """
    scheme, colon, rest = url.partition(":")
    opener = _OPENERS.get(scheme)
    if opener is None or not colon or not rest:
        known = ", ".join(f"{name}:…" for name in _OPENERS)
        raise LinkError(f"link {url!r}: unknown kind of link; known are {known}")
    return opener(rest)


def _serial(rest: str) -> Link:
    from hil.wire.serial_link import DEFAULT_BAUD, open_serial

    path, _, query = rest.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    baud = options.pop("baud", str(DEFAULT_BAUD))
    if options or not baud.isascii() or not baud.isdigit() or int(baud) == 0:
        raise LinkError(f"link 'serial:{rest}': bad option; expected serial:PATH or serial:PATH?baud=921600")
    return open_serial(path, int(baud))


def _inproc(rest: str) -> Link:
    from hil.wire.inproc import open_inproc

    return open_inproc(rest)


_OPENERS: dict[str, Callable[[str], Link]] = {"serial": _serial, "inproc": _inproc}
